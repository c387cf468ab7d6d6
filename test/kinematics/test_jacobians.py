# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Jacobians beside finite differences, power balance, dexterity, nearness of singularities."""

import math

from built_mechanism import random_built
from mechanism import CENTRE, MODES, SINGULAR_PHI, turn, zxz
import numpy as np
import pytest
from readings import differences, near_boundary, PAPER
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics import (
    dexterity,
    inverse,
    jacobian,
    parallel_determinant,
    quaternion_from_matrix,
)
from spm_haptic_master.kinematics.workspace import approach, determinant_gradient, nearness


@pytest.mark.parametrize('mode', MODES)
def test_jacobians_are_finite_differences(mode):
    rng = np.random.default_rng(302)
    for trial in range(10):
        built = random_built(rng)
        g = built.geometry if trial % 2 else PAPER
        R = built.reachable_rotation(rng, slack=0.15)
        expected = differences(R, g, mode)
        for sensors in (3, 4, 5, 6):
            G = jacobian(R, g, mode, sensors)
            np.testing.assert_allclose(
                G, expected[:sensors], rtol=1e-6, atol=1e-6 * np.abs(expected).max())
            values = np.linalg.svd(expected[:sensors], compute_uv=False)
            eta = dexterity(R, g, mode, sensors)
            assert eta == pytest.approx(values[2] / values[0], rel=1e-5, abs=1e-8)
            near = nearness(tuple(quaternion_from_matrix(R).tolist()), g, mode, sensors)
            assert near.every == pytest.approx(eta, abs=1e-9)
            assert near.three == pytest.approx(dexterity(R, g, mode), abs=1e-9)


def test_power_balance():
    """
    A distal link transmits a force only along its own plane.

    That is a moment about Z2k x Z3k on the platform, in equilibrium with the motor's torque about
    Z1k: tau . thetadot = m . omega.
    """
    rng = np.random.default_rng(40)
    for mode in MODES:
        built = random_built(rng)
        R = built.reachable_rotation(rng)
        th1 = inverse(R, built.geometry, mode).theta1
        moments, omega = rng.normal(size=(2, 3))
        rows = np.cross(built.second_axes(th1), built.third_axes(R))
        tau = moments * (rows * built.base).sum(-1)
        power = tau @ (jacobian(R, built.geometry, mode) @ omega)
        assert power == pytest.approx(moments @ rows @ omega, abs=1e-9)
        assert parallel_determinant(R, built.geometry, mode) == pytest.approx(
            np.linalg.det(rows), abs=1e-14)


def test_three_sensors_fail_at_the_central_singularity_and_four_do_not():
    R = zxz(*CENTRE, SINGULAR_PHI)
    assert abs(parallel_determinant(R)) < 1e-11
    three, four = (np.linalg.svd(jacobian(R, sensors=sensors))[1] for sensors in (3, 4))
    assert three[2] < 1e-9 * three[0] and three[1] > 0.1 * three[0]
    assert four[2] > 0.1 * four[0]


def test_dexterity_by_the_frobenius_norm():
    R = zxz(*CENTRE, math.radians(50.0))
    G = jacobian(R)
    weighted = 3.0 / (np.linalg.norm(G) * np.linalg.norm(np.linalg.inv(G)))
    assert dexterity(R, norm='frobenius') == pytest.approx(weighted, rel=1e-9)
    rank_two = dexterity(zxz(*CENTRE, SINGULAR_PHI), norm='frobenius')
    assert 0.0 <= rank_two < 1e-9


@pytest.mark.parametrize('leg', range(3))
@pytest.mark.parametrize('size, inside', [(1.5e-6, True), (0.7e-6, False)])
def test_up_to_the_boundary_of_a_working_mode(leg, size, inside):
    R = near_boundary(leg, size)
    rows = jacobian(np.array([R]))[0]
    if inside:
        assert np.abs(jacobian(R)[leg]).max() > 1e4
        assert np.isfinite(rows).all()
    else:
        for function in (jacobian, lambda R: nearness(
                tuple(quaternion_from_matrix(R).tolist()), PAPER, MODES[0])):
            with pytest.raises(SingularityError, match='boundary'):
                function(R)
        assert np.isnan(rows).all()


def test_unreachable_rows_are_nan():
    R = [zxz(*CENTRE, 0.3), np.eye(3)]
    with pytest.raises(UnreachableError):
        jacobian(np.eye(3))
    for values in (dexterity(R), parallel_determinant(R)):
        np.testing.assert_array_equal(np.isnan(values), [False, True])


def approach_at(degrees):
    R = zxz(*np.radians(degrees))
    return R, approach(tuple(quaternion_from_matrix(R).tolist()), PAPER, MODES[0])


@pytest.mark.parametrize('degrees', [
    (135.0, 54.7356, 49.0), (125.0, 50.0, 45.0), (140.0, 60.0, 52.0)])
def test_approach_ends_on_the_singular_surface_and_nothing_is_nearer(degrees):
    rotation, got = approach_at(degrees)
    assert np.linalg.norm(got.axis) == pytest.approx(1.0, abs=1e-12)
    here = parallel_determinant(rotation)

    def determinant(angle, axis):
        return parallel_determinant(turn(angle * np.asarray(axis)) @ rotation)

    assert abs(determinant(got.distance, got.axis)) < 1e-6 * abs(here)
    assert determinant(1.001 * got.distance, got.axis) * here < 0.0
    # Neither along random directions nor just beside the one that was found.
    rng = np.random.default_rng(53)
    directions = np.concatenate([
        rng.normal(size=(200, 3)), got.axis + 0.1 * rng.normal(size=(100, 3))])
    for direction in directions / np.linalg.norm(directions, axis=-1, keepdims=True):
        for part in (0.5, 0.999):
            assert determinant(part * got.distance, direction) * here > 0.0


def test_the_determinants_gradient_is_a_finite_difference():
    rng = np.random.default_rng(189)
    for trial in range(20):
        built, mode = random_built(rng), MODES[trial % 8]
        g, R = built.geometry, built.reachable_rotation(rng, slack=0.1)
        value, gradient = determinant_gradient(tuple(R.ravel().tolist()), g, mode)
        assert value == pytest.approx(parallel_determinant(R, g, mode), abs=1e-12)
        expected = [(parallel_determinant(turn(1e-5 * axis) @ R, g, mode)
                     - parallel_determinant(turn(-1e-5 * axis) @ R, g, mode)) / 2e-5
                    for axis in np.eye(3)]
        np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6)


def test_nothing_out_of_reach_and_where_there_is_no_singularity():
    out, found = approach_at((0.0, 170.0, 0.0))
    assert found is None
    with pytest.raises(UnreachableError):
        nearness(tuple(quaternion_from_matrix(out).tolist()), PAPER, MODES[0])
    # From here Newton's method leaves the reach of the legs.
    assert approach_at((135.0, 54.7356, -60.0))[1] is None
