# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The frames of a mechanism as built that need no outside reference."""

from __future__ import annotations

import numpy as np
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.number_backends import Array


def in_usual_frames(geometry: Geometry,
                    nominal: Geometry = PAPER_GEOMETRY) -> tuple[Geometry, Array, Array]:
    """
    Return a mechanism with its axes in the frames that need no outside reference.

    Base: z = Z1A, and Z1B in the half plane of positive x of x and z. Platform: its three axes
    nearest, in the sum of squares, to their nominal directions.

    Parameters
    ----------
    geometry : Geometry
        The mechanism, its axes in any frames.
    nominal : Geometry
        The mechanism with the nominal directions of the platform's axes.

    Returns
    -------
    geometry : Geometry
        The same mechanism; its joints' zeros are those of its new frames.
    base, platform : ndarray, shape (3, 3)
        Rotations from the components in the earlier frame to those in the new one:
        R_new = base R platform^T.

    Raises
    ------
    InputError
        An argument is no Geometry.
    GeometryError
        An axis is opposite to its nominal direction in the new frames.

    """
    check_geometry(geometry)
    check_geometry(nominal)
    first, second, _ = axes = np.array(geometry.base_axes)
    x = second - (second @ first) * first
    x /= np.linalg.norm(x)
    base = np.stack([x, np.cross(first, x), first])
    built = np.array(geometry.platform_axes)
    left, _, right = np.linalg.svd(np.array(nominal.platform_axes).T @ built)
    platform = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    moved = axes @ base.T
    # Exactly so, and not to rounding.
    moved[0], moved[1, 1] = (0.0, 0.0, 1.0), 0.0
    return (Geometry.from_axes(moved, built @ platform.T, geometry.alphas, geometry.betas),
            base, platform)
