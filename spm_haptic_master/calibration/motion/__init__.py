# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zero counts, mechanism and errors of the encoders from free motion, with bounds of their errors.

Imports encoders, validation, kinematics and the top-level modules, and `calibration`'s file and
watch.
"""
