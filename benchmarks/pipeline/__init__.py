# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Latency, CPU and loss of the nodes beside a bare rclpy relay of the same messages.

`child_process` starts programs on a private DDS domain, also for the tests and the paper.
Imports ros, kinematics and the top-level modules.
"""
