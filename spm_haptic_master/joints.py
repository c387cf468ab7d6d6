# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The measured joints: their names and their order, everywhere."""

JOINT_NAMES = ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a')
"""th1A, th1B, th1C on the motor axes of the legs A, B, C, then th3A on leg A's passive joint."""
