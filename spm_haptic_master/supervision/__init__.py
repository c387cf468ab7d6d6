# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which orientation may go out: limits, symptoms of a faulty sensor, and the supervisor that decides.

Imports kinematics and the top-level modules; no clock, no I/O, no ROS.
"""
