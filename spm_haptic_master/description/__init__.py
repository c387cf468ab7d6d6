# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mechanism's shape: solids of its links, and the URDF of a nominal or built mechanism.

Imports kinematics and the top-level modules; no ROS.
"""
