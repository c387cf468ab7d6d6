# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Whether a calibration still holds: slips of encoders in a recorded motion, and while a rig runs.

Imports kinematics and the top-level modules; no clock, no I/O, no ROS.
"""
