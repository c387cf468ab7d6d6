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


# Directions and angles (rad) of a grid of rotations, 0 and pi among them.
AXES = [
    (1, 0, 0),
    (0, 1, 0),
    (0, 0, 1),
    (1, 1, 1),
    (1, -2, 0.5),
]
ANGLES = [0.0, 1e-9, 1.0, math.pi - 1e-9, math.pi]


def grid_of_rotations():
    """Return the rotations of each angle about each axis, (5, 5, 3, 3)."""
    directions = [np.array(axis) / np.linalg.norm(axis) for axis in AXES]
    rows = []
    for angle in ANGLES:
        rows.append([turn(angle * axis) for axis in directions])
    return np.array(rows)


def test_quaternion_of_matrix_at_every_angle():
    R = grid_of_rotations()
    q = rotations.quaternion_from_matrix(R)
    assert q.shape == (5, 5, 4)
    one_radian = ANGLES.index(1.0)
    z = AXES.index((0, 0, 1))
    expected = (0.0, 0.0, math.sin(0.5), math.cos(0.5))
    np.testing.assert_allclose(q[one_radian, z], expected, atol=1e-15)
    assert (q[..., 3] >= 0.0).all()
    lengths = np.linalg.norm(q, axis=-1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-15)
    np.testing.assert_allclose(rotations.matrix_from_quaternion(q), R, atol=2e-15)


def test_batches_keep_their_shape():
    for angle in rotations.zxz_from_matrix(grid_of_rotations()):
        assert angle.shape == (5, 5)
    nothing = np.zeros((0, 3, 3))
    assert rotations.quaternion_from_matrix(nothing).shape == (0, 4)


def test_product_and_distance_of_quaternions():
    rng = np.random.default_rng(8)
    for P, Q in random_rotations(rng, 40).reshape(20, 2, 3, 3):
        p = tuple(rotations.quaternion_from_matrix(P).tolist())
        q = tuple(rotations.quaternion_from_matrix(Q).tolist())
        product = rotations.multiply_quaternions(p, q)
        np.testing.assert_allclose(rotations.matrix_from_quaternion(product), P @ Q, atol=1e-14)
        angle = pytest.approx(angle_between(P, Q), abs=1e-7)
        same = tuple(-value for value in q)
        assert rotations.rotation_distance(p, q) == angle
        assert rotations.rotation_distance(p, same) == angle


def test_the_distance_of_a_half_turn():
    identity = (0.0, 0.0, 0.0, 1.0)
    half_turn = (0.0, 0.0, 1.0, 0.0)
    assert rotations.rotation_distance(identity, half_turn) == pytest.approx(math.pi)


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
    'excess, accepted',
    [
        (9e-7, True),
        (-9e-7, True),
        (1.1e-6, False),
        (-1.1e-6, False),
    ],
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


@pytest.fixture
def zxz_angles():
    """Return psi, theta and phi, theta at 0 and pi in some: there one of the others is free."""
    rng = np.random.default_rng(9)
    psi, theta, phi = rng.uniform(-7.0, 7.0, (3, 300))
    theta[:50] = 0.0
    theta[50:100] = math.pi
    return psi, theta, phi


def test_zxz_angles_and_matrices_are_each_other(zxz_angles):
    R = rotations.matrix_from_zxz(*zxz_angles)
    back = rotations.zxz_from_matrix(R)
    _, theta, _ = back
    assert (theta >= 0.0).all()
    assert np.abs(back).max() <= math.pi
    np.testing.assert_allclose(rotations.matrix_from_zxz(*back), R, atol=4e-15)


def test_zxz_of_one_rotation_are_those_of_a_batch(zxz_angles):
    R = rotations.matrix_from_zxz(*zxz_angles)
    back = np.transpose(rotations.zxz_from_matrix(R))
    rows = np.transpose(zxz_angles)
    for angles, matrix, of_batch in zip(rows, R, back, strict=True):
        expected = zxz(*angles)
        floats = rotations.zxz_rotation(*angles.tolist())
        np.testing.assert_allclose(matrix, expected, atol=2e-15)
        np.testing.assert_allclose(np.reshape(floats, (3, 3)), expected, atol=2e-15)
        quaternion = rotations.quaternion_from_matrix(matrix)
        one = rotations.zxz_angles(*quaternion.tolist())
        for found, other in zip(one, of_batch, strict=True):
            assert abs(math.remainder(found - other, 2.0 * math.pi)) < 2e-15


def test_quaternions_of_zxz_angles_are_their_rotations_and_continuous(zxz_angles):
    for angles in np.transpose(zxz_angles):
        q = rotations.zxz_quaternion(*angles)
        matrix = rotations.matrix_from_quaternion(q)
        np.testing.assert_allclose(matrix, zxz(*angles), atol=2e-15)
        for step in 1e-6 * np.eye(3):
            near = rotations.zxz_quaternion(*(angles + step))
            np.testing.assert_allclose(near, q, atol=1e-6)


def test_a_constant_turn_in_the_base_frame_from_half_a_window_on():
    omega = np.array([1.0, -2.0, 0.5])
    last = np.zeros(4)
    velocity = rotations.AngularVelocity(WINDOW)
    for step in range(60):
        value = velocity.value()
        assert (value is None) == (step < 11)
        if step in (11, 59):
            np.testing.assert_allclose(value, omega, atol=2e-3)
        turned = turn(1e-9 * omega * step * PERIOD)
        quaternion = rotations.quaternion_from_matrix(turned @ zxz(0.3, 0.4, 0.5))
        last = quaternion if quaternion @ last >= 0.0 else -quaternion
        velocity.add(step * PERIOD, tuple(last.tolist()))


# The stamps of a rig count from 1970: a float does not resolve them.
@pytest.mark.parametrize('origin', [0, 1_700_000_000_123_456_789])
def test_slope_of_what_is_in_the_window(origin):
    # Rotation vectors that are small and not on a line; the first stamp is just outside the
    # window, the second on its edge.
    rng = np.random.default_rng(71)
    velocity = rotations.AngularVelocity(WINDOW)
    milliseconds = np.array([0.0, 0.0, 1.0, 5.0, 6.5, 7.0, 13.0, 20.0])
    stamps = (1e6 * milliseconds).astype(int)
    stamps[0] = -1
    vectors = 1e-4 * rng.normal(size=(8, 3))
    vectors[-1] = 0.0
    for stamp, vector in zip(stamps.tolist(), vectors, strict=True):
        x, y, z = (0.5 * vector).tolist()
        velocity.add(origin + stamp, (x, y, z, 1.0))
    slope, _ = np.polyfit(1e-9 * stamps[1:], vectors[1:], 1)
    np.testing.assert_allclose(velocity.value(), slope, rtol=1e-9)


@pytest.mark.parametrize(
    'vector',
    [
        (0.0, 0.0, 0.0),
        (1e-9, -2e-9, 0.0),
        (0.3, -0.2, 0.5),
        (0.0, 3.1, 0.0),
        (-2.0, 1.0, 1.5),
    ],
)
def test_the_rotation_vector_of_a_quaternion_of_either_sign(vector):
    q = rotations.quaternion_from_vector(*vector)
    opposite = tuple(-part for part in q)
    for same in (q, opposite):
        assert rotations.vector_from_quaternion(*same) == pytest.approx(vector, abs=1e-15)
    # From one orientation to another it is in the base frame.
    start = rotations.zxz_quaternion(0.3, 0.4, 0.5)
    turned = rotations.multiply_quaternions(q, start)
    assert rotations.rotation_between(start, turned) == pytest.approx(vector, abs=2e-15)


def test_beyond_half_a_turn_the_rotation_vector_is_the_shorter_one():
    q = rotations.quaternion_from_vector(0.0, 0.0, 4.0)
    expected = (0.0, 0.0, 4.0 - 2.0 * math.pi)
    assert rotations.vector_from_quaternion(*q) == pytest.approx(expected)


@pytest.mark.parametrize(
    'apart, angle, is_within',
    [
        (0.0, 1e-7, True),
        (0.05, 0.0499, False),
        (0.05, 0.0501, True),
        (0.3, 0.2995, False),
        (0.3, 0.3005, True),
        (2.0, 1.999, False),
        (2.0, 2.001, True),
        (3.1, 3.0, False),
        # No two orientations are further apart than half a turn.
        (3.14, 3.2, True),
        (3.14, 5.0, True),
    ],
)
def test_orientations_are_within_an_angle(apart, angle, is_within):
    p = rotations.zxz_quaternion(0.3, 0.4, 0.5)
    vector = 0.36 * apart, -0.48 * apart, 0.8 * apart
    turned = rotations.multiply_quaternions(rotations.quaternion_from_vector(*vector), p)
    opposite = tuple(-part for part in turned)
    for q in (turned, opposite):
        assert rotations.is_within(p, q, angle) is is_within
