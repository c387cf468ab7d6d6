# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What every node shares: its parameters, start and end of a process, log, diagnostics.

Imports parameters and kinematics. rclpy is imported here, in `nodes` and in `view`;
nowhere else.
"""
