# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Workspace cone: dexterity and det A as the paper draws them, and the singularities."""

import math

from mechanism import CENTRE, zxz
import numpy as np
import pytest
from spm_haptic_master.kinematics import (
    dexterity,
    parallel_determinant,
    singularity_locus,
    workspace_pose,
    zxz_from_matrix,
)

PHI = math.radians(50.0)


def test_poses_of_the_cone():
    tilt, azimuth = np.radians([0.0, 10.0, 26.0]), np.radians([[0.0], [90.0], [200.0]])
    R = workspace_pose(tilt, azimuth, PHI)
    axis = np.ones(3) / math.sqrt(3.0)
    np.testing.assert_allclose(
        np.arccos(np.minimum(1.0, R[..., 2] @ axis)), np.broadcast_to(tilt, (3, 3)), atol=1e-7)
    np.testing.assert_allclose(zxz_from_matrix(R)[2], PHI, atol=1e-14)
    np.testing.assert_allclose(R[0, 0], zxz(*CENTRE, PHI), atol=1e-15)
    np.testing.assert_allclose(
        R[0, 1][:, 2], math.cos(tilt[1]) * axis + math.sin(tilt[1]) * np.array([1, -1, 0])
        / math.sqrt(2.0), atol=1e-15)


def test_figures_6_and_15_dexterity_over_the_cone():
    # facts.md: 0.000 to 0.101 with three sensors, 0.323 to 0.502 with four, 13 deg half cone.
    tilt = np.radians(np.linspace(0.0, 13.0, 40))
    R = workspace_pose(tilt, np.radians(np.arange(0.0, 360.0, 2.0))[:, None], PHI)
    three, four = dexterity(R), dexterity(R, sensors=4)
    assert three.min() < 5e-4 and three.max() == pytest.approx(0.101, abs=1e-3)
    assert four.min() == pytest.approx(0.323, abs=1e-3)
    assert four.max() == pytest.approx(0.502, abs=1e-3)


@pytest.mark.parametrize('phi_deg', [49.358591780, 53.0])
def test_locus_is_where_the_determinant_changes_sign(phi_deg):
    phi = math.radians(phi_deg)
    tilt, azimuth = singularity_locus(phi, math.radians(26.0))
    assert len(tilt) > 50 and tilt.max() <= math.radians(26.0) and np.diff(azimuth).min() >= 0.0
    np.testing.assert_allclose(
        parallel_determinant(workspace_pose(tilt, azimuth, phi)), 0.0, atol=1e-14)
    # Every change of sign on a finer, shifted grid has a point of the locus next to it.
    angles = np.radians(np.arange(0.25, 360.0, 1.0))
    grid = np.radians(np.linspace(0.2, 25.9, 300))
    values = parallel_determinant(workspace_pose(grid, angles[:, None], phi))
    with np.errstate(invalid='ignore'):
        rows, columns = np.nonzero(values[:, :-1] * values[:, 1:] < 0.0)
    points, changes = tilt * np.exp(1j * azimuth), grid[columns] * np.exp(1j * angles[rows])
    assert np.abs(points - changes[:, None]).min(axis=1).max() < math.radians(1.0)


def test_no_locus_far_from_the_singularity():
    tilt, azimuth = singularity_locus(0.0, math.radians(13.0))
    assert tilt.shape == azimuth.shape == (0,)
