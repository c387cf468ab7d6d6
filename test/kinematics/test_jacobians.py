# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Velocities: finite differences of the inverse model, power balance, dexterity, determinant."""

import math

from built_mechanism import random_built
from mechanism import CENTRE, MODES, SINGULAR_PHI, zxz
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
from spm_haptic_master.kinematics.jacobians import nearness
from spm_haptic_master.kinematics.number_backends import ARRAYS, FLOATS


@pytest.mark.parametrize('mode', MODES)
def test_jacobians_are_finite_differences(mode):
    rng = np.random.default_rng(302)
    for trial in range(10):
        built = random_built(rng)
        g = built.geometry if trial % 2 else PAPER
        R = built.reachable_rotation(rng, slack=0.15)
        expected = differences(R, g, mode)
        near = nearness(tuple(quaternion_from_matrix(R).tolist()), g, mode)
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
        for function in (jacobian, dexterity):
            with pytest.raises(SingularityError, match='boundary'):
                function(R)
        assert np.isnan(rows).all()
        assert np.isnan(dexterity(np.array([R]))[0])


def test_reciprocal_up_to_the_boundary_of_a_working_mode():
    for b in (0.5, 1e-6, -1e-6, -0.25):
        assert FLOATS.mode_reciprocal(b) == 1.0 / b
        assert ARRAYS.mode_reciprocal(np.array([b]))[0] == 1.0 / b
    for b in (9e-7, 0.0, -9e-7):
        with pytest.raises(SingularityError, match='boundary'):
            FLOATS.mode_reciprocal(b)
        assert np.isnan(ARRAYS.mode_reciprocal(np.array([b]))[0])


def test_unreachable_rows_are_nan():
    R = [zxz(*CENTRE, 0.3), np.eye(3)]
    with pytest.raises(UnreachableError):
        jacobian(np.eye(3))
    for values in (dexterity(R), parallel_determinant(R)):
        np.testing.assert_array_equal(np.isnan(values), [False, True])
