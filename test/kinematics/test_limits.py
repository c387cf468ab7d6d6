# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Limits and tolerances: the behaviour just inside and just outside of each."""

import math

from mechanism import CENTRE, chain, inside_reach, SINGULAR_PHI, tilted, turn, zxz
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError, SingularityError, UnreachableError
from spm_haptic_master.kinematics import (
    dexterity,
    estimate,
    forward_theta3a,
    Geometry,
    inverse,
    jacobian,
    matrix_from_quaternion,
    quaternion_from_matrix,
    theta3a_quaternion,
    track_mode,
)
from spm_haptic_master.kinematics.leg_kernels import linkage, turn_of_second_joint
from spm_haptic_master.kinematics.number_backends import ARRAYS, FLOATS

PAPER = Geometry()
SIGMA = math.radians(0.04)
THIRD = 2.0 * math.pi / 3.0


def readings_of(R):
    joints = inverse(R)
    return np.append(joints.theta1, joints.theta3a)


def test_root_of_a_squared_sine():
    for square, root in ((2.25, 1.5), (1e-30, 1e-15), (0.0, 0.0), (-9e-13, 0.0), (-1e-12, 0.0)):
        assert FLOATS.reach_root(square) == root
        assert ARRAYS.reach_root(np.array([square]))[0] == root
    with pytest.raises(UnreachableError, match='-1.1e-12'):
        FLOATS.reach_root(-1.1e-12)
    assert np.isnan(ARRAYS.reach_root(np.array([-1.1e-12]))[0])


def test_half_turns_of_points_all_round():
    angles = np.concatenate([np.linspace(-3.1, 3.1, 50), math.pi - np.array([1e-9, 1e-15]),
                             -math.pi + np.array([1e-9, 1e-15]), [0.0, 1e-9, -1e-9]])
    for radius in (1e-9, 1.0, 1e6):
        y, x = radius * np.sin(angles), radius * np.cos(angles)
        cosines, sines = ARRAYS.half_turn(y, x)
        for row in range(len(angles)):
            cosine, sine = FLOATS.half_turn(float(y[row]), float(x[row]))
            assert cosine == pytest.approx(math.cos(0.5 * angles[row]), abs=1e-15)
            assert sine == pytest.approx(math.sin(0.5 * angles[row]), abs=1e-15)
            assert (cosines[row], sines[row]) == pytest.approx((cosine, sine), abs=1e-15)


def test_the_point_zero_has_a_half_turn():
    cosines, sines = ARRAYS.half_turn(np.array([0.0, 1.0, np.nan]), np.array([0.0, 0.0, np.nan]))
    np.testing.assert_allclose(cosines, [1.0, math.sqrt(0.5), np.nan])
    np.testing.assert_allclose(sines, [0.0, math.sqrt(0.5), np.nan])
    assert FLOATS.half_turn(0.0, 0.0) == (1.0, 0.0)


def test_reciprocal_up_to_the_boundary_of_a_working_mode():
    for b in (0.5, 1e-6, -1e-6, -0.25):
        assert FLOATS.mode_reciprocal(b) == 1.0 / b
        assert ARRAYS.mode_reciprocal(np.array([b]))[0] == 1.0 / b
    for b in (9e-7, 0.0, -9e-7):
        with pytest.raises(SingularityError, match='boundary'):
            FLOATS.mode_reciprocal(b)
        assert np.isnan(ARRAYS.mode_reciprocal(np.array([b]))[0])


@pytest.mark.parametrize('leg', range(3))
@pytest.mark.parametrize('size, inside', [(1.5e-6, True), (0.7e-6, False)])
def test_jacobian_up_to_the_boundary_of_a_working_mode(leg, size, inside):
    # B_kk = sin alpha sin beta sin th2k, and leg B or C is leg A in a platform turned about
    # (1, 1, 1).
    R = stretched(size / (math.sin(PAPER.alpha) * math.sin(PAPER.beta)))
    base, platform = turn(np.full(3, THIRD / math.sqrt(3.0))), zxz(0.0, 0.0, -THIRD)
    R = np.linalg.matrix_power(base, leg) @ R @ np.linalg.matrix_power(platform, leg)
    rows = jacobian(np.array([R]))[0]
    if inside:
        assert np.abs(jacobian(R)[leg]).max() > 1e4
        assert np.isfinite(rows).all()
    else:
        with pytest.raises(SingularityError, match='boundary'):
            jacobian(R)
        assert np.isnan(rows).all()
        assert np.isnan(dexterity(np.array([R]))[0])


def stretched(th2a):
    """Pose with leg A almost stretched out and the others well within their reach."""
    rng = np.random.default_rng(80)
    while True:
        R = chain(rng.uniform(-3.0, 3.0), th2a, rng.uniform(-3.0, 3.0), PAPER)
        if inside_reach(R, PAPER)[1:].min() > 0.1:
            return R


def test_rotations_up_to_their_tolerance():
    for excess, accepted in ((9e-7, True), (-9e-7, True), (1.1e-6, False), (-1.1e-6, False)):
        R = zxz(0.3, 0.4, 0.5) @ np.diag([1.0, math.sqrt(1.0 + excess), 1.0])
        if accepted:
            assert np.linalg.norm(quaternion_from_matrix(R)) == pytest.approx(1.0, abs=1e-15)
        else:
            with pytest.raises(InputError, match='rotation'):
                quaternion_from_matrix(R)


def test_quaternions_up_to_their_tolerance():
    for norm, accepted in ((1.0 + 9e-7, True), (1.0 - 9e-7, True), (1.0 + 1.1e-6, False),
                           (1.0 - 1.1e-6, False)):
        q = norm * quaternion_from_matrix(zxz(0.3, 0.4, 0.5))
        if accepted:
            np.testing.assert_allclose(
                matrix_from_quaternion(q), zxz(0.3, 0.4, 0.5), atol=1e-15)
        else:
            with pytest.raises(InputError, match='unit quaternion'):
                matrix_from_quaternion(q)


def determinant_of(readings):
    th1a, th1b, th1c, th3a = readings
    _, _, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, PAPER, FLOATS)
    return turn_of_second_joint(leg_b, leg_c)[2]


def degenerate(size, th1b=1.0):
    """Four angles at which the closed form's determinant has this value, by the secant method."""
    low, high = 1.1, 1.3
    at_low, at_high = (determinant_of((1.1, th1b, x, 0.4)) - size for x in (low, high))
    for _ in range(30):
        if at_high == at_low:
            break
        low, high, at_low = high, high - at_high * (high - low) / (at_high - at_low), at_high
        at_high = determinant_of((1.1, th1b, high, 0.4)) - size
    return 1.1, th1b, high, 0.4


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_closed_form_down_to_its_least_determinant(sign):
    answered, refused = degenerate(sign * 1.5e-9), degenerate(sign * 0.7e-9)
    assert determinant_of(answered) == pytest.approx(sign * 1.5e-9, rel=1e-3)
    assert determinant_of(refused) == pytest.approx(sign * 0.7e-9, rel=1e-3)
    R = matrix_from_quaternion(theta3a_quaternion(*answered, PAPER))
    np.testing.assert_allclose(forward_theta3a(answered[:3], answered[3]), R, atol=1e-5)
    with pytest.raises(SingularityError, match='determinant'):
        theta3a_quaternion(*refused, PAPER)
    with pytest.raises(SingularityError, match='determinant'):
        forward_theta3a(refused[:3], refused[3])
    batch = forward_theta3a([answered[:3], refused[:3]], 0.4)
    np.testing.assert_array_equal(np.isnan(batch).any(axis=(1, 2)), [False, True])


@pytest.mark.parametrize('total, determined', [(0.0999, True), (0.1001, False)])
def test_an_estimate_is_determined_up_to_a_total_deviation(total, determined):
    # The readings of a pose agree: the covariance is proportional to the square of sigma.
    readings = readings_of(tilted(0.5, 0.2, 1.0))
    small = estimate(readings[:3], readings[3], SIGMA)
    sigma = SIGMA * total / math.sqrt(np.trace(small.covariance))
    single = estimate(readings[:3], readings[3], sigma)
    assert math.sqrt(np.trace(single.covariance)) == pytest.approx(total, rel=1e-9)
    assert single.determined == determined
    batch = estimate(readings[None, :3], readings[None, 3], sigma)
    np.testing.assert_array_equal(batch.determined, [determined])
    assert batch.covariance[0] == pytest.approx(single.covariance)


@pytest.mark.parametrize('offset, ambiguous', [(0.0085, True), (0.0115, False)])
def test_modes_are_ambiguous_up_to_the_margin(offset, ambiguous):
    # The mode of the pose itself is at distance 0, the other one about `offset` away.
    low, high = SINGULAR_PHI, SINGULAR_PHI + offset
    for _ in range(40):
        phi = 0.5 * (low + high)
        R = zxz(*CENTRE, phi)
        th1 = inverse(R).theta1
        if track_mode(th1, R, margin=offset).ambiguous:
            low = phi
        else:
            high = phi
    tracked = track_mode(th1, R)
    assert tracked.distance < 1e-9
    assert tracked.ambiguous == ambiguous
