# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Slips of encoders while a rig runs, by the slow part of the parity.

Imports kinematics and the top-level modules; no clock, no I/O, no ROS.
"""
