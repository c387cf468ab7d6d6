# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Simulated rig, motion, encoders and bus with faults; the choice of a source, simulated or real.

Imports encoders, parameters, kinematics and the top-level modules; no ROS.
"""
