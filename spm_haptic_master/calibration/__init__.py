# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zero counts and directions from readings at a known pose, their verification, and their file.

Imports encoders, validation, parameters, kinematics and the top-level modules; no ROS. matplotlib
is an extra.
"""
