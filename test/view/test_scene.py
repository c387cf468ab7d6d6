# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device on the page: each link where the angles of its joints put it, in its colour."""

from built_mechanism import random_built
import numpy as np
import pytest
from spm_haptic_master.description import solids
from spm_haptic_master.description.colours import css
from spm_haptic_master.kinematics import Geometry, mechanism_angles, workspace_pose
from spm_haptic_master.view.scene import GREY, SCALE, Scene

NOMINAL = Geometry()
ALPHA = NOMINAL.alphas[0]
MECHANISMS = {
    'nominal': NOMINAL, 'as built': random_built(np.random.default_rng(1), 0.5).geometry,
    'two of three proximal links of one shape': Geometry.from_axes(
        NOMINAL.base_axes, NOMINAL.platform_axes, (ALPHA, ALPHA + 0.01, ALPHA), NOMINAL.betas)}


def drawn(shown, geometry):
    """Draw an upright mechanism of four encoders."""
    return Scene(shown.server.scene, 0, geometry, (1, 1, 1), (0.0, 0.0, 0.0, 1.0), 4)


@pytest.mark.parametrize('name', MECHANISMS)
def test_each_link_has_its_own_turn_shape_and_colour(shown, name):
    geometry = MECHANISMS[name]
    scene, shapes, links = drawn(shown, geometry), solids.solids(geometry), []
    angles = mechanism_angles(tuple(workspace_pose(0.3, 1.0, 0.6).ravel()), geometry)
    scene.place(angles)
    *turns, platform = solids.link_turns(geometry, angles)
    # The page has turns in single precision.
    np.testing.assert_allclose(np.roll(scene._frame.wxyz, -1), platform, atol=1e-6)
    for batch, handle in scene._batches:
        links += batch
        np.testing.assert_allclose(
            np.roll(handle.batched_wxyzs, -1, axis=1), [turns[k] for k in batch], atol=1e-6)
        for k in batch:
            shape = shapes[f'{("proximal", "distal")[k // 3]}_{solids.LEGS[k % 3]}']
            np.testing.assert_allclose(handle.vertices, shape.vertices * SCALE, atol=1e-6)
        for alive in (True, False):
            scene.set_alive(alive)
            assert [f'#{bytes(colour.tolist()).hex()}' for colour in handle.batched_colors] == [
                css(f'leg_{solids.LEGS[k % 3]}') if alive else GREY for k in batch]
    assert sorted(links) == list(range(6))


def test_every_surface_is_seen_from_outside(shown):
    """Each has one side."""
    scene = drawn(shown, NOMINAL)
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
