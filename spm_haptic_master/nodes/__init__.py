# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The ROS nodes: driver, orientation, diagnostics, tele-operation, recorder, and their composition.

Imports every room but description, validation, view and tools.
"""
