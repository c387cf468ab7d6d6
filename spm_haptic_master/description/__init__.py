# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What displays show of the mechanism: solids, URDF, colours, and the pose of three encoders alone.

Imports kinematics and the top-level modules; no ROS.
"""
