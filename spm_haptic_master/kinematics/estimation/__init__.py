# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientations from any three to six joint sensors.

Each mounted sensor is one row: residual, rates along th1A, th2A, th3A, and weight, 0 if it is left
out. A step that suffices for a healthy sample is written out for th1A, th1B, th1C and th3A.
Imports the formulas of kinematics, and numpy for batches.
"""
