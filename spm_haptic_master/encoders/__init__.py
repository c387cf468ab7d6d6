# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Sources of joint samples from encoders on a CAN bus: frames, layouts, cycles, nodes.

Imports python-can, parameters and the top-level modules; no ROS, no mechanism.
"""
