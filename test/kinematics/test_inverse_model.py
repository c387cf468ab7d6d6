# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Inverse model beside independent ones, Jacobians beside differences, workspace."""

from contextlib import nullcontext
import math

from built_mechanism import nominal, random_built, random_nominal
from mechanism import CENTRE, MODES, random_rotations, turn, zxz
import numpy as np
import pytest
from readings import differences, near_boundary, PAPER
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.rotations import matrix_from_vector
from spm_haptic_master.kinematics.workspace import (
    approach,
    changes_of_sign,
    determinant_gradient,
    nearness,
)

PHI = math.radians(50.0)


def test_unreachable_is_exactly_what_the_links_cannot_span():
    rng = np.random.default_rng(3)
    mechanisms = [nominal()]
    mechanisms += [random_nominal(rng) for _ in range(4)]
    for built in mechanisms:
        R = random_rotations(rng, 300).reshape(20, 15, 3, 3)
        g = built.geometry
        joints = kinematics.inverse(R, g)
        expected = built.margins(R).min(-1) >= 0.0
        assert joints.theta1.shape == (20, 15, 3)
        assert 0 < expected.sum() < 300
        for values in (
            *np.moveaxis(joints.theta1, -1, 0),
            joints.theta2a,
            joints.theta3a,
            joints.theta3b,
            joints.theta3c,
        ):
            np.testing.assert_array_equal(np.isfinite(values), expected)
        for function in (kinematics.dexterity, kinematics.parallel_determinant):
            np.testing.assert_array_equal(np.isfinite(function(R, g)), expected)
        for matrix, is_reached in zip(R[0], expected[0], strict=True):
            for one in (
                kinematics.inverse,
                kinematics.jacobian,
                lambda R, g: kinematics.mechanism_angles(tuple(R.ravel()), g),
            ):
                with (
                    nullcontext()
                    if is_reached
                    else pytest.raises(UnreachableError, match='no configuration')
                ):
                    one(matrix, g)


def quaternion(R):
    """Return the quaternion of a rotation, as a tuple."""
    return tuple(kinematics.quaternion_from_matrix(R).tolist())


def dexterity_of(rows):
    """Return the dexterity of rows of a Jacobian: smallest over largest singular value."""
    values = np.linalg.svd(rows, compute_uv=False)
    return pytest.approx(values[2] / values[0], rel=1e-5, abs=1e-8)


@pytest.mark.parametrize('mode', MODES)
def test_jacobians_are_finite_differences(mode):
    rng = np.random.default_rng(302)
    for trial in range(4):
        built = random_built(rng)
        g = built.geometry if trial % 2 else PAPER
        R = built.reachable_rotation(rng, slack=0.15)
        expected = differences(R, g, mode)
        for sensors in (3, 4, 5, 6):
            G = kinematics.jacobian(R, g, mode, sensors)
            rows = expected[:sensors]
            tolerance = 1e-6 * np.abs(expected).max()
            np.testing.assert_allclose(G, rows, rtol=1e-6, atol=tolerance)
            left_out = range(sensors)[3:4]
            in_use = np.delete(rows, left_out, axis=0)
            near = nearness(quaternion(R), g, mode, sensors, left_out)
            assert near.every == dexterity_of(rows)
            assert near.three == dexterity_of(rows[:3])
            assert near.in_use == dexterity_of(in_use)
            assert kinematics.dexterity(R, g, mode, sensors) == dexterity_of(rows)


def test_power_balance():
    """
    A distal link transmits nothing to the platform but a moment about Z2k x Z3k.

    It is in equilibrium with the motor's torque about Z1k: tau . thetadot = m . omega.
    """
    rng = np.random.default_rng(40)
    for mode in MODES:
        built = random_built(rng)
        R = built.reachable_rotation(rng)
        th1 = kinematics.inverse(R, built.geometry, mode).theta1
        moments, omega = rng.normal(size=(2, 3))
        rows = np.cross(built.second_axes(th1), built.third_axes(R))
        tau = moments * (rows * built.base).sum(-1)
        motor_speeds = kinematics.jacobian(R, built.geometry, mode) @ omega
        power = tau @ motor_speeds
        assert power == pytest.approx(moments @ rows @ omega, abs=1e-9)
        determinant = kinematics.parallel_determinant(R, built.geometry, mode)
        assert determinant == pytest.approx(np.linalg.det(rows), abs=1e-14)


@pytest.mark.parametrize('leg', range(3))
@pytest.mark.parametrize('size, inside', [(1.5e-6, True), (0.7e-6, False)])
def test_up_to_the_boundary_of_a_working_mode(leg, size, inside):
    R = near_boundary(leg, size)
    rows = kinematics.jacobian(np.array([R]))[0]
    if inside:
        assert np.abs(kinematics.jacobian(R)[leg]).max() > 1e4
        assert np.isfinite(rows).all()
    else:
        with pytest.raises(SingularityError, match='boundary'):
            kinematics.jacobian(R)
        with pytest.raises(SingularityError, match='boundary'):
            nearness(quaternion(R), PAPER, MODES[0])
        assert np.isnan(rows).all()


def approach_at(degrees):
    R = zxz(*np.radians(degrees))
    return R, approach(quaternion(R), PAPER, MODES[0])


@pytest.mark.parametrize(
    'degrees',
    [
        (135.0, 54.7356, 49.0),
        (125.0, 50.0, 45.0),
        (140.0, 60.0, 52.0),
    ],
)
def test_approach_ends_on_the_singular_surface_and_nothing_is_nearer(degrees):
    rotation, got = approach_at(degrees)
    assert np.linalg.norm(got.axis) == pytest.approx(1.0, abs=1e-12)
    here = kinematics.parallel_determinant(rotation)
    to_surface = got.distance * np.array(got.axis)
    there = kinematics.parallel_determinant(turn(to_surface) @ rotation)
    beyond = kinematics.parallel_determinant(turn(1.001 * to_surface) @ rotation)
    assert abs(there) < 1e-6 * abs(here)
    assert beyond * here < 0.0
    # Neither along random directions nor just beside the one that was found.
    rng = np.random.default_rng(53)
    anywhere = rng.normal(size=(200, 3))
    beside = got.axis + 0.1 * rng.normal(size=(100, 3))
    directions = np.concatenate([anywhere, beside])
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    for part in (0.5, 0.999):
        turns = matrix_from_vector(part * got.distance * directions)
        determinants = kinematics.parallel_determinant(turns @ rotation)
        assert (determinants * here > 0.0).all()


def test_the_determinants_gradient_is_a_finite_difference():
    rng = np.random.default_rng(189)
    for trial in range(20):
        built = random_built(rng)
        mode = MODES[trial % 8]
        g = built.geometry
        R = built.reachable_rotation(rng, slack=0.1)
        value, gradient = determinant_gradient(tuple(R.ravel().tolist()), g, mode)
        assert value == pytest.approx(kinematics.parallel_determinant(R, g, mode), abs=1e-12)
        expected = []
        for axis in np.eye(3):
            ahead = kinematics.parallel_determinant(turn(1e-5 * axis) @ R, g, mode)
            behind = kinematics.parallel_determinant(turn(-1e-5 * axis) @ R, g, mode)
            expected.append((ahead - behind) / 2e-5)
        np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6)


def test_nothing_out_of_reach_and_where_there_is_no_singularity():
    out, found = approach_at((0.0, 170.0, 0.0))
    assert found is None
    with pytest.raises(UnreachableError):
        nearness(quaternion(out), PAPER, MODES[0])
    # From here Newton's method leaves the reach of the legs.
    assert approach_at((135.0, 54.7356, -60.0))[1] is None


# Workspace ---------------------------------------------------------------------------------------


def test_poses_of_the_cone():
    tilt = np.radians([0.0, 10.0, 26.0])
    azimuth = np.radians([[0.0], [90.0], [200.0]])
    R = kinematics.workspace_pose(tilt, azimuth, PHI)
    axis = np.ones(3) / math.sqrt(3.0)
    of_zero_azimuth = np.array([1, -1, 0]) / math.sqrt(2.0)
    found = np.arccos(np.minimum(1.0, R[..., 2] @ axis))
    np.testing.assert_allclose(found, np.broadcast_to(tilt, (3, 3)), atol=1e-7)
    np.testing.assert_allclose(kinematics.zxz_from_matrix(R)[2], PHI, atol=1e-14)
    np.testing.assert_allclose(R[0, 0], zxz(*CENTRE, PHI), atol=1e-15)
    expected = math.cos(tilt[1]) * axis + math.sin(tilt[1]) * of_zero_azimuth
    np.testing.assert_allclose(R[0, 1][:, 2], expected, atol=1e-15)


def test_figures_6_and_15_dexterity_over_the_cone():
    # facts.md: 0.000 to 0.101 with three sensors, 0.323 to 0.502 with four, 13 deg half cone.
    tilt = np.radians(np.linspace(0.0, 13.0, 40))
    azimuth = np.radians(np.arange(0.0, 360.0, 2.0))
    R = kinematics.workspace_pose(tilt, azimuth[:, None], PHI)
    three = kinematics.dexterity(R)
    four = kinematics.dexterity(R, sensors=4)
    assert three.min() < 5e-4
    assert three.max() == pytest.approx(0.101, abs=1e-3)
    assert four.min() == pytest.approx(0.323, abs=1e-3)
    assert four.max() == pytest.approx(0.502, abs=1e-3)


def test_a_change_of_sign_is_between_neighbours_on_rays_and_circles():
    """Four circles, of 0.25 to 1 rad, and eight rays."""
    of_tilt = changes_of_sign(lambda points: points[0] - 0.6, 1.0, rays=8, circles=4)
    np.testing.assert_allclose(of_tilt.here[0], [0.5] * 8)
    np.testing.assert_allclose(of_tilt.there[0], [0.75] * 8)
    np.testing.assert_allclose(of_tilt.here[1], np.radians(range(0, 360, 45)))
    np.testing.assert_allclose(of_tilt.there[1], of_tilt.here[1])
    np.testing.assert_allclose(of_tilt.here_value, [-0.1] * 8)
    np.testing.assert_allclose(of_tilt.there_value, [0.15] * 8)
    of_azimuth = changes_of_sign(lambda points: np.cos(points[1]), 1.0, rays=7, circles=4)
    turn_of_ray = 2.0 * math.pi / 7
    assert sorted(of_azimuth.here[0]) == pytest.approx(
        [0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1.0, 1.0]
    )
    np.testing.assert_allclose(of_azimuth.there[0], of_azimuth.here[0])
    apart = of_azimuth.there[1] - of_azimuth.here[1]
    np.testing.assert_allclose(apart, turn_of_ray)
    assert set(np.rint(of_azimuth.here[1] / turn_of_ray)) == {1.0, 5.0}


@pytest.mark.parametrize(
    'phi_deg',
    [
        49.358591780,
        pytest.param(45.0, marks=pytest.mark.slow),
        pytest.param(53.0, marks=pytest.mark.slow),
    ],
)
def test_locus_is_where_the_determinant_changes_sign(phi_deg):
    phi = math.radians(phi_deg)
    none, _ = kinematics.singularity_locus(0.0, math.radians(13.0))
    assert none.shape == (0,)
    tilt, azimuth = kinematics.singularity_locus(phi, math.radians(26.0))
    assert len(tilt) > 50
    assert tilt.max() <= math.radians(26.0)
    assert np.diff(azimuth).min() >= 0.0
    on_locus = kinematics.workspace_pose(tilt, azimuth, phi)
    determinants = kinematics.parallel_determinant(on_locus)
    np.testing.assert_allclose(determinants, 0.0, atol=1e-14)
    # Every change of sign on a finer, shifted grid has a point of the locus next to it.
    angles = np.radians(np.arange(0.25, 360.0, 1.0))
    grid = np.radians(np.linspace(0.2, 25.9, 300))
    over_grid = kinematics.workspace_pose(grid, angles[:, None], phi)
    values = kinematics.parallel_determinant(over_grid)
    with np.errstate(invalid='ignore'):
        changes_sign = values[:, :-1] * values[:, 1:] < 0.0
    rows, columns = np.nonzero(changes_sign)
    points = tilt * np.exp(1j * azimuth)
    changes = grid[columns] * np.exp(1j * angles[rows])
    distances = np.abs(points - changes[:, None])
    assert distances.min(axis=1).max() < math.radians(1.0)
