# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the slow parity says of slips: each figure against plain weighted least squares."""

from dataclasses import replace
from math import exp, factorial, sqrt

import numpy as np
import pytest
from simulated_hand import MODE
from spm_haptic_master.calibration.watch import slip_evidence
from spm_haptic_master.calibration.watch.slip_evidence import (
    evaluate,
    Evaluation,
    PoseSums,
    projected,
    suspects,
)
from spm_haptic_master.kinematics import Geometry, workspace_pose


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_residuals_are_split_into_a_rotation_and_what_none_explains(sensors):
    """The rotation is that of weighted least squares; the parity is what it leaves."""
    random = np.random.default_rng(1)
    rates = random.normal(size=(7, sensors, 3))
    residual = 1e-3 * random.normal(size=(7, sensors))
    sigma = random.uniform(0.5e-3, 2e-3, sensors)
    usable = np.arange(7) != 3
    found = projected(
        usable,
        residual,
        rates,
        sigma,
    )
    assert found.parity.shape == (7, sensors - 3)
    for sample in np.flatnonzero(usable):
        white = rates[sample] / sigma[:, None]
        expected = residual[sample] / sigma
        step = np.linalg.lstsq(white, expected, rcond=None)[0]
        np.testing.assert_allclose(found.step[sample], step)
        left = expected - white @ step
        assert np.linalg.norm(found.parity[sample]) == pytest.approx(np.linalg.norm(left))
        # The parity is the gain times the residual, and no rotation changes it.
        gain = found.gain[sample]
        np.testing.assert_allclose(gain @ residual[sample], found.parity[sample])
        np.testing.assert_allclose(
            gain @ rates[sample],
            0.0,
            atol=1e-9,
        )
        squares = (gain * sigma) @ (gain * sigma).T
        np.testing.assert_allclose(
            squares,
            np.eye(sensors - 3),
            atol=1e-12,
        )
    assert not found.parity[3].any()
    assert not found.gain[3].any()
    assert not found.step[3].any()


def test_orientations_out_of_reach_or_without_a_number_have_no_angles():
    rotation = workspace_pose(
        np.array([0.1, 0.1, 0.1, 0.2]),
        0.3,
        0.8,
    )
    rotation[1, 2, 0] = np.nan
    rotation[2] = np.diag([1.0, -1.0, -1.0])
    usable, matrices, angles, rates = slip_evidence.reached(
        rotation,
        Geometry(),
        MODE,
        5,
    )
    assert usable.tolist() == [True, False, False, True]
    assert not angles[[1, 2]].any()
    np.testing.assert_array_equal(rates[1], np.eye(5, 3))
    np.testing.assert_array_equal(rates[2], np.eye(5, 3))
    np.testing.assert_array_equal(matrices[1], np.eye(3))
    np.testing.assert_array_equal(matrices[[0, 2, 3]], rotation[[0, 2, 3]])
    # The Jacobian is that of differences.
    turn = np.array([[1.0, -1e-6, 0.0], [1e-6, 1.0, 0.0], [0.0, 0.0, 1.0]])
    moved = slip_evidence.sensor_angles(
        turn @ rotation[[0, 3]],
        Geometry(),
        MODE,
        5,
    )
    np.testing.assert_allclose(
        (moved - angles[[0, 3]]) / 1e-6,
        rates[[0, 3], :, 2],
        atol=1e-4,
    )


def test_poses_are_steps_of_fifteen_degrees_of_the_motors():
    turns = np.degrees(2.0 * np.pi)
    angles = np.radians(
        [
            [1.0, 14.0, -1.0, 50.0],
            [14.0, 1.0 + turns, -14.0, -99.0],
            [16.0, 14.0, -1.0, 50.0],
            [1.0, 29.0, -16.0 - turns, 50.0],
        ]
    )
    expected = [[0, 0, -1], [0, 0, -1], [1, 0, -1], [0, 1, -2]]
    assert slip_evidence.poses_of(angles).tolist() == expected


def test_samples_are_summed_by_pose():
    angles = np.radians([[1.0] * 5, [20.0] * 5, [2.0] * 5, [21.0] * 5, [22.0] * 5])
    random = np.random.default_rng(2)
    gain = random.normal(size=(5, 2, 5))
    parity = random.normal(size=(5, 2))
    usable = np.array([True, True, True, True, False])
    found = slip_evidence.Parities(
        usable,
        parity,
        gain,
        np.zeros((5, 3)),
    )
    sums = slip_evidence.summed(angles, found)
    assert sums.samples.tolist() == [2.0, 2.0]
    for pose, rows in enumerate(([0, 2], [1, 3])):
        information = sum(gain[row].T @ gain[row] for row in rows)
        score = sum(gain[row].T @ parity[row] for row in rows)
        np.testing.assert_allclose(sums.information[pose], information)
        np.testing.assert_allclose(sums.score[pose], score)


def pose_sums(sensors, poses=9):
    """Return gains and mean parities of poses with some samples each, and their sums."""
    random = np.random.default_rng(sensors)
    gain = 1e3 * random.normal(size=(poses, sensors - 3, sensors))
    parity = random.normal(size=(poses, sensors - 3))
    samples = random.integers(5, 50, poses).astype(float)
    information = samples[:, None, None] * (gain.swapaxes(1, 2) @ gain)
    score = samples[:, None] * np.einsum('mki,mk->mi', gain, parity)
    # One pose has been forgotten.
    nothing = np.zeros((1, sensors, sensors))
    sums = PoseSums(
        np.append(samples, 0.0),
        np.concatenate([information, nothing]),
        np.concatenate([score, nothing[0, :1]]),
    )
    return gain, parity, samples, sums


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_slips_are_those_of_weighted_least_squares_over_the_poses(sensors):
    """The mean parity of a pose has white noise, and half of the bias as a deviation."""
    gain, parity, samples, sums = pose_sums(sensors)
    bias = np.linspace(0.4e-3, 1.2e-3, sensors)
    found = evaluate(sums, bias)
    normal = np.zeros((sensors, sensors))
    right = np.zeros(sensors)
    misfit = 0.0
    for of_pose, mean, number in zip(
        gain,
        parity,
        samples,
        strict=True,
    ):
        covariance = np.eye(sensors - 3) / number
        covariance += of_pose @ np.diag((0.5 * bias) ** 2) @ of_pose.T
        weight = np.linalg.inv(covariance)
        normal += of_pose.T @ weight @ of_pose
        right += of_pose.T @ weight @ mean
        misfit += mean @ weight @ mean
    information = np.diag(normal)
    np.testing.assert_allclose(found.slip, right / information)
    np.testing.assert_allclose(found.deviation, 1.0 / np.sqrt(information))
    np.testing.assert_allclose(found.explained, right**2 / information)
    np.testing.assert_allclose(
        found.together,
        np.linalg.solve(normal, right),
        rtol=1e-6,
    )
    assert found.misfit == pytest.approx(misfit)
    assert found.freedom == 9 * (sensors - 3)
    assert found.poses == 9
    assert found.merit == pytest.approx(sqrt(misfit / found.freedom))


@pytest.mark.parametrize('sensors', [4, 5])
def test_the_slow_parity_and_what_is_allowed_of_it_are_in_rad(sensors):
    """A mean parity over the gain of its pose, along each of its directions."""
    gain, parity, samples, sums = pose_sums(sensors)
    bias = np.linspace(0.4e-3, 1.2e-3, sensors)
    found = evaluate(sums, bias)
    squares = np.zeros(3)
    for of_pose, mean, number in zip(
        gain,
        parity,
        samples,
        strict=True,
    ):
        left, size, right = np.linalg.svd(of_pose, full_matrices=False)
        slow = left.T @ mean / size
        white = 1.0 / (number * size**2)
        by_bias = (right**2) @ (0.5 * bias) ** 2
        squares += number * np.mean([slow**2, white + by_bias, white], axis=1)
    expected = np.sqrt(squares / samples.sum())
    assert [found.slow, found.expected, found.white] == pytest.approx(expected.tolist())


HEALTHY = Evaluation(
    slip=np.zeros(4),
    deviation=np.array([1e-4, 2e-4, 3e-4, 4e-4]),
    explained=np.zeros(4),
    together=np.zeros(4),
    misfit=20.0,
    freedom=25,
    slow=1e-4,
    expected=1e-4,
    white=1e-4,
)


def test_a_slip_shows_beyond_two_deviations_for_each_of_four_sensors():
    """All at their bound with the worst signs make twice the root of their number."""
    assert HEALTHY.threshold == pytest.approx(4.0)
    np.testing.assert_allclose(HEALTHY.visible, [4e-4, 8e-4, 12e-4, 16e-4])
    for explained, holds in ((15.9, True), (16.0, True), (16.1, False)):
        found = replace(HEALTHY, explained=np.array([0.0, explained, 1.0, 0.0]))
        assert found.holds() is holds
    # For a hysteresis half of the threshold, and half of the limit.
    for explained, holds in ((3.9, True), (4.1, False)):
        found = replace(HEALTHY, explained=np.array([0.0, explained, 1.0, 0.0]))
        assert found.holds(0.5) is holds


@pytest.mark.parametrize('freedom', [10, 26, 40, 100])
def test_a_healthy_misfit_exceeds_its_limit_once_in_thirty_thousand(freedom):
    """By the sum in which the tail of chi-square ends for an even number of degrees."""
    found = replace(HEALTHY, freedom=freedom)
    half = 0.5 * found.limit
    tail = exp(-half) * sum(half**order / factorial(order) for order in range(freedom // 2))
    assert 0.7 < 30_000 * tail < 1.3
    assert replace(found, misfit=found.limit).holds()
    assert not replace(found, misfit=1.001 * found.limit).holds()
    assert replace(found, misfit=0.49 * found.limit).holds(0.5)
    assert not replace(found, misfit=0.51 * found.limit).holds(0.5)


@pytest.mark.parametrize(
    ('left', 'freedom', 'found'),
    [
        # Three standard deviations.
        ([40.0, 48.9, 31.0, 90.0], 25, (2,)),
        ([39.9, 48.9, 31.0, 90.0], 25, (2, 0)),
        ([39.9, 31.5, 31.0, 32.0], 25, (2, 1, 3, 0)),
        # Where a quarter of what the bias allows is left: a quarter of that.
        ([5.0, 7.2, 7.3, 50.0], 32, (0, 1)),
        ([np.inf, 50.0, 1.0, np.inf], 0, (2,)),
        ([np.inf] * 4, 0, ()),
    ],
)
def test_a_sensor_is_isolated_from_those_that_leave_nine_more(
    left,
    freedom,
    found,
):
    assert suspects(np.array(left), freedom, np.inf) == found


def test_no_sensor_is_suspected_if_its_slip_leaves_more_than_the_limit():
    left = np.array([40.0, 60.0, 70.0, 80.0])
    assert suspects(left, 25, 40.0) == (0,)
    assert suspects(left, 25, 39.9) == ()
