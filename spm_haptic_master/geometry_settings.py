# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the manipulator's geometry and working mode, shared by all nodes."""

from __future__ import annotations

from math import degrees, radians

from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.settings import Setting, Values

# Settings of the three link angles (deg).
GEOMETRY_SETTINGS = tuple(
    Setting(f'geometry.{name}_deg', float, f'{part}, deg',
            default=degrees(getattr(PAPER_GEOMETRY, name)), minimum=0.1, maximum=179.9)
    for name, part in (
        ('alpha', 'angle of the proximal link'),
        ('beta', 'angle of the distal link'),
        ('gamma', 'angle between the platform axis and each Z3k')))

# Setting of the working mode (signs).
WORKING_MODE_SETTING = Setting(
    'working_mode', int, 'sign of Z1k . (Z2k x Z3k) of the legs A, B, C',
    default=(1, 1, 1), allowed=(1, -1), count=3)


def geometry_from(values: Values) -> Geometry:
    """Return the Geometry of checked settings; GeometryError if it cannot exist."""
    return Geometry(*(radians(values[setting.name]) for setting in GEOMETRY_SETTINGS))
