# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rotations against matrices written out, at the edges of each parametrisation, and in time."""

import math

from mechanism import angle_between, random_rotations, turn, zxz
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import rotations

# Window of the slope of the orientation, and period of the samples (ns).
WINDOW = 20_000_000
PERIOD = 1_000_000


def test_quaternion_of_matrix_at_every_angle():
    axes = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (1, -2, 0.5)]
    R = np.array(
        [
            [turn(angle * np.array(axis) / np.linalg.norm(axis)) for axis in axes]
            for angle in (0.0, 1e-9, 1.0, math.pi - 1e-9, math.pi)
        ]
    )
    q = rotations.quaternion_from_matrix(R)
    np.testing.assert_allclose(q[2, 2], [0.0, 0.0, math.sin(0.5), math.cos(0.5)], atol=1e-15)
    assert q.shape == (5, 5, 4)
    assert (q[..., 3] >= 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, atol=1e-15)
    np.testing.assert_allclose(rotations.matrix_from_quaternion(q), R, atol=2e-15)
    assert [angle.shape for angle in rotations.zxz_from_matrix(R)] == [(5, 5)] * 3
    assert rotations.quaternion_from_matrix(np.zeros((0, 3, 3))).shape == (0, 4)


def test_product_and_distance_of_quaternions():
    rng = np.random.default_rng(8)
    for P, Q in random_rotations(rng, 40).reshape(20, 2, 3, 3):
        p, q = (tuple(rotations.quaternion_from_matrix(matrix).tolist()) for matrix in (P, Q))
        product = rotations.multiply_quaternions(p, q)
        np.testing.assert_allclose(rotations.matrix_from_quaternion(product), P @ Q, atol=1e-14)
        angle = pytest.approx(angle_between(P, Q), abs=1e-7)
        for other in (q, tuple(-value for value in q)):
            assert rotations.rotation_distance(p, other) == angle
    half_turn = rotations.rotation_distance((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0))
    assert half_turn == pytest.approx(math.pi)


@pytest.mark.parametrize(
    'vector',
    [
        (0.0, 0.0, 0.0),
        (1e-200, 0.0, 0.0),
        (1e-9, -2e-9, 0.0),
        (0.3, -0.2, 0.5),
        (0.0, math.pi, 0.0),
        (3.0, 2.0, -4.0),
    ],
)
def test_quaternion_of_a_rotation_vector(vector):
    q = rotations.quaternion_from_vector(*vector)
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(rotations.matrix_from_quaternion(q), turn(vector), atol=1e-15)


@pytest.mark.parametrize(
    'excess, accepted', [(9e-7, True), (-9e-7, True), (1.1e-6, False), (-1.1e-6, False)]
)
def test_rotations_and_quaternions_are_checked_to_their_tolerance(excess, accepted):
    R = zxz(0.3, 0.4, 0.5)
    longer = (1.0 + excess) * rotations.quaternion_from_matrix(R)
    stretched = R @ np.diag([1.0, math.sqrt(1.0 + excess), 1.0])
    if accepted:
        np.testing.assert_allclose(rotations.matrix_from_quaternion(longer), R, atol=1e-15)
        q = rotations.quaternion_from_matrix(stretched)
        assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)
    else:
        with pytest.raises(InputError, match='unit quaternion'):
            rotations.matrix_from_quaternion(longer)
        with pytest.raises(InputError, match='rotation'):
            rotations.quaternion_from_matrix(stretched)


def test_zxz_angles_matrices_and_continuous_quaternions_are_each_other():
    """With theta at 0 and pi, where only the sum or the difference of the others is defined."""
    psi, theta, phi = np.random.default_rng(9).uniform(-7.0, 7.0, (3, 300))
    theta[:50], theta[50:100] = 0.0, math.pi
    R = rotations.matrix_from_zxz(psi, theta, phi)
    back = rotations.zxz_from_matrix(R)
    assert (back[1] >= 0.0).all()
    assert np.abs(back).max() <= math.pi
    np.testing.assert_allclose(rotations.matrix_from_zxz(*back), R, atol=4e-15)
    for row, angles in enumerate(zip(psi.tolist(), theta.tolist(), phi.tolist(), strict=True)):
        expected = zxz(*angles)
        q = rotations.zxz_quaternion(*angles)
        for found in (
            R[row],
            np.reshape(rotations.zxz_rotation(*angles), (3, 3)),
            rotations.matrix_from_quaternion(q),
        ):
            np.testing.assert_allclose(found, expected, atol=2e-15)
        for step in 1e-6 * np.eye(3):
            np.testing.assert_allclose(rotations.zxz_quaternion(*(angles + step)), q, atol=1e-6)
        one = rotations.zxz_angles(*rotations.quaternion_from_matrix(R[row]).tolist())
        for found, other in zip(one, np.array(back)[:, row], strict=True):
            assert abs(math.remainder(found - other, 2.0 * math.pi)) < 2e-15


def test_a_constant_turn_in_the_base_frame_from_half_a_window_on():
    omega = np.array([1.0, -2.0, 0.5])
    last = np.zeros(4)
    velocity = rotations.AngularVelocity(WINDOW)
    for step in range(60):
        value = velocity.value()
        assert (value is None) == (step < 11)
        if step in (11, 59):
            np.testing.assert_allclose(value, omega, atol=2e-3)
        quaternion = rotations.quaternion_from_matrix(
            turn(1e-9 * omega * step * PERIOD) @ zxz(0.3, 0.4, 0.5)
        )
        last = quaternion if quaternion @ last >= 0.0 else -quaternion
        velocity.add(step * PERIOD, tuple(last.tolist()))


# The stamps of a rig count from 1970: a float does not resolve them.
@pytest.mark.parametrize('origin', [0, 1_700_000_000_123_456_789])
def test_slope_of_what_is_in_the_window(origin):
    # Rotation vectors that are small and not on a line; the first stamp is just outside the
    # window, the second on its edge.
    rng = np.random.default_rng(71)
    velocity = rotations.AngularVelocity(WINDOW)
    stamps = np.array([-1, 0, 1_000_000, 5_000_000, 6_500_000, 7_000_000, 13_000_000, 20_000_000])
    vectors = 1e-4 * rng.normal(size=(8, 3))
    vectors[-1] = 0.0
    for stamp, vector in zip(stamps.tolist(), vectors, strict=True):
        velocity.add(origin + stamp, (*(0.5 * vector).tolist(), 1.0))
    slope = np.polyfit(1e-9 * stamps[1:], vectors[1:], 1)[0]
    np.testing.assert_allclose(velocity.value(), slope, rtol=1e-9)
