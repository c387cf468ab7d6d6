# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Drives of the motors (CiA 402 over CANopen): torques out, states back, one call a sample.

Imports encoders, parameters and the top-level modules; no ROS.
"""
