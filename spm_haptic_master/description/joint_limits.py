# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The range of each joint over the workspace."""

from __future__ import annotations

from math import ceil, floor, pi, radians
from typing import cast

import numpy as np
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics import Geometry, mechanism_angles, workspace_pose
from spm_haptic_master.kinematics.number_backends import Rotation

# Tilts of the poses whose angles are taken (deg): from the centre to the rim of the cone.
TILTS_DEG = (0.0, 13.0, 20.0, 26.0)
# Their self-rotations (deg): from and to, and the steps of self-rotation and azimuth.
TURNS_DEG, STEP_DEG = (-20.0, 100.0), 5.0
# Limits are this farther out than the angles found, and then on a grid of this step (deg): between
# the poses a joint goes beyond these angles by less, most where its leg is nearly stretched.
MARGIN_DEG = 5.0


def joint_limits(geometry: Geometry) -> tuple[tuple[float, float], ...]:
    """
    Return the least and the largest angle of all nine joints in the workspace, rad.

    The workspace is the cone of 26 deg at self-rotations from -20 to 100 deg, without the poses
    that a leg does not reach. The joints are in the order of MECHANISM_JOINT_NAMES.
    """
    tilts, azimuths, turns = np.meshgrid(
        np.radians(TILTS_DEG), np.radians(np.arange(0.0, 360.0, STEP_DEG)),
        np.radians(np.arange(TURNS_DEG[0], TURNS_DEG[1] + STEP_DEG, STEP_DEG)), indexing='ij')
    found = []
    for pose in workspace_pose(tilts, azimuths, turns).reshape(-1, 9).tolist():
        try:
            found.append(mechanism_angles(cast('Rotation[float]', tuple(pose)), geometry))
        except UnreachableError:
            continue
    step = radians(MARGIN_DEG)
    return tuple((max(-pi, (floor(min(angles) / step) - 1) * step),
                  min(pi, (ceil(max(angles) / step) + 1) * step))
                 for angles in zip(*found, strict=True))
