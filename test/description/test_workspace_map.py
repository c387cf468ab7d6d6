# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The map of the workspace against the dexterity and the determinant of its poses."""

import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.description.workspace_map import colour_bar, HALF_ANGLE, WorkspaceMap

CENTRE = np.ones(3) / 3.0**0.5
# Colours of dexterity 0, 0.1, 0.2: dark red, amber, blue.
COLOURS = np.array(
    [
        (150, 0, 20),
        (225, 160, 30),
        (20, 95, 160),
    ]
)


def poses_of(axes, phi):
    """Return the poses of the cone with these platform axes."""
    across = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    along = np.array([1.0, 1.0, -2.0]) / np.sqrt(6.0)
    tilts = np.arccos(np.clip(axes @ CENTRE, -1.0, 1.0))
    azimuths = np.arctan2(axes @ along, axes @ across)
    return kinematics.workspace_pose(tilts, azimuths, phi)


# Self-rotations, one of them near the singularity at the centre, rad.
EACH_PHI = pytest.mark.parametrize('phi', np.radians([0.0, 45.0, 49.36, 60.0]))


@pytest.fixture(scope='module')
def drawn():
    """Return the map of the nominal mechanism."""
    return WorkspaceMap(kinematics.Geometry(), (1, 1, 1))


def test_its_tiles_are_evenly_over_the_cone(drawn):
    """As many of them within a part of it as its area has of the whole, none beside another."""
    tilts = np.arccos(drawn.axes @ CENTRE)
    assert tilts.max() < HALF_ANGLE
    area = 2.0 * np.pi * (1 - np.cos(HALF_ANGLE))
    inner_area = 2.0 * np.pi * (1 - np.cos(0.5 * HALF_ANGLE))
    inner_share = np.mean(tilts < 0.5 * HALF_ANGLE)
    assert inner_share == pytest.approx(inner_area / area, abs=0.01)
    between = drawn.axes - drawn.axes[:, None]
    apart = np.linalg.norm(between, axis=-1)
    np.fill_diagonal(apart, np.inf)
    assert apart.min() > 0.85 * np.sqrt(area / len(tilts))


def test_its_bar_names_the_colours():
    assert colour_bar() == {
        'colours': [f'rgb({r},{g},{b})' for r, g, b in COLOURS],
        'words': ['0: singular', '0.1', '0.2 and more'],
    }


@EACH_PHI
def test_a_tile_is_the_nearer_to_the_first_colour_the_nearer_it_is_to_a_singularity(drawn, phi):
    poses = poses_of(drawn.axes, phi)
    np.testing.assert_allclose(poses[..., 2], drawn.axes, atol=1e-12)
    eta = kinematics.dexterity(poses)
    reached = np.isfinite(eta)
    colours = drawn.colours(phi)
    grey = np.ptp(colours.astype(int), axis=1) == 0
    assert np.array_equal(grey, ~reached)
    for channel in range(3):
        expected = np.interp(eta[reached], [0.0, 0.1, 0.2], COLOURS[:, channel])
        np.testing.assert_allclose(colours[reached, channel], expected, atol=1.0)


@EACH_PHI
def test_its_singular_axes_are_singular_and_there_where_the_determinant_has_both_signs(drawn, phi):
    singular = drawn.singular_axes(phi)
    determinants = kinematics.parallel_determinant(poses_of(drawn.axes, phi))
    has_both_signs = np.nanmin(determinants) < 0.0 < np.nanmax(determinants)
    assert bool(len(singular)) == has_both_signs
    # 1e-3 is a twentieth of a degree here.
    there = kinematics.parallel_determinant(poses_of(singular, phi))
    assert np.abs(there).max(initial=0.0) < 2e-3
