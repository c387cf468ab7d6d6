# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zero counts and directions from readings at known poses, and their verification.

Imports encoders, kinematics and the top-level modules.
"""
