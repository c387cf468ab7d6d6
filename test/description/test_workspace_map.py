# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The map of the workspace against the dexterity and the determinant of its poses."""

from math import radians

import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.description.workspace_map import colour_bar, HALF_ANGLE, WorkspaceMap

CENTRE = np.ones(3) / 3.0**0.5
# Colours of dexterity 0, 0.1, 0.2: dark red, amber, blue.
COLOURS = np.array([(150, 0, 20), (225, 160, 30), (20, 95, 160)])


def poses_of(axes, phi):
    """Return the poses of the cone with these platform axes."""
    across, along = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]) / [[2.0**0.5], [6.0**0.5]]
    tilts = np.arccos(np.clip(axes @ CENTRE, -1.0, 1.0))
    return kinematics.workspace_pose(tilts, np.arctan2(axes @ along, axes @ across), phi)


@pytest.mark.parametrize('phi', [0.0, 45.0, 49.36, 60.0])
def test_the_map_has_the_dexterity_and_the_singularities(phi):
    phi = radians(phi)
    drawn = WorkspaceMap(kinematics.Geometry(), (1, 1, 1))
    tilts = np.arccos(drawn.axes @ CENTRE)
    assert tilts.max() < HALF_ANGLE
    # Evenly over the cone: as many tiles within a part of it as its area has of the whole.
    assert np.mean(tilts < 0.5 * HALF_ANGLE) == pytest.approx(
        (1 - np.cos(0.5 * HALF_ANGLE)) / (1 - np.cos(HALF_ANGLE)), abs=0.01
    )
    apart = np.linalg.norm(drawn.axes - drawn.axes[:, None], axis=-1) + 9.0 * np.eye(len(tilts))
    assert apart.min() > 0.85 * np.sqrt(2.0 * np.pi * (1 - np.cos(HALF_ANGLE)) / len(tilts))
    poses = poses_of(drawn.axes, phi)
    colours = drawn.colours(phi)
    np.testing.assert_allclose(poses[..., 2], drawn.axes, atol=1e-12)
    eta = kinematics.dexterity(poses)
    assert colour_bar() == {
        'colours': [f'rgb({r},{g},{b})' for r, g, b in COLOURS],
        'words': ['0: singular', '0.1', '0.2 and more'],
    }
    # The nearer to a singularity, the nearer to the first colour.
    grey = np.ptp(colours.astype(int), axis=1) == 0
    assert np.array_equal(grey, np.isnan(eta))
    expected = [np.interp(eta, [0.0, 0.1, 0.2], channel) for channel in COLOURS.T]
    reached = np.isfinite(eta)
    np.testing.assert_allclose(colours[reached], np.transpose(expected)[reached], atol=1.0)
    singular = drawn.singular_axes(phi)
    determinants = kinematics.parallel_determinant(poses)
    assert bool(len(singular)) == (np.nanmin(determinants) < 0.0 < np.nanmax(determinants))
    # 1e-3 is a twentieth of a degree here.
    assert np.abs(kinematics.parallel_determinant(poses_of(singular, phi))).max(initial=0.0) < 2e-3
