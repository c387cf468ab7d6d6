# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device on the page: each link where the angles of its joints put it, in its colour."""

from math import cos, radians, sin

import numpy as np
import pytest
from spm_haptic_master.description import solids
from spm_haptic_master.description.colours import css
from spm_haptic_master.kinematics import Geometry, mechanism_angles, workspace_pose
from spm_haptic_master.view.scene import ARM_DISTANCE, SCALE, Scene
from spm_haptic_master.view.status import SensorState
from spm_haptic_master.view.surfaces import GREY

NOMINAL = Geometry()
ALPHA = NOMINAL.alphas[0]
# Two proximal links of three are of one shape, and all distal ones.
MECHANISM = Geometry.from_axes(
    NOMINAL.base_axes,
    NOMINAL.platform_axes,
    (ALPHA, ALPHA + 0.01, ALPHA),
    NOMINAL.betas,
)


def drawn(shown):
    """Draw the mechanism, upright, with four encoders."""
    return Scene(
        shown.server.scene,
        '',
        MECHANISM,
        (1, 1, 1),
        (0.0, 0.0, 0.0, 1.0),
        4,
    )


def test_each_link_has_its_own_turn_shape_and_colour(shown):
    scene = drawn(shown)
    shapes = solids.solids(MECHANISM)
    links = []
    angles = mechanism_angles(tuple(workspace_pose(0.3, 1.0, 0.6).ravel()), MECHANISM)
    scene.place(angles)
    *turns, platform = solids.link_turns(MECHANISM, angles)
    # The page has turns in single precision.
    np.testing.assert_allclose(np.roll(scene._turned.wxyz, -1), platform, atol=1e-6)
    for batch, handle in scene._batches:
        links += batch
        np.testing.assert_allclose(
            np.roll(handle.batched_wxyzs, -1, axis=1),
            [turns[k] for k in batch],
            atol=1e-6,
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
        scene.ghost.platform,
        *scene.torques,
    ):
        assert np.linalg.det(handle.vertices.astype(float)[handle.faces]).sum() > 0.0


def about_z(degrees):
    """Return the quaternion of a turn about z."""
    half = radians(0.5 * degrees)
    return (0.0, 0.0, sin(half), cos(half))


def parts_shown(ghost):
    """Return whether each part that shows three encoders alone is visible."""
    return [
        ghost.platform.visible,
        ghost.sector.visible,
        ghost.words.visible,
    ]


@pytest.mark.parametrize('angle', [-14.0, 1.1, 90.0, 179.0])
def test_three_encoders_that_are_wrong_have_a_sector_between_the_two_flags(shown, angle):
    """From the device's flag to theirs, with the error in words; below 1 deg there is nothing."""
    ghost = drawn(shown).ghost
    ghost.show(about_z(angle))
    assert parts_shown(ghost) == [True, True, True]
    assert ghost.words.text == f'three encoders: {abs(angle):.0f}\u00b0 off'
    rim = ghost.sector.vertices[1:].astype(float) - ghost.sector.vertices[0]
    directions = np.degrees(np.arctan2(rim[:, 1], rim[:, 0]))
    assert directions[[0, -1]] == pytest.approx([0.0, angle], abs=1e-3)
    assert np.abs(np.diff(directions)).max() < 10.0
    for turn in (about_z(0.9), None):
        ghost.show(turn)
        assert parts_shown(ghost) == [False, False, False]


def test_each_encoder_has_its_sign_at_its_name_where_something_is_wrong(shown):
    scene = drawn(shown)
    state = SensorState
    scene.show_sensors([state.HEALTHY, state.MISSING, state.UNCHECKED, state.EXCLUDED])
    assert [label.text for label in scene._sensor_labels] == [
        'th1A',
        'th1B \u2205',
        'th1C ?',
        'th3A \u2715',
    ]


def test_a_device_with_a_name_has_it_at_its_floor_and_stands_at_its_place(shown):
    scene = Scene(
        shown.server.scene,
        'left',
        NOMINAL,
        (1, 1, 1),
        (0.0, 0.0, 0.0, 1.0),
        4,
    )
    scene.stand(2)
    for frame in (scene._fixed, scene._floor):
        np.testing.assert_allclose(frame.position, [2.0 * ARM_DISTANCE, 0.0, 0.0])
    name = shown.server.scene._handle_from_node_name[f'{scene._floor.name}/name']
    assert name.text == 'left'
