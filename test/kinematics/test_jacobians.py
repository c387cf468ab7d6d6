# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Velocities: finite differences of the inverse model, power balance, dexterity, determinant."""

import math

from hypothesis import assume, given, HealthCheck, settings, strategies
from mechanism import (
    CENTRE,
    chain,
    first_axes,
    MODES,
    reachable,
    reachable_rotation,
    second_axes,
    third_axes,
    turn,
    zxz,
)
import numpy as np
import pytest
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics import (
    dexterity,
    Geometry,
    inverse,
    jacobian,
    parallel_determinant,
)

link = strategies.floats(math.radians(15.0), math.radians(140.0))
geometries = strategies.one_of(
    strategies.just(Geometry()), strategies.builds(Geometry, link, link, link))
seeds = strategies.integers(0, 2**32 - 1)


def pose_for(seed, g):
    """Draw a pose well within its working modes."""
    R = reachable_rotation(np.random.default_rng(seed), g, slack=0.05, attempts=200)
    assume(R is not None)
    return R


@settings(max_examples=100, deadline=None, derandomize=True,
          suppress_health_check=[HealthCheck.filter_too_much])
@given(seeds, geometries, strategies.sampled_from(MODES))
def test_jacobian_is_the_inverse_models_derivative(seed, g, mode):
    R = pose_for(seed, g)
    G = jacobian(R, g, mode, sensors=4)
    step = 1e-5
    for axis in range(3):
        vector = step * np.eye(3)[axis]
        ahead, behind = inverse(turn(vector) @ R, g, mode), inverse(turn(-vector) @ R, g, mode)
        change = np.append(ahead.theta1 - behind.theta1, ahead.theta3a - behind.theta3a)
        rate = np.vectorize(math.remainder)(change, 2.0 * math.pi) / (2.0 * step)
        np.testing.assert_allclose(G[:, axis], rate, atol=2e-6 * (1.0 + np.abs(G).max()**3))
    np.testing.assert_array_equal(jacobian(R, g, mode), G[:3])


@settings(max_examples=100, deadline=None, derandomize=True,
          suppress_health_check=[HealthCheck.filter_too_much])
@given(seeds, geometries, strategies.sampled_from(MODES))
def test_power_balance(seed, g, mode):
    # A distal link transmits a force only along its own plane: a moment about Z2k x Z3k on the
    # platform, in equilibrium with the motor's torque about Z1k. tau . thetadot = m . omega.
    rng = np.random.default_rng(seed)
    R = pose_for(seed, g)
    th1 = inverse(R, g, mode).theta1
    moments = rng.normal(size=3)
    m, tau = np.zeros(3), []
    for size, first, second, third in zip(
            moments, first_axes(), second_axes(th1, g), third_axes(R, g), strict=True):
        m += size * np.cross(second, third)
        tau.append(size * np.cross(second, third) @ first)
    omega = rng.normal(size=3)
    power = tau @ (jacobian(R, g, mode) @ omega)
    assert power == pytest.approx(m @ omega, abs=1e-9)


def singular_phi():
    return math.radians(49.358591780)


def test_the_central_singularity():
    R = zxz(*CENTRE, singular_phi())
    assert abs(parallel_determinant(R)) < 1e-11
    np.testing.assert_allclose(np.degrees(inverse(R).theta1), 63.577, atol=5e-4)
    assert parallel_determinant(zxz(*CENTRE, math.radians(49.0))) * parallel_determinant(
        zxz(*CENTRE, math.radians(50.0))) < 0.0


def test_three_sensors_fail_at_the_singularity_and_four_do_not():
    low, high = math.radians(49.0), math.radians(50.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        if parallel_determinant(zxz(*CENTRE, middle)) * parallel_determinant(
                zxz(*CENTRE, low)) > 0.0:
            low = middle
        else:
            high = middle
    R = zxz(*CENTRE, low)
    three, four = (np.linalg.svd(jacobian(R, sensors=sensors))[1] for sensors in (3, 4))
    assert three[2] < 1e-9 * three[0] and three[1] > 0.1 * three[0]
    assert four[2] > 0.1 * four[0]


def test_determinant_is_that_of_the_axes():
    rng = np.random.default_rng(41)
    g = Geometry()
    for mode in MODES:
        R = reachable_rotation(rng, g)
        th1 = inverse(R, g, mode).theta1
        rows = [np.cross(second, third) for second, third in zip(
            second_axes(th1, g), third_axes(R, g), strict=True)]
        assert parallel_determinant(R, g, mode) == pytest.approx(np.linalg.det(rows), abs=1e-14)


def test_dexterity_at_the_centre():
    R = zxz(*CENTRE, math.radians(50.0))
    assert dexterity(R) == pytest.approx(0.0070, abs=5e-5)
    for sensors in (3, 4):
        G = jacobian(R, sensors=sensors)
        values = np.linalg.svd(G, compute_uv=False)
        assert dexterity(R, sensors=sensors) == pytest.approx(values[-1] / values[0], rel=1e-12)
    G = jacobian(R)
    weighted = 3.0 / (np.linalg.norm(G) * np.linalg.norm(np.linalg.inv(G)))
    assert dexterity(R, norm='frobenius') == pytest.approx(weighted, rel=1e-9)


def test_dexterity_stays_between_0_and_1():
    rng = np.random.default_rng(42)
    R = np.array([reachable_rotation(rng, Geometry()) for _ in range(100)])
    for norm in ('2', 'frobenius'):
        eta = dexterity(R, sensors=4, norm=norm)
        assert ((eta >= 0.0) & (eta <= 1.0)).all()


def boundary_pose(g):
    """Leg A stretched out, with legs B and C well within their reach."""
    rng = np.random.default_rng(43)
    while True:
        R = chain(rng.uniform(-3, 3), 0.0, rng.uniform(-3, 3), g)
        try:
            inverse(R, g)
        except UnreachableError:
            continue
        if reachable(R, g, slack=-1e-9):
            return R


def test_at_the_boundary_of_a_working_mode():
    g = Geometry()
    R = boundary_pose(g)
    for function in (jacobian, dexterity):
        with pytest.raises(SingularityError, match='boundary'):
            function(R, g)
    inside = zxz(*CENTRE, 0.3)
    G = jacobian([R, inside], g)
    assert np.isnan(G[0]).all() and np.isfinite(G[1]).all()
    np.testing.assert_array_equal(np.isnan(dexterity([R, inside], g)), [True, False])


def test_unreachable_rows_are_nan():
    R = [zxz(*CENTRE, 0.3), np.eye(3)]
    with pytest.raises(UnreachableError):
        jacobian(np.eye(3))
    for values in (dexterity(R), parallel_determinant(R)):
        np.testing.assert_array_equal(np.isnan(values), [False, True])
