# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Normal equations of the estimate, compared with numpy's linear algebra."""

from itertools import combinations

from mechanism import second_axes, third_axes, tilted
import numpy as np
import pytest
from readings import PAPER
from spm_haptic_master.kinematics import inverse, jacobian, UsedSensors
from spm_haptic_master.kinematics.estimation.normal_equations import (
    gauss_newton_step,
    in_base_frame,
    linearise,
    normal_equations,
    parities,
)
from spm_haptic_master.kinematics.leg_kernels import linkage
from spm_haptic_master.kinematics.number_backends import FLOATS

SIGMAS = (1e-3, 2e-3, 5e-4, 1.5e-3, 8e-4, 1.2e-3)


def problem(seed, sensors):
    """Random corrections and rates of the legs, the sensors' rows, and their rates (N, 3)."""
    rng = np.random.default_rng(seed)
    legs = tuple(tuple(row) for row in rng.normal(size=(2, 5)).tolist())
    mounted = len(sensors.sigma)
    rates = [(1.0, 0.0, 0.0), legs[0][1:4], legs[1][1:4], (0.0, 0.0, 1.0),
             *rng.normal(size=(mounted - 4, 3)).tolist()]
    rows = tuple((residual, *rate, weight) for residual, rate, weight in zip(
        rng.normal(size=mounted).tolist(), rates, sensors.weights, strict=False))
    return legs, rows, np.array(rates)


SETS = [UsedSensors(SIGMAS[:mounted], left_out) for mounted in (4, 5, 6)
        for number in range(mounted - 2) for left_out in combinations(range(mounted), number)]


@pytest.mark.parametrize('sensors', SETS, ids=lambda sensors: str(sensors.used))
def test_weighted_least_squares(sensors):
    legs, rows, design = problem(len(sensors.used), sensors)
    every = np.array([row[0] for row in rows])
    root = np.sqrt(sensors.weights[:len(every)])
    W = np.diag(root**2)
    normal = design.T @ W @ design
    right, entries, determinant, product = normal_equations(rows)
    assert determinant == pytest.approx(np.linalg.det(normal), rel=1e-9)
    assert product == pytest.approx(np.prod(np.diag(normal)), rel=1e-12)
    np.testing.assert_allclose(right, design.T @ W @ every, rtol=1e-9)
    step, covariance = gauss_newton_step(right, legs, entries, determinant)
    np.testing.assert_allclose(covariance, np.linalg.inv(normal)[np.triu_indices(3)], rtol=1e-8,
                               atol=1e-18)
    expected = np.linalg.lstsq(root[:, None] * design, root * every, rcond=None)[0]
    np.testing.assert_allclose(step[:3], expected, rtol=1e-8)
    # th1B and th1C follow: rates times step, less the correction.
    np.testing.assert_allclose(
        step[3:], [np.array(leg[1:4]) @ expected - leg[0] for leg in legs], rtol=1e-7)
    vector, changes = parities(rows, sensors, covariance, FLOATS)
    assert len(vector) == len(changes) == sensors.count - 3
    if not vector:
        return
    # The parity vector is what no motion changes, of unit covariance, and all that is left.
    lines = np.array(changes)
    np.testing.assert_allclose(lines @ design, 0.0, atol=1e-8 * abs(lines).max())
    np.testing.assert_allclose(lines @ every, vector, rtol=1e-9)
    used = list(sensors.used)
    sigma = np.array(sensors.sigma)
    np.testing.assert_allclose((lines * sigma) @ (lines * sigma).T, np.eye(len(lines)), atol=1e-8)
    left = root * (every - design @ expected)
    assert np.sum(np.square(vector)) == pytest.approx(left @ left, rel=1e-8)
    # Each entry depends on no later sensor.
    for entry, line in enumerate(lines, start=4):
        assert not line[used[entry:]].any() and line[used[entry - 1]] != 0.0
    if sensors.usual:
        # Its sign is that of the rate of leg C along th2A.
        assert np.sign(lines[0][1]) == np.sign(legs[1][2])


@pytest.mark.parametrize('pose', [(0.3, 0.1, 0.5), (0.7, 0.3, 2.0), (-0.2, 0.2, 4.0)])
def test_rates_and_corrections_of_the_legs_and_the_covariance_in_the_base_frame(pose):
    R = tilted(*pose)
    joints = inverse(R)
    th1a, th1b, th1c = joints.theta1.tolist()
    th2a, th3a = float(joints.theta2a), float(joints.theta3a)

    def legs_at(th1b, th1c, left_out=()):
        view = linkage(th1a, th1b, th1c, th3a, PAPER, FLOATS)
        return linearise((th1a, th2a, th3a, th1b, th1c), view, (th1a, th1b, th1c, th3a),
                         UsedSensors(SIGMAS[:4], left_out), PAPER, FLOATS)[0]

    # Along each of leg A's joints the platform turns about Z1A, Z2A, Z3A.
    axes = np.array([[0.0, 0.0, 1.0], second_axes(joints.theta1, PAPER)[0],
                     third_axes(R, PAPER)[0]])
    for leg, row in zip(legs_at(th1b, th1c), jacobian(R)[1:], strict=True):
        assert abs(leg[0]) < 1e-14
        np.testing.assert_allclose(leg[1:4], axes @ row, rtol=1e-9, atol=1e-12)
    # A leg's own angle 1e-6 too large has to be corrected by that.
    legs = legs_at(th1b + 1e-6, th1c - 2e-6)
    assert (legs[0][0], legs[1][0]) == pytest.approx((1e-6, -2e-6), rel=1e-4)
    assert legs_at(th1b, th1c, (1,))[0] == (0.0,) * 5 == legs_at(th1b, th1c, (2,))[1]
    root = np.random.default_rng(90).normal(size=(3, 3))
    covariance = root @ root.T
    found, motions = in_base_frame(
        th1a, th2a, tuple(covariance[np.triu_indices(3)].tolist()), PAPER, FLOATS)
    np.testing.assert_allclose(
        np.reshape(found, (3, 3)), axes.T @ covariance @ axes, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(motions, covariance @ axes, rtol=1e-9, atol=1e-12)
