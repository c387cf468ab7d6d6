# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the simulated rig and its motion."""

from __future__ import annotations

from spm_haptic_master.parameters.encoders import (
    COUNTS_PER_TURN_SETTING,
    FIRST_HARMONIC_SETTINGS,
    TABLE_SETTINGS,
)
from spm_haptic_master.parameters.geometry import GEOMETRY_SETTINGS, WORKING_MODE_SETTING
from spm_haptic_master.parameters.setting import Setting
from spm_haptic_master.parameters.shared import RATE_SETTING, SENSORS_SETTING

# Settings of the motion.
MOTION_SETTINGS = (
    SENSORS_SETTING,
    Setting('sim.trajectory', str, 'simulated motion',
            allowed=('fig9', 'perturbed', 'sweep', 'hand', 'tour', 'fixed')),
    Setting('sim.tilt_max_deg', float, 'sweep: largest tilt from the centre, deg',
            minimum=0.0, maximum=26.0),
    Setting('sim.pose_deg', float, 'fixed: psi, theta, phi (ZXZ), deg',
            minimum=-360.0, maximum=360.0, count=3),
    Setting('sim.noise_deg', float, 'standard deviation of each sensor, deg',
            minimum=0.0, maximum=10.0),
    Setting('sim.seed', int, 'seed of the noise; the same seed gives the same noise', minimum=0),
    Setting('sim.rig_file', str, 'file (JSON) of the simulated rig: its mechanism as built and '
            'the errors of its sensors; empty: none', blank=True),
    Setting('sim.rig_seed', int, 'seed of a random rig, off by the two below; 0: none, the rig is '
            'as drawn (geometry.*)', minimum=0),
    Setting('sim.tolerance_deg', float, 'sim.rig_seed: standard deviations of its link angles and '
            'of its axes, deg', minimum=0.0, maximum=5.0, count=2),
    Setting('sim.harmonics_deg', float, "sim.rig_seed: standard deviations of the encoders' first "
            'and second harmonics, deg', minimum=0.0, maximum=2.0, count=2),
    *GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
)

# Settings of the source `sim`.
SIM_SETTINGS = (RATE_SETTING, *MOTION_SETTINGS, COUNTS_PER_TURN_SETTING, *FIRST_HARMONIC_SETTINGS,
                *TABLE_SETTINGS)
