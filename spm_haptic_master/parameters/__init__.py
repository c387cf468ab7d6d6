# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The type of a setting, the settings that several rooms take, and parameter files.

Imports kinematics and the top-level modules.
"""
