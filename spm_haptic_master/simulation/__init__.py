# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Simulated motion, encoders and bus, with faults on request.

Imports encoders, kinematics and the top-level modules; no ROS.
"""
