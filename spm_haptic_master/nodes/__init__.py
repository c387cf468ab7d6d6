# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The ROS nodes and what they share: parameters, messages, diagnostics, start and end of a process.

Imports supervision, encoders, simulation, kinematics and the top-level modules. rclpy is imported
here, and for the bare nodes of `benchmark`; nowhere else.
"""
