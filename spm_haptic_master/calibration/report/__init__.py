# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The report on a calibration by motion: one page with a verdict, its tables and its picture.

Imports `motion`, and for the picture validation and matplotlib, which is an extra.
"""
