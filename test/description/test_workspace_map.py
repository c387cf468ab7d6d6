# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The map of the workspace against the dexterity and the determinant of its poses."""

from math import radians

import numpy as np
import pytest
from spm_haptic_master.description.workspace_map import (
    COLOURS,
    HALF_ANGLE,
    UNREACHABLE,
    WorkspaceMap,
)
from spm_haptic_master.kinematics import (
    dexterity,
    Geometry,
    parallel_determinant,
    workspace_pose,
)


@pytest.mark.parametrize('phi', [0.0, 45.0, 49.36, 60.0])
def test_the_map_has_the_dexterity_and_the_singularities(phi):
    geometry, phi = Geometry(), radians(phi)
    drawn = WorkspaceMap(geometry, (1, 1, 1))
    centre = np.ones(3) / 3.0 ** 0.5
    tilts = np.arccos(np.clip(drawn.axes @ centre, -1.0, 1.0))
    assert tilts.max() < HALF_ANGLE
    # Evenly over the cone: as many tiles within a part of it as its area has of the whole.
    part = np.mean(tilts < 0.5 * HALF_ANGLE)
    assert part == pytest.approx((1 - np.cos(0.5 * HALF_ANGLE)) / (1 - np.cos(HALF_ANGLE)),
                                 abs=0.01)
    colours = drawn.colours(phi)
    away = drawn.axes - (drawn.axes @ centre)[:, None] * centre
    u, v = (np.array([1.0, -1.0, 0.0]) / 2.0 ** 0.5, np.array([1.0, 1.0, -2.0]) / 6.0 ** 0.5)
    poses = workspace_pose(tilts, np.arctan2(away @ v, away @ u), phi)
    np.testing.assert_allclose(poses[..., 2], drawn.axes, atol=1e-12)
    eta = dexterity(poses, geometry)
    # The nearer to a singularity, the nearer to the first colour.
    red = np.abs(colours - COLOURS[0]).sum(axis=1)
    reached = np.isfinite(eta)
    assert np.array_equal((colours == UNREACHABLE).all(axis=1), ~reached)
    assert red[reached][np.argmin(eta[reached])] == red[reached].min()
    full = reached & (eta >= 0.2)
    assert full.any() or phi > 0.1
    assert (colours[full] == COLOURS[2]).all()
    low, high = eta[reached] < 0.01, eta[reached] > 0.1
    assert not low.any() or not high.any() or red[reached][low].max() < red[reached][high].min()

    singular = drawn.singular_axes(phi)
    determinants = parallel_determinant(poses, geometry)
    crossed = np.nanmin(determinants) < 0.0 < np.nanmax(determinants)
    assert bool(len(singular)) == crossed
    if len(singular):
        z = singular @ centre
        out = singular - z[:, None] * centre
        found = workspace_pose(np.arccos(np.clip(z, -1.0, 1.0)), np.arctan2(out @ v, out @ u), phi)
        # 1e-3 is a twentieth of a degree here.
        assert np.abs(parallel_determinant(found, geometry)).max() < 2e-3
