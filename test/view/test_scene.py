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

pytest.importorskip('viser', reason='viser is not installed (extra view)')
scene_module = pytest.importorskip('spm_haptic_master.view.scene')

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
        scenes.append(scene_module.Scene(serve(), 0, geometry, (1, 1, 1), UPRIGHT, 4))
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
                handle.vertices, shapes[f'{kind}_{leg}'].vertices * scene_module.SCALE, atol=1e-6)
            expected = css(f'leg_{leg}') if alive else scene_module.GREY
            assert f'#{bytes(handle.batched_colors[row].tolist()).hex()}' == expected


def volume(handle):
    corners = handle.vertices.astype(float)[handle.faces]
    return np.linalg.det(corners).sum() / 6.0


def test_every_surface_is_seen_from_outside_and_turns_grey(draw):
    """Each has one side; base, three kinds of links and axes turn grey, encoders have a state."""
    scene = draw(NOMINAL)
    handles = [handle for handle, _ in scene._coloured]
    assert len(handles) == 5
    assert all(volume(handle) > 0.0 for handle in [
        *handles, scene.dome.pin, scene._motors, scene._others, scene.ghost,
        *scene.torques])
    for alive in (True, False):
        scene.set_alive(alive)
        for handle, colours in scene._coloured:
            grey = scene_module.rgb([scene_module.GREY] * len(colours))
            expected = colours if alive else grey
            np.testing.assert_array_equal(handle.batched_colors, expected)
    square = scene_module.surfaces.polygon(1.0, 4)
    np.testing.assert_allclose(
        square.vertices, [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], atol=1e-9)
    assert square.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    # What is seen from both sides has its inner one first: the far wall of a cone.
    cone = scene.level
    inner, outer = np.split(cone.faces, 2)
    for faces, sign in ((inner, -1.0), (outer, 1.0)):
        corners = cone.vertices.astype(float)[faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        away = corners.mean(axis=1) * (1.0, 1.0, 0.0)
        assert (sign * (across * away).sum(axis=1) > 0.0).all()


def reach(handle):
    """Return the largest distance from O of what a handle draws."""
    return np.linalg.norm(handle.vertices.astype(float), axis=1).max()


def test_every_part_has_its_place_and_nothing_hides_another(draw):
    """From the inside out: device, names, dome; below it all a floor."""
    scene = draw(NOMINAL)
    texts = {label.text: label for label in scene.labels}
    assert set(texts) == {'th1A', 'th1B', 'th1C', 'A', 'B', 'C', 'th3A', 'handle', 'O'}

    def beyond(inner, text):
        """Return how much farther out a name is than something within it."""
        return np.linalg.norm(texts[text].position) - inner

    for leg, axis in zip('ABC', NOMINAL.base_axes, strict=True):
        assert 0.05 < beyond(reach(scene._motors), f'th1{leg}') < 0.2
        assert 0.1 < beyond(np.linalg.norm(texts[f'th1{leg}'].position), leg) < 0.3
        for text in (f'th1{leg}', leg):
            place = texts[text].position / np.linalg.norm(texts[text].position)
            np.testing.assert_allclose(place, axis, atol=1e-6)
    assert 0.05 < beyond(reach(scene._others), 'th3A') < 0.2
    platform = dict(zip(('base', 'proximal', 'distal', 'platform', 'axes'),
                        (handle for handle, _ in scene._coloured), strict=True))['platform']
    top = platform.vertices[:, 2].max()
    assert top < texts['handle'].position[2] < scene_module.RADIUS < 1.2 * top
    # A thin pointer from the handle along the platform's x.
    pointer = platform.vertices[platform.vertices[:, 0] > 0.79]
    assert np.ptp(pointer, axis=0).max() < 0.04 and 0.75 < pointer[:, 0].max() < 0.85
    assert 0.9 < pointer[:, 2].mean() < 1.05 and abs(pointer[:, 1].mean()) < 1e-6
    # What three encoders report is the platform, just outside it.
    ratio = scene.ghost.vertices[:, 2].max() / top
    assert 1.005 < ratio < 1.02
    assert all(0.1 < each.opacity < 0.9 for each in (scene.ghost, scene.level, scene.dome.tiles))
    # The tiles cover the cone about once; the dots on it are smaller than a tile.
    corners = scene.dome.tiles.vertices.astype(float)[np.split(scene.dome.tiles.faces, 2)[1]]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0],
                                         corners[:, 2] - corners[:, 0]), axis=1).sum()
    places = scene.dome.tiles.batched_positions
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), scene_module.RADIUS, atol=1e-6)
    cap = 2.0 * np.pi * scene_module.RADIUS ** 2 * (1.0 - np.cos(np.radians(26.0)))
    assert 0.95 < len(places) * area / cap < 1.12
    rim = scene.dome.rim.points.reshape(-1, 3)
    np.testing.assert_allclose(rim @ np.ones(3) / 3.0 ** 0.5 / scene_module.RADIUS,
                               np.cos(np.radians(26.0)), atol=1e-6)
    np.testing.assert_allclose(rim[0], rim[-1], atol=1e-6)
    assert 0.01 < scene.dome.singular.point_size < reach(scene.dome.tiles)
    assert reach(scene.dome.pin) == pytest.approx(0.03, abs=0.01)
    # Cone and arrows begin at O; the cone ends at the dome.
    assert scene.level.vertices[:, 2].max() == pytest.approx(scene_module.RADIUS)
    assert not scene.level.vertices[0].any()
    for arrow in scene.torques:
        assert (arrow.vertices[:, 2].min(), arrow.vertices[:, 2].max()) == (0.0, 1.0)
    # The floor is below the device, and two devices with their floors are apart.
    floor = scene._floor
    assert -0.1 < floor.batched_positions[0, 2] < 0.0 and not floor.vertices[:, 2].any()
    assert 1.0 < reach(floor) < 0.5 * scene_module.ARM_DISTANCE
    axes = scene._coloured[-1][0]
    assert 0.3 < reach(axes) < 0.6 and np.abs(axes.vertices[:, :2]).max() < 0.02
    np.testing.assert_allclose(
        [matrix_from_quaternion(np.roll(each, -1))[:, 2] for each in axes.batched_wxyzs],
        np.eye(3), atol=1e-6)
