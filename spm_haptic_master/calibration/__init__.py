# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibration of a rig: in a jig, by moving it, its report, its file; and of its motors and friction.

Imports encoders, validation, parameters, kinematics and the top-level modules; no ROS. matplotlib
is an extra.
"""
