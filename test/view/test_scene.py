# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device on the page: each link where the angles of its joints put it, in its colour."""

from built_mechanism import random_built
from mechanism import about_x
import numpy as np
import pytest
from spm_haptic_master.description.colours import css
from spm_haptic_master.description.solids import LEGS, solids
from spm_haptic_master.kinematics import (
    Geometry,
    inverse,
    matrix_from_quaternion,
    mechanism_angles,
    workspace_pose,
)
from spm_haptic_master.view.scene import GREY, SCALE, Scene

# Largest error of what is drawn (unit of the scene): the page has turns in single precision.
BOUND = 1e-6
NOMINAL = Geometry()
ALPHA = NOMINAL.alphas[0]
MECHANISMS = {
    'nominal': NOMINAL, 'as built': random_built(np.random.default_rng(1), 0.5).geometry,
    'two of three proximal links of one shape': Geometry.from_axes(
        NOMINAL.base_axes, NOMINAL.platform_axes, (ALPHA, ALPHA + 0.01, ALPHA), NOMINAL.betas)}
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def draw(serve):
    """Draw a mechanism, until the test's end."""
    scenes = []

    def draw(geometry):
        scenes.append(Scene(serve().scene, 0, geometry, (1, 1, 1), UPRIGHT, 4))
        return scenes[-1]

    yield draw
    for scene in scenes:
        scene.remove()


def poses(geometry):
    rng = np.random.default_rng(3)
    drawn = workspace_pose(np.radians(rng.uniform(0.0, 25.0, 60)), rng.uniform(0.0, 6.0, 60),
                           np.radians(rng.uniform(-20.0, 70.0, 60)))
    reached = drawn[~np.isnan(inverse(drawn, geometry).theta3a)]
    assert len(reached) >= 30
    return reached


def drawn_links(scene):
    """Return the rotation matrix of each link that is drawn, and its batch's handle and row."""
    found = {}
    for links, handle in scene._batches:
        for row, (link, wxyz) in enumerate(zip(links, handle.batched_wxyzs, strict=True)):
            found[link] = matrix_from_quaternion(np.roll(wxyz.astype(float), -1)), handle, row
    return found


@pytest.mark.parametrize('name', MECHANISMS)
def test_each_link_joins_its_neighbours_with_its_own_shape_and_colour(draw, name):
    geometry = MECHANISMS[name]
    scene = draw(geometry)
    z, worst = np.array([0.0, 0.0, 1.0]), 0.0
    for R in poses(geometry):
        scene.place(mechanism_angles(tuple(R.ravel()), geometry))
        platform = matrix_from_quaternion(np.roll(scene._frame.wxyz, -1))
        worst = max(worst, np.abs(platform - R).max())
        found = drawn_links(scene)
        assert sorted(found) == list(range(6))
        for k in range(3):
            proximal, distal = found[k][0], found[3 + k][0]
            for one, other in (
                    (proximal @ z, geometry.base_axes[k]),
                    (proximal @ about_x(geometry.alphas[k]) @ z, distal @ z),
                    (distal @ about_x(geometry.betas[k]) @ z, R @ geometry.platform_axes[k])):
                worst = max(worst, np.abs(one - other).max())
    assert worst < BOUND
    shapes = solids(geometry)
    for alive in (True, False):
        scene.set_alive(alive)
        for link, (_, handle, row) in drawn_links(scene).items():
            kind, leg = ('proximal', 'distal')[link // 3], LEGS[link % 3]
            np.testing.assert_allclose(
                handle.vertices, shapes[f'{kind}_{leg}'].vertices * SCALE, atol=1e-6)
            expected = css(f'leg_{leg}') if alive else GREY
            assert f'#{bytes(handle.batched_colors[row].tolist()).hex()}' == expected


def test_every_surface_is_seen_from_outside(draw):
    """Each has one side."""
    scene = draw(NOMINAL)
    for handle in (*(handle for handle, _ in scene._coloured), scene.dome.pin, scene._motors,
                   scene._others, scene.ghost, *scene.torques):
        assert np.linalg.det(handle.vertices.astype(float)[handle.faces]).sum() > 0.0
    # What is seen from both sides has its inner one first: the far wall of a cone.
    cone = scene.level
    for faces, sign in zip(np.split(cone.faces, 2), (-1.0, 1.0), strict=True):
        corners = cone.vertices.astype(float)[faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        away = corners.mean(axis=1) * (1.0, 1.0, 0.0)
        assert (sign * (across * away).sum(axis=1) > 0.0).all()
