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
from spm_haptic_master.kinematics.workspace import approach, determinant_gradient, nearness

PHI = math.radians(50.0)


def test_unreachable_is_exactly_what_the_links_cannot_span():
    rng = np.random.default_rng(3)
    for built in (nominal(), *(random_nominal(rng) for _ in range(4))):
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
            np.testing.assert_allclose(
                G, expected[:sensors], rtol=1e-6, atol=1e-6 * np.abs(expected).max()
            )
            rows = expected[:sensors]
            left_out = range(sensors)[3:4]
            near = nearness(
                tuple(kinematics.quaternion_from_matrix(R).tolist()), g, mode, sensors, left_out
            )
            for eta, used in (
                (kinematics.dexterity(R, g, mode, sensors), rows),
                (near.every, rows),
                (near.three, rows[:3]),
                (near.in_use, np.delete(rows, left_out, axis=0)),
            ):
                values = np.linalg.svd(used, compute_uv=False)
                assert eta == pytest.approx(values[2] / values[0], rel=1e-5, abs=1e-8)


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
        power = tau @ (kinematics.jacobian(R, built.geometry, mode) @ omega)
        assert power == pytest.approx(moments @ rows @ omega, abs=1e-9)
        assert kinematics.parallel_determinant(R, built.geometry, mode) == pytest.approx(
            np.linalg.det(rows), abs=1e-14
        )


@pytest.mark.parametrize('leg', range(3))
@pytest.mark.parametrize('size, inside', [(1.5e-6, True), (0.7e-6, False)])
def test_up_to_the_boundary_of_a_working_mode(leg, size, inside):
    R = near_boundary(leg, size)
    rows = kinematics.jacobian(np.array([R]))[0]
    if inside:
        assert np.abs(kinematics.jacobian(R)[leg]).max() > 1e4
        assert np.isfinite(rows).all()
    else:
        for function in (
            kinematics.jacobian,
            lambda R: nearness(
                tuple(kinematics.quaternion_from_matrix(R).tolist()), PAPER, MODES[0]
            ),
        ):
            with pytest.raises(SingularityError, match='boundary'):
                function(R)
        assert np.isnan(rows).all()


def approach_at(degrees):
    R = zxz(*np.radians(degrees))
    return R, approach(
        tuple(kinematics.quaternion_from_matrix(R).tolist()),
        PAPER,
        MODES[0],
    )


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
    there, beyond = (
        kinematics.parallel_determinant(turn(part * got.distance * np.array(got.axis)) @ rotation)
        for part in (1.0, 1.001)
    )
    assert abs(there) < 1e-6 * abs(here)
    assert beyond * here < 0.0
    # Neither along random directions nor just beside the one that was found.
    rng = np.random.default_rng(53)
    directions = np.concatenate(
        [rng.normal(size=(200, 3)), got.axis + 0.1 * rng.normal(size=(100, 3))]
    )
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    for part in (0.5, 0.999):
        turns = matrix_from_vector(part * got.distance * directions)
        assert (kinematics.parallel_determinant(turns @ rotation) * here > 0.0).all()


def test_the_determinants_gradient_is_a_finite_difference():
    rng = np.random.default_rng(189)
    for trial in range(20):
        built = random_built(rng)
        mode = MODES[trial % 8]
        g = built.geometry
        R = built.reachable_rotation(rng, slack=0.1)
        value, gradient = determinant_gradient(tuple(R.ravel().tolist()), g, mode)
        assert value == pytest.approx(kinematics.parallel_determinant(R, g, mode), abs=1e-12)
        expected = [
            (
                kinematics.parallel_determinant(turn(1e-5 * axis) @ R, g, mode)
                - kinematics.parallel_determinant(turn(-1e-5 * axis) @ R, g, mode)
            )
            / 2e-5
            for axis in np.eye(3)
        ]
        np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6)


def test_nothing_out_of_reach_and_where_there_is_no_singularity():
    out, found = approach_at((0.0, 170.0, 0.0))
    assert found is None
    with pytest.raises(UnreachableError):
        nearness(tuple(kinematics.quaternion_from_matrix(out).tolist()), PAPER, MODES[0])
    # From here Newton's method leaves the reach of the legs.
    assert approach_at((135.0, 54.7356, -60.0))[1] is None


# Workspace ---------------------------------------------------------------------------------------


def test_poses_of_the_cone():
    tilt = np.radians([0.0, 10.0, 26.0])
    azimuth = np.radians([[0.0], [90.0], [200.0]])
    R = kinematics.workspace_pose(tilt, azimuth, PHI)
    axis = np.ones(3) / math.sqrt(3.0)
    np.testing.assert_allclose(
        np.arccos(np.minimum(1.0, R[..., 2] @ axis)), np.broadcast_to(tilt, (3, 3)), atol=1e-7
    )
    np.testing.assert_allclose(kinematics.zxz_from_matrix(R)[2], PHI, atol=1e-14)
    np.testing.assert_allclose(R[0, 0], zxz(*CENTRE, PHI), atol=1e-15)
    np.testing.assert_allclose(
        R[0, 1][:, 2],
        math.cos(tilt[1]) * axis + math.sin(tilt[1]) * np.array([1, -1, 0]) / math.sqrt(2.0),
        atol=1e-15,
    )


def test_figures_6_and_15_dexterity_over_the_cone():
    # facts.md: 0.000 to 0.101 with three sensors, 0.323 to 0.502 with four, 13 deg half cone.
    tilt = np.radians(np.linspace(0.0, 13.0, 40))
    R = kinematics.workspace_pose(tilt, np.radians(np.arange(0.0, 360.0, 2.0))[:, None], PHI)
    three = kinematics.dexterity(R)
    four = kinematics.dexterity(R, sensors=4)
    assert three.min() < 5e-4
    assert three.max() == pytest.approx(0.101, abs=1e-3)
    assert (four.min(), four.max()) == pytest.approx((0.323, 0.502), abs=1e-3)


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
    tilt, azimuth = kinematics.singularity_locus(phi, math.radians(26.0))
    assert kinematics.singularity_locus(0.0, math.radians(13.0))[0].shape == (0,)
    assert len(tilt) > 50
    assert tilt.max() <= math.radians(26.0)
    assert np.diff(azimuth).min() >= 0.0
    np.testing.assert_allclose(
        kinematics.parallel_determinant(kinematics.workspace_pose(tilt, azimuth, phi)),
        0.0,
        atol=1e-14,
    )
    # Every change of sign on a finer, shifted grid has a point of the locus next to it.
    angles = np.radians(np.arange(0.25, 360.0, 1.0))
    grid = np.radians(np.linspace(0.2, 25.9, 300))
    values = kinematics.parallel_determinant(kinematics.workspace_pose(grid, angles[:, None], phi))
    with np.errstate(invalid='ignore'):
        rows, columns = np.nonzero(values[:, :-1] * values[:, 1:] < 0.0)
    points = tilt * np.exp(1j * azimuth)
    changes = grid[columns] * np.exp(1j * angles[rows])
    assert np.abs(points - changes[:, None]).min(axis=1).max() < math.radians(1.0)
