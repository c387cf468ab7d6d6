# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rate of the joint samples: one setting of the driver, of fkm and of the simulation."""

from __future__ import annotations

from spm_haptic_master.settings import Setting

# Nominal rate of the sets, and of SYNC produced by the driver.
RATE_SETTING = Setting('rate', float, 'rate of the sets of joint angles, Hz',
                       default=1000.0, minimum=1.0, maximum=10000.0)
