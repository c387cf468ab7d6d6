# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Improved forward models: round trips in every working mode, the paper's Fig. 13, the limits."""

import math

from mechanism import (
    angle_between,
    CENTRE,
    MODES,
    random_geometry,
    reachable_rotation,
    zxz,
)
import numpy as np
import pytest
from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics import (
    forward_theta2a,
    forward_theta3a,
    Geometry,
    inverse,
    matrix_from_quaternion,
    theta3a_quaternion,
    zxz_from_matrix,
)
from spm_haptic_master.kinematics.leg_kernels import linkage, turn_of_second_joint
from spm_haptic_master.kinematics.number_backends import FLOATS, SLICE

SIGMA = math.radians(0.04)


@pytest.mark.parametrize('mode', MODES)
def test_four_angles_give_the_pose_back(mode):
    rng = np.random.default_rng(10)
    for trial in range(12):
        g = Geometry() if trial % 2 else random_geometry(rng)
        R = np.array([reachable_rotation(rng, g, slack=0.02) for _ in range(5)])
        joints = inverse(R, g, mode)
        # Closed forms lose digits with their determinant; the worst of these lose six.
        np.testing.assert_allclose(forward_theta3a(joints.theta1, joints.theta3a, g), R, atol=1e-9)
        np.testing.assert_allclose(forward_theta2a(joints.theta1, joints.theta2a, g), R, atol=1e-9)


def test_rounding_error_only_along_the_papers_trajectory():
    # Fig. 21: phi through the singularity at 50 deg; the paper quotes about 1e-14 deg.
    for phi in np.radians(np.linspace(40.0, 60.0, 201)):
        R = zxz(math.radians(135.0), math.radians(54.0), phi)
        joints = inverse(R)
        error = angle_between(forward_theta3a(joints.theta1, joints.theta3a), R)
        assert math.degrees(error) < 5e-13


def test_floats_and_arrays_agree():
    rng = np.random.default_rng(11)
    th1, th3 = rng.uniform(-3.0, 3.0, (50, 3)), rng.uniform(-3.0, 3.0, 50)
    R = forward_theta3a(th1, th3)
    for row in range(50):
        q = theta3a_quaternion(*th1[row].tolist(), float(th3[row]), Geometry())
        assert all(type(value) is float for value in q)
        assert sum(value * value for value in q) == pytest.approx(1.0, abs=1e-14)
        np.testing.assert_allclose(matrix_from_quaternion(q), R[row], atol=1e-13)


def test_long_batches_are_their_rows():
    # More rows than one slice, of shapes that broadcast; a row without an answer beyond the first.
    rng = np.random.default_rng(13)
    th1 = rng.uniform(-3.0, 3.0, (2, SLICE - 100, 3))
    for model in (forward_theta3a, forward_theta2a):
        passive = rng.uniform(-3.0, 3.0, SLICE - 100)
        R = model(th1, passive)
        assert R.shape == (2, SLICE - 100, 3, 3)
        for index in ((0, 0), (0, SLICE - 101), (1, 50), (1, 99), (1, 100), (1, SLICE - 101)):
            np.testing.assert_array_equal(
                R[index], model(th1[index][None], passive[index[1]])[0])
    # Parallel turn equations: no th2A.
    th1 = np.broadcast_to(th1[0, 0], (SLICE + 2, 3)).copy()
    th3a = np.full(SLICE + 2, passive[0])
    *th1[SLICE + 1], th3a[SLICE + 1] = degenerate_sample(Geometry())
    R = forward_theta3a(th1, th3a)
    assert np.isfinite(R[:-1]).all() and np.isnan(R[-1]).all()


def test_figure_13_the_extra_sensor_belongs_on_th3a():
    # 0.04 deg on every sensor, phi about the central singularity: facts.md, section 4.
    rng = np.random.default_rng(12)
    count = 20000
    phi = np.radians(50.0 + rng.uniform(-2.0, 2.0, count))
    R = np.array([zxz(*CENTRE, value) for value in phi])
    joints = inverse(R)
    th1 = joints.theta1 + SIGMA * rng.normal(size=(count, 3))
    case1 = forward_theta2a(th1, joints.theta2a + SIGMA * rng.normal(size=count))
    case2 = forward_theta3a(th1, joints.theta3a + SIGMA * rng.normal(size=count))

    error1, error2 = (
        np.degrees(zxz_from_matrix(found)[2] - phi) for found in (case1, case2))
    assert np.sqrt(np.mean(error2**2)) == pytest.approx(0.030, abs=0.002)
    assert np.mean(np.abs(error2) < 0.1) > 0.998
    assert 0.30 < np.mean(np.abs(error1) > 0.1) < 0.36
    assert np.sqrt(np.mean(error1**2)) == pytest.approx(0.104, abs=0.005)


def degenerate_sample(g):
    """Four angles for which L1 M2 = L2 M1, found by bisection on th1C."""
    def determinant(th1c):
        _, _, leg_b, leg_c = linkage(1.1, 1.0, th1c, 0.4, g, FLOATS)
        return turn_of_second_joint(leg_b, leg_c)[2]

    grid = np.linspace(-math.pi, math.pi, 200)
    values = [determinant(value) for value in grid]
    low = next(i for i in range(199) if values[i] * values[i + 1] < 0.0)
    low, high = grid[low], grid[low + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        if determinant(middle) * determinant(low) > 0.0:
            low = middle
        else:
            high = middle
    return (1.1, 1.0, float(low), 0.4)


def test_where_the_closed_form_has_no_answer_it_says_so():
    g = Geometry()
    sample = degenerate_sample(g)
    with pytest.raises(SingularityError, match='determinant'):
        theta3a_quaternion(*sample, g)
    with pytest.raises(SingularityError, match='determinant'):
        forward_theta3a(sample[:3], sample[3], g)
    batch = forward_theta3a([sample[:3], (1.1, 1.0, 1.2)], sample[3], g)
    assert np.isnan(batch[0]).all() and np.isfinite(batch[1]).all()
