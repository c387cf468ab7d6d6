# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device on the page: each link where the angles of its joints put it, in its colour."""

import numpy as np
from spm_haptic_master.description import solids
from spm_haptic_master.description.colours import css
from spm_haptic_master.kinematics import Geometry, mechanism_angles, workspace_pose
from spm_haptic_master.view.scene import GREY, SCALE, Scene

NOMINAL = Geometry()
ALPHA = NOMINAL.alphas[0]
# Two proximal links of three are of one shape, and all distal ones.
MECHANISM = Geometry.from_axes(
    NOMINAL.base_axes, NOMINAL.platform_axes, (ALPHA, ALPHA + 0.01, ALPHA), NOMINAL.betas
)


def drawn(shown):
    """Draw the mechanism, upright, with four encoders."""
    return Scene(shown.server.scene, 0, MECHANISM, (1, 1, 1), (0.0, 0.0, 0.0, 1.0), 4)


def test_each_link_has_its_own_turn_shape_and_colour(shown):
    scene, shapes, links = drawn(shown), solids.solids(MECHANISM), []
    angles = mechanism_angles(tuple(workspace_pose(0.3, 1.0, 0.6).ravel()), MECHANISM)
    scene.place(angles)
    *turns, platform = solids.link_turns(MECHANISM, angles)
    # The page has turns in single precision.
    np.testing.assert_allclose(np.roll(scene._frame.wxyz, -1), platform, atol=1e-6)
    for batch, handle in scene._batches:
        links += batch
        np.testing.assert_allclose(
            np.roll(handle.batched_wxyzs, -1, axis=1), [turns[k] for k in batch], atol=1e-6
        )
        for k in batch:
            shape = shapes[f'{("proximal", "distal")[k // 3]}_{solids.LEGS[k % 3]}']
            np.testing.assert_allclose(handle.vertices, shape.vertices * SCALE, atol=1e-6)
        for alive in (True, False):
            scene.set_alive(alive)
            assert [f'#{bytes(colour.tolist()).hex()}' for colour in handle.batched_colors] == [
                css(f'leg_{solids.LEGS[k % 3]}') if alive else GREY for k in batch
            ]
    assert sorted(links) == list(range(6))


def test_every_surface_is_seen_from_outside(shown):
    """Each has one side."""
    scene = drawn(shown)
    for handle in (
        *(handle for handle, _ in scene._coloured),
        scene.dome.pin,
        scene._motors,
        scene._others,
        scene.ghost,
        *scene.torques,
    ):
        assert np.linalg.det(handle.vertices.astype(float)[handle.faces]).sum() > 0.0
