# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings that the driver, fkm and the simulation have in common."""

from __future__ import annotations

from spm_haptic_master.parameters.setting import Setting

# Nominal rate of the sets, and of SYNC produced by the driver.
RATE_SETTING = Setting('rate', float, 'rate of the sets of joint angles, Hz',
                       default=1000.0, minimum=1.0, maximum=10000.0)

# Number of sensors, in every node that needs to know.
SENSORS_SETTING = Setting(
    'sensors', int, 'number of sensors: 4 (th1A, th1B, th1C, th3A), 5 (these and th3B) or 6 '
    '(these, th3B and th3C)', default=4, allowed=(4, 5, 6))

# Name of the calibration, in every node that takes a part of it.
CALIBRATION_SETTING = Setting(
    'calibration', str, 'name of the calibration that the zero counts, sigma_deg and bias_deg '
    'are from: calibrate writes its date; driver and fkm need the same', default='', blank=True)

# Frame of the driver's samples, which CRTK clients expect to be there.
JOINTS_FRAME_SETTING = Setting(
    'measured_js.frame_id', str, 'frame_id of measured_js', default='spm_base')
