# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Recorded orientations against motion capture: reading, alignment, error figures and pictures.

Imports encoders, kinematics and the top-level modules; no ROS. matplotlib and the readers of
rosbag2 files are extras.
"""
