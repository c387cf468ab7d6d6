# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
From the master to a slave: registration, law, limits, engaging and clutch, the CRTK state.

Imports kinematics, supervision and the top-level modules. No ROS and no clock: time is given.
"""
