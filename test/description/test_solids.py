# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The solids of the links: closed, outside outwards, and apart from each other."""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
from spm_haptic_master.description.links import (
    DISTAL_AT_3,
    PLATFORM_AT_3,
    SIZE,
    solids,
)
from spm_haptic_master.kinematics import Geometry, mechanism_angles, workspace_pose
from spm_haptic_master.kinematics.rotations import zxz_rotation

# Largest edge of the triangles that a surface is divided into (m). Any point of the surface is
# within the edge over the root of 3 of a corner: two surfaces that meet have corners within NEAR.
EDGE = 0.0012
NEAR = 2.0 * EDGE / 3.0 ** 0.5
LEGS = 'abc'


@pytest.mark.parametrize(('name', 'solid'), solids(Geometry()).items())
def test_a_solid_is_closed_and_its_outside_is_out(name, solid):
    edges = Counter((int(a), int(b)) for triangle in solid.triangles
                    for a, b in zip(triangle, np.roll(triangle, -1), strict=True))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    # Each part of it has a positive volume: none is inside out.
    for part in parts(solid):
        a, b, c = np.moveaxis(solid.vertices[part], 1, 0)
        assert np.sum(a * np.cross(b, c)) > 0.0


def parts(solid):
    """Return the triangles of each connected part."""
    root = np.arange(len(solid.vertices))
    for _ in range(len(root)):
        least = root[solid.triangles].min(axis=1)
        new = root.copy()
        for corner in range(3):
            np.minimum.at(new, solid.triangles[:, corner], least)
        if np.array_equal(new, root):
            break
        root = new
    labels = root[solid.triangles[:, 0]]
    return [solid.triangles[labels == label] for label in np.unique(labels)]


def rotation(*angles):
    return np.array(zxz_rotation(*angles)).reshape(3, 3)


def frames(geometry, pose):
    """Return the rotation of each link's frame in the base, by name, at a pose (3, 3)."""
    angles = mechanism_angles(tuple(pose.ravel()), geometry)
    found = {'base': np.eye(3), 'platform': pose}
    for k, leg in enumerate(LEGS):
        first, second, _ = angles[3 * k:3 * k + 3]
        frame = np.array(geometry.legs[k].base_frame).reshape(3, 3) @ rotation(first, 0.0, 0.0)
        found[f'proximal_{leg}'] = frame
        found[f'distal_{leg}'] = frame @ rotation(0.0, geometry.alphas[k], second)
    return found


def sampled(solid, frame):
    """Return points on a solid in its place, the corners of small triangles, (n, 3)."""
    corners = solid.vertices[solid.triangles] @ frame.T
    edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=-1).max(axis=1)
    steps = np.ceil(edges / EDGE).astype(int)
    found = []
    for count in np.unique(steps):
        i, j = (each.ravel() for each in np.mgrid[0:count + 1, 0:count + 1])
        inside = i + j <= count
        u, v = i[inside, None] / count, j[inside, None] / count
        a, b, c = (each[:, None] for each in np.moveaxis(corners[steps == count], 1, 0))
        found.append((a + u * (b - a) + v * (c - a)).reshape(-1, 3))
    return np.concatenate(found)


def beside(points, others):
    """Return the points with one of the others in their cell of a grid or next to it."""
    weights = np.array([1 << 24, 1 << 12, 1])
    taken = np.unique(np.floor(others / NEAR).astype(np.int64) @ weights)
    around = np.array(list(np.ndindex(3, 3, 3))) - 1
    cells = np.floor(points / NEAR).astype(np.int64) @ weights
    return points[np.isin(cells, np.unique(taken[:, None] + around @ weights))]


def touch(one, other):
    """Return whether two surfaces may meet, by points on them."""
    one = beside(one, other)
    other = beside(other, one)
    return any(np.min(np.sum((other - point) ** 2, axis=-1)) < NEAR ** 2 for point in one)


@pytest.mark.parametrize(('tilt', 'phi'), [(0.0, 0.0), (0.0, 25.0), (0.0, 49.36)])
def test_no_two_links_touch_at_the_centre(tilt, phi):
    geometry = Geometry()
    pose = workspace_pose(np.radians(tilt), 0.0, np.radians(phi))
    places = frames(geometry, pose)
    points = {name: sampled(solid, places[name]) for name, solid in solids(geometry).items()}
    assert [pair for pair in combinations(points, 2)
            if touch(points[pair[0]], points[pair[1]])] == []
    # Moved inwards by more than the gap at its joint, the distal link does touch the platform.
    gap = SIZE * (DISTAL_AT_3[0] - PLATFORM_AT_3[1])
    axis = pose @ np.array(geometry.platform_axes[0])
    assert touch(points['distal_a'] - 1.2 * gap * axis, points['platform'])
