# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Inverse model: the golden values, the loops it must close, the reach it must not overstate."""

import math

from hypothesis import assume, given, HealthCheck, settings, strategies
from mechanism import (
    CENTRE,
    chain,
    closures,
    inside_reach,
    MODES,
    random_rotation,
    reachable,
    reachable_rotation,
    working_mode,
    zxz,
)
import numpy as np
import pytest
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics import Geometry, inverse, mechanism_angles

seeds = strategies.integers(0, 2**32 - 1)
link = strategies.floats(math.radians(10.0), math.radians(150.0))
geometries = strategies.one_of(
    strategies.just(Geometry()), strategies.builds(Geometry, link, link, link))


@pytest.mark.parametrize('mode, th1, th2a, th3a', [
    ((1, 1, 1), 63.57909396, 101.63324416, 0.90461292),
    ((-1, -1, -1), 166.55321231, -101.63324416, 125.15989244)])
def test_golden_values_at_phi_50(mode, th1, th2a, th3a):
    joints = inverse(zxz(*CENTRE, math.radians(50.0)), working_mode=mode)
    np.testing.assert_allclose(np.degrees(joints.theta1), th1, atol=1e-8)
    assert math.degrees(joints.theta2a) == pytest.approx(th2a, abs=1e-8)
    assert math.degrees(joints.theta3a) == pytest.approx(th3a, abs=1e-8)


@settings(max_examples=200, deadline=None, derandomize=True,
          suppress_health_check=[HealthCheck.filter_too_much])
@given(seeds, geometries, strategies.sampled_from(MODES))
def test_every_loop_closes_in_the_asked_working_mode(seed, g, mode):
    R = reachable_rotation(np.random.default_rng(seed), g, attempts=200)
    assume(R is not None)
    joints = inverse(R, g, mode)
    np.testing.assert_allclose(closures(joints.theta1, R, g), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        chain(joints.theta1[0], joints.theta2a, joints.theta3a, g), R, atol=1e-7)
    assert working_mode(joints.theta1, R, g) == mode


def test_leg_a_carries_the_platform_to_rounding():
    rng = np.random.default_rng(2)
    g = Geometry()
    for _ in range(100):
        # A little inside the reach: at its edge th1 is a square root of rounding errors.
        R = reachable_rotation(rng, g, slack=0.01)
        joints = inverse(R, g)
        np.testing.assert_allclose(
            chain(joints.theta1[0], joints.theta2a, joints.theta3a, g), R, atol=1e-13)


def test_unreachable_is_exactly_what_the_links_cannot_span():
    rng = np.random.default_rng(3)
    seen = {True: 0, False: 0}
    for trial in range(1500):
        g = Geometry() if trial % 2 else Geometry(*rng.uniform(0.3, 2.6, 3))
        R = random_rotation(rng)
        expected = reachable(R, g)
        seen[expected] += 1
        if expected:
            inverse(R, g)
            mechanism_angles(tuple(R.ravel().tolist()), g)
        else:
            with pytest.raises(UnreachableError):
                inverse(R, g)
            with pytest.raises(UnreachableError):
                mechanism_angles(tuple(R.ravel().tolist()), g)
    assert min(seen.values()) > 50


@pytest.mark.parametrize('th2a', [0.0, math.pi])
def test_the_edge_of_reach_is_reached(th2a):
    rng = np.random.default_rng(6)
    g = Geometry()
    found = 0
    while found < 20:
        # Leg A stretched out or folded up, legs B and C somewhere in the middle.
        th1a, th3a = rng.uniform(-math.pi, math.pi, 2)
        R = chain(th1a, th2a, th3a, g)
        if min(inside_reach(R, g)[1:]) < 0.05:
            continue
        found += 1
        for mode in ((1, 1, 1), (-1, 1, 1)):
            joints = inverse(R, g, mode)
            np.testing.assert_allclose(closures(joints.theta1, R, g), 0.0, atol=1e-12)
            assert abs(math.remainder(joints.theta1[0] - th1a, 2.0 * math.pi)) < 1e-6


def test_unreachable_rows_of_a_batch_are_nan_and_only_those():
    rng = np.random.default_rng(4)
    R = np.array([random_rotation(rng) for _ in range(400)]).reshape(20, 20, 3, 3)
    joints = inverse(R)
    expected = np.array([[reachable(matrix, Geometry()) for matrix in row] for row in R])
    assert joints.theta1.shape == (20, 20, 3) and 0 < expected.sum() < 400
    for values in (joints.theta1[..., 0], joints.theta1[..., 1], joints.theta1[..., 2],
                   joints.theta2a, joints.theta3a):
        np.testing.assert_array_equal(np.isfinite(values), expected)


def test_floats_and_arrays_agree():
    rng = np.random.default_rng(5)
    for _ in range(50):
        R = reachable_rotation(rng, Geometry())
        joints = inverse(R, working_mode=(1, -1, 1))
        scalar = mechanism_angles(tuple(R.ravel().tolist()), Geometry(), (1, -1, 1))
        assert all(type(value) is float for value in scalar)
        np.testing.assert_allclose(
            scalar[::3] + scalar[1:3], [*joints.theta1, joints.theta2a, joints.theta3a],
            atol=1e-14)
