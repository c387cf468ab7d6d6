# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Improved forward models: beside all others on mechanisms as built, and at their limits."""

import math

from built_mechanism import random_built
from mechanism import angle_between, MODES
import numpy as np
import pytest
from readings import case_2_determinant, PAPER, SIGMA, wrapped
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics.assembly_modes import LockedChain
from spm_haptic_master.kinematics.closed_form import start_at
from spm_haptic_master.kinematics.leg_kernels import common_turn
from spm_haptic_master.kinematics.number_backends import ARRAYS, FLOATS, SLICE

# Smallest determinant of A, and |B_kk| of a leg, beyond which rounding of 1e-16 stays below 1e-9.
WELL_POSED = 1e-4
# Largest error of a closed form times its determinant (rad): below 1e-9 rad where the determinant
# exceeds 4e-6, as at all but one in two thousand poses.
CLOSED_FORM_ROUNDING = 4e-15


def check_models(built, mode, rng):
    """Check inverse and forward models at one random pose; return whether it was well posed."""
    g = built.geometry
    R = built.reachable_rotation(rng)
    joints = kinematics.inverse(R, g, mode)
    th1 = joints.theta1
    check_inverse(built, mode, R, joints)
    modes = kinematics.forward_all(th1, g)
    check_assembly_modes(built, th1, modes)
    th2a = float(joints.theta2a)
    th3a = float(joints.theta3a)
    chain = LockedChain.of(th1.tolist(), g, FLOATS)
    equations = chain.turn_equations(math.cos(th2a), math.sin(th2a))
    _, _, case_1 = common_turn(*equations)
    case_2 = case_2_determinant([*th1, th3a], g)
    by_theta2a = kinematics.forward_theta2a(th1, th2a, g)
    by_theta3a = kinematics.forward_theta3a(th1, th3a, g)
    quaternion = kinematics.theta3a_quaternion(*th1.tolist(), th3a, g)
    of_floats = kinematics.matrix_from_quaternion(quaternion)
    assert angle_between(by_theta2a, R) < CLOSED_FORM_ROUNDING / abs(case_1)
    assert angle_between(by_theta3a, R) < CLOSED_FORM_ROUNDING / abs(case_2)
    assert angle_between(of_floats, R) < CLOSED_FORM_ROUNDING / abs(case_2)
    singular = kinematics.parallel_determinant(R, g, mode)
    if min(abs(singular), abs(case_2)) < WELL_POSED:
        return False
    assert min(angle_between(R, matrix) for matrix in modes) < 1e-9
    estimate = kinematics.estimate(th1, th3a, SIGMA, g, prior=R)
    assert angle_between(estimate.rotation, R) < 1e-9
    return abs(case_1) > 4e-6


def check_inverse(built, mode, R, joints):
    """Check joint angles by the independent mechanism, which closes in the mode asked for."""
    th1 = joints.theta1
    np.testing.assert_allclose(built.closures(th1, R), 0.0, atol=1e-12)
    assert built.working_mode(th1, R) == mode
    # By floats th1, th2 and th3 of each leg.
    rows = tuple(R.ravel().tolist())
    floats = kinematics.mechanism_angles(rows, built.geometry, mode)
    for leg in range(3):
        chain = built.chain(leg, *floats[3 * leg : 3 * leg + 3])
        assert angle_between(chain, R) < 1e-9
    th2a, th3a = floats[1:3]
    th3b_and_th3c = floats[5::3]
    np.testing.assert_allclose(floats[::3], th1, atol=1e-12)
    assert th2a == pytest.approx(float(joints.theta2a), abs=1e-12)
    assert th3a == pytest.approx(float(joints.theta3a), abs=1e-12)
    np.testing.assert_allclose(th3b_and_th3c, [joints.theta3b, joints.theta3c], atol=1e-12)


def check_assembly_modes(built, th1, modes):
    """Check that each closes the mechanism, and leads back by the inverse of its working mode."""
    assert len(modes) <= 8
    np.testing.assert_allclose(built.closures(th1, modes), 0.0, atol=2e-12)
    for matrix, volumes in zip(modes, built.leg_volumes(th1, modes), strict=True):
        if np.abs(volumes).min() > 0.01:
            signs = tuple(1 if volume > 0.0 else -1 for volume in volumes)
            rows = tuple(matrix.ravel().tolist())
            again = kinematics.measured_angles(rows, built.geometry, signs, 4)[:3]
            np.testing.assert_allclose(wrapped(again - th1), 0.0, atol=1e-9)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('number', [30, pytest.param(200, marks=pytest.mark.evidence)])
def test_models_of_random_mechanisms_in_a_working_mode(mode, number):
    rng = np.random.default_rng(183)
    well_posed = 0
    for _ in range(number):
        well_posed += check_models(random_built(rng), mode, rng)
    assert well_posed >= 0.9 * number


@pytest.mark.parametrize('missing', [(0,), (1,), (2,), (3,), (0, 1), (1, 2), (0, 2), (3, 1)])
def test_a_start_has_the_joint_angles_of_its_orientation(missing):
    """Of a mechanism of three different legs; what is missing follows from the leg's th3."""
    rng = np.random.default_rng(16)
    built = random_built(rng)
    for mode in MODES:
        rotation = kinematics.workspace_pose(0.2, rng.uniform(0.0, 6.0), 0.7)
        rows = tuple(rotation.ravel().tolist())
        joints = kinematics.mechanism_angles(rows, built.geometry, mode)
        th1a, th2a, th3a, th1b, _, th3b, th1c, _, th3c = joints
        readings = [th1a, th1b, th1c, th3a, th3b, th3c]
        for place in missing:
            readings[place] = None
        start = start_at(rows, tuple(readings), built.geometry)
        np.testing.assert_allclose(
            wrapped(np.array(start) - (th1a, th2a, th3a, th1b, th1c)), 0.0, atol=1e-9
        )


def test_long_batches_are_their_rows():
    """More rows than one slice, of shapes that broadcast."""
    rng = np.random.default_rng(13)
    th1 = rng.uniform(-3.0, 3.0, (2, SLICE - 100, 3))
    for model in (kinematics.forward_theta3a, kinematics.forward_theta2a):
        passive = rng.uniform(-3.0, 3.0, SLICE - 100)
        R = model(th1, passive)
        assert R.shape == (2, SLICE - 100, 3, 3)
        for number in (0, SLICE - 101):
            alone = model(th1[0, number][None], passive[number])
            np.testing.assert_array_equal(R[0, number], alone[0])
        for number in (50, 99, 100, SLICE - 101):
            alone = model(th1[1, number][None], passive[number])
            np.testing.assert_array_equal(R[1, number], alone[0])


def degenerate(size):
    """Four angles at which the closed form's determinant has this value, by Newton's method."""

    def determinant(th1c):
        return case_2_determinant((1.1, 1.0, th1c, 0.4))

    angle = 1.1
    for _ in range(30):
        error = determinant(angle) - size
        ahead = determinant(angle + 1e-6) - size
        angle -= 1e-6 * error / (ahead - error)
    assert determinant(angle) == pytest.approx(size, rel=1e-3)
    return 1.1, 1.0, angle, 0.4


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_closed_form_down_to_its_least_determinant(sign):
    answered = degenerate(sign * 1.5e-9)
    refused = degenerate(sign * 0.7e-9)
    *th1, th3a = answered
    by_arrays = kinematics.forward_theta3a(th1, th3a)
    quaternion = kinematics.theta3a_quaternion(*answered, PAPER)
    by_floats = kinematics.matrix_from_quaternion(quaternion)
    np.testing.assert_allclose(by_arrays, by_floats, atol=1e-5)
    with pytest.raises(SingularityError, match='determinant'):
        kinematics.theta3a_quaternion(*refused, PAPER)
    with pytest.raises(SingularityError, match='determinant'):
        kinematics.forward_theta3a(refused[:3], refused[3])
    batch = kinematics.forward_theta3a([answered[:3], refused[:3]], 0.4)
    failed = np.isnan(batch).any(axis=(1, 2))
    assert failed.tolist() == [False, True]


def test_half_turns_of_points_all_round():
    """The point 0 has the angle 0; NaN stays NaN."""
    near = np.array([1e-9, 1e-15])
    angles = np.concatenate(
        [
            np.linspace(-3.1, 3.1, 50),
            math.pi - near,
            near - math.pi,
            -near,
            near,
            [0.0, np.nan],
        ]
    )
    expected = np.cos(0.5 * angles), np.sin(0.5 * angles)
    for radius in (1e-9, 1.0, 1e6):
        y = radius * np.sin(angles)
        x = radius * np.cos(angles)
        y[-2] = 0.0
        x[-2] = 0.0
        arrays = ARRAYS.half_turn(y, x)
        points = zip(y.tolist(), x.tolist(), strict=True)
        floats = [FLOATS.half_turn(*point) for point in points]
        np.testing.assert_allclose(arrays, expected, rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(np.transpose(floats), expected, rtol=0.0, atol=1e-15)
