# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The solids of the links: closed, outside outwards, with mass and inertia of what they fill."""

from collections import Counter
from math import cos, pi, sin

from built_mechanism import random_built
from mechanism import about_x, turn
import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.description import solids

MECHANISMS = [kinematics.Geometry(), random_built(np.random.default_rng(1), 0.5).geometry]
# Corners of a turned solid.
CORNERS = 24


def volumes(solid):
    """Return the volume of each connected part by the flux of x through its surface (Gauss)."""
    root = np.arange(len(solid.vertices))
    for _ in root:
        least = root[solid.triangles].min(axis=1)
        new = root.copy()
        for corner in range(3):
            np.minimum.at(new, solid.triangles[:, corner], least)
        if np.array_equal(new, root):
            break
        root = new
    a, b, c = np.moveaxis(solid.vertices[solid.triangles], 1, 0)
    flux = (a + b + c)[:, 0] / 6.0 * np.cross(b - a, c - a)[:, 0]
    return np.bincount(root[solid.triangles[:, 0]], flux)[np.unique(root)]


@pytest.mark.parametrize('geometry', MECHANISMS)
def test_every_part_of_a_link_is_closed_and_filled_with_its_mass(geometry):
    bodies = solids.masses(geometry)
    bodies['platform'] = bodies['spm_platform']
    for name, solid in solids.solids(geometry).items():
        check_closed(solid)
        # None is inside out.
        parts = volumes(solid)
        assert (parts > 0.0).all()
        if name != 'base':
            assert bodies[name].mass == pytest.approx(solids.DENSITY * parts.sum(), rel=1e-9)
            assert 0.001 < bodies[name].mass < 0.1


def check_closed(solid):
    """Check that each edge of a surface is passed once in each sense."""
    edges = Counter()
    for a, b, c in solid.triangles.tolist():
        edges.update([(a, b), (b, c), (c, a)])
    assert set(edges.values()) == {1}
    backwards = {(b, a) for a, b in edges}
    assert backwards == edges.keys()


@pytest.mark.parametrize('geometry', MECHANISMS)
def test_the_inertia_of_every_body_is_one_that_a_body_can_have(geometry):
    """Positive definite, and no moment exceeds the sum of the two others."""
    bodies = solids.masses(geometry)
    moving = {'spm_platform', *solids.solids(geometry)} - {'base', 'platform'}
    carriers = {f'carrier_{leg}' for leg in solids.LEGS}
    assert set(bodies) == moving | carriers
    for body in bodies.values():
        moments = np.linalg.eigvalsh(body.inertia)
        assert moments[0] > 0.0
        assert moments[2] < moments[0] + moments[1]


@pytest.mark.parametrize('geometry', MECHANISMS)
def test_each_link_is_turned_so_that_it_joins_its_neighbours(geometry):
    z = np.array([0.0, 0.0, 1.0])
    for pose in ((0.0, 0.0, 0.0), (0.3, 1.0, 0.9), (0.2, 4.0, -0.3)):
        R = kinematics.workspace_pose(*pose)
        *links, platform = map(
            kinematics.matrix_from_quaternion,
            solids.link_turns(geometry, kinematics.mechanism_angles(tuple(R.ravel()), geometry)),
        )
        np.testing.assert_allclose(platform, R, atol=1e-12)
        for k, (proximal, distal) in enumerate(zip(links[:3], links[3:], strict=True)):
            for one, other in (
                (proximal @ z, geometry.base_axes[k]),
                (proximal @ about_x(geometry.alphas[k]) @ z, distal @ z),
                (distal @ about_x(geometry.betas[k]) @ z, R @ geometry.platform_axes[k]),
            ):
                np.testing.assert_allclose(one, other, atol=1e-12)


def test_a_prism_has_its_mass_centre_and_inertia_wherever_it_is():
    """An upright regular polygon of radius 0.02 m from 0.03 to 0.08 m, by its formulas."""
    prism = solids.turned_profile([(0.02, 0.03), (0.02, 0.08)])
    mass = 1000.0 * 0.05 * 0.5 * CORNERS * 0.02**2 * sin(2.0 * pi / CORNERS)
    polar = mass * 0.02**2 / 6.0 * (2.0 + cos(2.0 * pi / CORNERS))
    across = 0.5 * polar + mass * 0.05**2 / 12.0
    for rotation, place in (
        (np.eye(3), np.zeros(3)),
        (turn([0.3, -0.8, 0.5]), np.array([0.3, -0.2, 0.1])),
    ):
        moved = solids.Solid(prism.turned(rotation).vertices + place, prism.triangles)
        body = moved.mass_properties(1000.0)
        assert body.mass == pytest.approx(mass, rel=1e-12)
        assert body.centre == pytest.approx(rotation @ [0.0, 0.0, 0.055] + place, abs=1e-12)
        np.testing.assert_allclose(
            body.inertia, rotation @ np.diag([across, across, polar]) @ rotation.T, atol=1e-12
        )


def test_a_leg_on_the_axis_of_the_handle_needs_no_bar():
    """One of no length has neither a direction nor normals."""
    drawn, _ = MECHANISMS
    ends = [(0.0, 0.0, 1.0), *drawn.platform_axes[1:]]
    platform = solids.solids(
        kinematics.Geometry.from_axes(drawn.base_axes, ends, drawn.alphas, drawn.betas)
    )['platform']
    facets = np.frombuffer(platform.stl('platform'), '12<f4, <u2', offset=84)
    assert np.isfinite(facets['f0']).all()
