# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Orientation of a spherical parallel haptic master from four joint sensors."""
