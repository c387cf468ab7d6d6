# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Normal equations of the estimate, compared with numpy's linear algebra."""

from mechanism import second_axes, third_axes, tilted
import numpy as np
import pytest
from readings import four_angles, PAPER, SIGMA
from spm_haptic_master.kinematics import estimate_sample, inverse, jacobian
from spm_haptic_master.kinematics.leg_kernels import linkage
from spm_haptic_master.kinematics.normal_equations import (
    consistency,
    gauss_newton_step,
    in_base_frame,
    inverse_normal,
    linearise,
    normal_equations,
    parity_of,
    residuals_of,
    weights_of,
)
from spm_haptic_master.kinematics.number_backends import FLOATS

SIGMAS = (1e-3, 2e-3, 5e-4, 1.5e-3)


def problem(seed):
    """Random corrections and rates of legs B and C, residuals, and the design matrix (4, 3)."""
    rng = np.random.default_rng(seed)
    legs = tuple(tuple(row) for row in rng.normal(size=(2, 4)).tolist())
    residuals = tuple(rng.normal(size=4).tolist())
    design = np.array([[1.0, 0.0, 0.0], legs[0][1:], legs[1][1:], [0.0, 0.0, 1.0]])
    return legs, residuals, design


@pytest.mark.parametrize('seed', range(3))
def test_weighted_least_squares(seed):
    legs, residuals, design = problem(seed)
    weights = weights_of(SIGMAS)
    np.testing.assert_allclose(weights, np.array(SIGMAS)**-2.0, rtol=1e-14)
    W = np.diag(weights)
    normal = design.T @ W @ design
    matrix, right = normal_equations(residuals, legs, weights)
    np.testing.assert_allclose(matrix, normal[np.triu_indices(3)], rtol=1e-12)
    entries, determinant, product = inverse_normal(matrix)
    np.testing.assert_allclose(
        np.array(entries) / determinant, np.linalg.inv(normal)[np.triu_indices(3)], rtol=1e-9)
    assert determinant == pytest.approx(np.linalg.det(normal), rel=1e-9)
    assert product == pytest.approx(np.prod(np.diag(normal)), rel=1e-12)
    np.testing.assert_allclose(right, design.T @ W @ residuals, rtol=1e-12)
    step = np.array(gauss_newton_step(right, legs, entries, determinant))
    root = np.sqrt(weights)
    expected = np.linalg.lstsq(root[:, None] * design, root * residuals, rcond=None)[0]
    np.testing.assert_allclose(step[:3], expected, rtol=1e-9)
    # th1B and th1C follow: rates times step, less the correction.
    np.testing.assert_allclose(
        step[3:], [np.array(leg[1:]) @ expected - leg[0] for leg in legs], rtol=1e-9)
    # What is left of the residuals has the direction of the one combination that does not move.
    combination = np.array(consistency(legs))
    np.testing.assert_allclose(combination @ design, 0.0, atol=1e-14)
    assert abs(combination).max() > 0.1
    left = residuals - design @ expected
    parity = parity_of(residuals, legs, weights, FLOATS)
    assert parity**2 == pytest.approx(left @ W @ left, rel=1e-9)
    assert np.sign(parity) == np.sign(combination @ residuals)


@pytest.mark.parametrize('phi, tilt, azimuth', [
    (0.3, 0.1, 0.5), (0.7, 0.3, 2.0), (-0.2, 0.2, 4.0)])
def test_rates_and_corrections_of_the_legs(phi, tilt, azimuth):
    R = tilted(phi, tilt, azimuth)
    joints = inverse(R)
    th1a, th1b, th1c = joints.theta1.tolist()
    th2a, th3a = float(joints.theta2a), float(joints.theta3a)

    def legs_at(th1a, th2a, th3a, th1b, th1c, weights=(1.0, 1.0, 1.0, 1.0)):
        view = linkage(th1a, th1b, th1c, th3a, PAPER, FLOATS)
        return linearise(th2a, *view, weights, PAPER, FLOATS)[0]

    legs = legs_at(th1a, th2a, th3a, th1b, th1c)
    # Along each of leg A's joints the platform turns about Z1A, Z2A, Z3A.
    axes = np.array([[0.0, 0.0, 1.0], second_axes(joints.theta1, PAPER)[0],
                     third_axes(R, PAPER)[0]])
    G = jacobian(R)
    for leg, row in zip(legs, G[1:], strict=True):
        assert abs(leg[0]) < 1e-14
        np.testing.assert_allclose(leg[1:], axes @ row, rtol=1e-9, atol=1e-12)
    # A leg's own angle 1e-6 too large has to be corrected by that.
    legs = legs_at(th1a, th2a, th3a, th1b + 1e-6, th1c - 2e-6)
    assert legs[0][0] == pytest.approx(1e-6, rel=1e-4)
    assert legs[1][0] == pytest.approx(-2e-6, rel=1e-4)
    assert legs_at(th1a, th2a, th3a, th1b, th1c, (1.0, 0.0, 1.0, 1.0))[0] == (0.0,) * 4
    assert legs_at(th1a, th2a, th3a, th1b, th1c, (1.0, 1.0, 0.0, 1.0))[1] == (0.0,) * 4


def test_residuals_are_readings_minus_predictions():
    legs = ((0.01, 1.0, 1.0, 1.0), (0.02, 1.0, 1.0, 1.0))
    residuals = residuals_of((1.0, 9.0, 2.0, 3.0, 4.0), (1.1, 3.3, 4.5, 2.7), legs)
    np.testing.assert_allclose(residuals, [0.1, 0.31, 0.52, 0.7], atol=1e-14)


def test_covariance_in_the_base_frame():
    R = tilted(0.4, 0.2, 1.0)
    joints = inverse(R)
    rng = np.random.default_rng(90)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T
    entries = tuple((2.0 * covariance[np.triu_indices(3)]).tolist())
    found, motions = in_base_frame(
        float(joints.theta1[0]), float(joints.theta2a), entries, 2.0, PAPER, FLOATS)
    axes = np.array([[0.0, 0.0, 1.0], second_axes(joints.theta1, PAPER)[0],
                     third_axes(R, PAPER)[0]])
    np.testing.assert_allclose(
        np.reshape(found, (3, 3)), axes.T @ covariance @ axes, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(motions, covariance @ axes, rtol=1e-9, atol=1e-12)


def test_sensitivity_is_the_null_vector_of_the_weighted_jacobian():
    R = tilted(0.5, 0.2, 1.0)
    sigma = SIGMA * np.array([1.0, 2.0, 0.5, 1.5])
    readings = four_angles(R)
    sample = estimate_sample(*readings.tolist(), tuple(sigma.tolist()), PAPER)
    assert np.linalg.norm(sample.sensitivity) == pytest.approx(1.0, abs=1e-12)
    weighted = jacobian(R, sensors=4) / sigma[:, None]
    np.testing.assert_allclose(
        sample.sensitivity @ weighted / np.abs(weighted).max(), 0.0, atol=1e-9)
    three = estimate_sample(
        *readings.tolist(), tuple(sigma.tolist()), PAPER, sample.quaternion, 'joint_1b')
    assert three.sensitivity is None and three.parity is None
