# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Force feedback in simulated time: the device with motors in MuJoCo, a hand, a slave behind delays.

Imports force, kinematics and the multi-body model of `paper`.
"""
