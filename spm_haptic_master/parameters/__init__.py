# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every setting, and the one resolver of files and arguments: what was given is what runs.

Imports kinematics and the top-level modules.
"""
