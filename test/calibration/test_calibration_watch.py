# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The slow watch on the calibration: a drift is reported before it is a fault."""

from dataclasses import replace
from functools import cache
from math import degrees, radians

from calibrated_rig import CalibratedRig, MODE, motion
import numpy as np
import pytest
from spm_haptic_master.calibration.watch import slip_evidence
from spm_haptic_master.calibration.watch.calibration_watch import CalibrationWatch
from spm_haptic_master.calibration.watch.slip_evidence import (
    evaluate,
    Evaluation,
    parities,
    summed,
)
from spm_haptic_master.kinematics import estimate, Geometry, inverse, quaternion_from_matrix
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Drift of th1B, deg.
DRIFT = 0.08


@cache
def rig(sensors):
    return CalibratedRig(1, sensors)


def watch(sensors):
    """Return a watch on the rig."""
    found = rig(sensors)
    return CalibrationWatch(
        found.sigma,
        found.bias,
        found.geometry,
        MODE,
    )


def feed(
    into,
    seconds,
    drift,
    seed=5,
):
    """Feed samples at 1 Hz; return the cautions at each evaluation, and the seconds."""
    found = rig(len(drift))
    angles = found.angles(motion(seed, seconds, 1.0)) + np.radians(drift)
    more = dict(zip(('theta3b', 'theta3c'), angles[:, 4:].T, strict=False))
    fitted = estimate(
        angles[:, :3],
        angles[:, 3],
        tuple(found.sigma),
        found.geometry,
        **more,
    )
    quaternions = quaternion_from_matrix(fitted.rotation).tolist()
    seen = []
    for second, row in enumerate(angles.tolist(), 1):
        into.take(tuple(quaternions[second - 1]), tuple(row))
        if second % 10 == 0:
            into.evaluate()
            seen.append((second, into.caution))
    return seen


def cautions(seen):
    """Return the cautions that were seen, each once."""
    return {caution for _, caution in seen if caution}


@pytest.mark.parametrize(('sensors', 'drifting'), [(4, 1), (6, 5)])
def test_a_drift_is_reported_with_sensor_and_size_within_minutes_until_it_is_over(
    sensors, drifting
):
    found = watch(sensors)
    none = np.zeros(sensors)
    drift = none.copy()
    drift[drifting] = DRIFT
    assert not cautions(feed(found, 600, none))
    assert 0.3 < found.evaluation.merit < 1.2
    seen = feed(found, 1000, drift, seed=6)
    first = next(second for second, caution in seen if caution)
    assert first <= 300
    estimated = degrees(found.evaluation.slip[drifting])
    assert estimated == pytest.approx(DRIFT, abs=0.015)
    name = ALL_JOINT_NAMES[drifting]
    assert found.caution == f'{name} drifted by {estimated:.2f} deg since'
    assert all(name in caution for caution in cautions(seen))
    check_frozen_at_rest(found, sensors)
    feed(found, 1000, none, seed=6)
    assert found.caution == ''


def check_frozen_at_rest(found, sensors):
    """Check that a device at rest changes no estimate."""
    before = found.evaluation.slip
    sample = at_rest(sensors)
    assert found.take(*sample)
    assert not any(found.take(*sample) for _ in range(500))
    found.evaluate()
    np.testing.assert_allclose(found.evaluation.slip, before, rtol=0.0, atol=radians(0.005))


def at_rest(sensors):
    """Return orientation and angles of a sample."""
    angles = rig(sensors).angles(motion(7, 1.0, 1.0))
    rotation = estimate(
        angles[:, :3],
        angles[:, 3],
        tuple(rig(4).sigma),
        rig(4).geometry,
    ).rotation
    quaternion = quaternion_from_matrix(rotation)[0]
    return tuple(quaternion.tolist()), tuple(angles[0].tolist())


def test_more_poses_than_are_kept_replace_the_oldest(monkeypatch):
    monkeypatch.setattr('spm_haptic_master.calibration.watch.calibration_watch.POSES', 8)
    found = watch(4)
    assert not cautions(feed(found, 600, np.zeros(4)))
    assert found.evaluation.freedom <= 8


@pytest.mark.parametrize('sensors', [4, 6])
def test_all_sensors_at_their_bias_feign_no_slip_at_one_pose(sensors):
    bias = np.full(sensors, radians(0.05))
    rotation = motion(5, 1.0, 1.0)
    joints = inverse(rotation)
    every = (
        joints.theta1,
        joints.theta3a,
        joints.theta3b,
        joints.theta3c,
    )
    true = np.column_stack(every)[:, :sensors]
    sigma = np.full(sensors, radians(0.001))

    def parities_of(angles):
        return parities(angles, rotation, sigma, Geometry(), MODE)

    for row in parities_of(true).gain[0]:
        for factor, slips in ((1.0, False), (4.0, True)):
            angles = true + factor * bias * np.sign(row)
            sums = summed(angles, parities_of(angles))
            assert evaluate(sums, bias).holds() != slips


@pytest.mark.parametrize('joint', [0, 4])
def test_samples_that_lack_a_joint_leave_no_trace(joint):
    """Neither while it is missing nor when it is back."""
    found = watch(6)
    feed(found, 60, np.zeros(6))
    before = found.evaluation.slip
    quaternion, angles = at_rest(6)
    lacking = list(angles)
    lacking[joint] = np.nan
    assert not any(found.take(quaternion, tuple(lacking)) for _ in range(20))
    found.evaluate()
    np.testing.assert_array_equal(found.evaluation.slip, before)
    assert found.take(quaternion, angles)


def turned(quaternion, angle):
    """Return an orientation after a turn about z of the base."""
    x, y, z, w = quaternion
    c = np.cos(0.5 * angle)
    s = np.sin(0.5 * angle)
    return (c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z)


def test_a_sample_counts_after_a_turn_of_a_fiftieth_of_a_radian():
    found = watch(4)
    quaternion, angles = at_rest(4)
    assert found.take(quaternion, angles) is True
    assert found.take(turned(quaternion, 0.019), angles) is False
    assert found.take(turned(quaternion, 0.021), angles) is True
    # From the last one that counted.
    assert found.take(turned(quaternion, 0.039), angles) is False
    assert found.take(quaternion, (np.nan, *angles[1:])) is False


def test_after_some_minutes_of_motion_a_sample_counts_a_third():
    """Of its number, and of all sums."""
    found = watch(4)
    quaternion, angles = at_rest(4)
    found.take(quaternion, angles)
    before = [part.sum() for part in found._sums]
    other = tuple(np.add(angles, radians(15.0)))
    for number in range(1, 301):
        found.take(turned(quaternion, 0.03 * (number % 2)), other)
    rows = found._sums.samples
    assert rows[0] == pytest.approx(1.0 / 3.0, abs=0.05)
    assert rows[0] == pytest.approx(np.exp(-1.0), rel=3e-3)
    assert found._sums.information[0].sum() == pytest.approx(before[1] * rows[0])
    assert found._sums.score[0].sum() == pytest.approx(before[2] * rows[0])
    assert rows[1] == pytest.approx(300.0 * (1.0 - rows[0]), rel=0.01)


def test_the_pose_with_the_least_weight_makes_room(monkeypatch):
    monkeypatch.setattr('spm_haptic_master.calibration.watch.calibration_watch.POSES', 3)
    found = watch(4)
    for row, pose in enumerate(((0, 0, 0), (1, 0, 0), (2, 0, 0))):
        assert found._row(pose) == row
        for part in found._sums:
            part[row] = 7.0 - row
    assert found._row((1, 0, 0)) == 1
    assert found._sums.samples.tolist() == [7.0, 6.0, 5.0]
    # A further one takes the third row, which begins anew; the third pose comes back later.
    assert found._row((0, 0, 5)) == 2
    assert found._sums.samples.tolist() == [7.0, 6.0, 0.0]
    assert not found._sums.information[2].any()
    assert not found._sums.score[2].any()
    found._sums.samples[2] = 9.0
    assert found._row((2, 0, 0)) == 1
    assert found._rows == {(0, 0, 0): 0, (0, 0, 5): 2, (2, 0, 0): 1}


HEALTHY = Evaluation(
    slip=np.radians([0.1, -0.2, 0.3, 0.4]),
    deviation=np.full(4, 1e-4),
    explained=np.zeros(4),
    together=np.zeros(4),
    misfit=25.0,
    freedom=25,
    slow=radians(0.33),
    expected=radians(0.11),
    white=1e-4,
)


def cautions_of(monkeypatch, *explained, misfit=25.0):
    """Return the cautions of evaluations in which the second sensor explains so much."""
    found = watch(4)
    found.evaluate()
    assert found.evaluation is None
    found.take(*at_rest(4))
    seen = []
    for each in explained:
        evaluation = replace(
            HEALTHY,
            explained=np.array([1.0, each, 0.0, 0.0]),
            misfit=misfit,
        )
        monkeypatch.setattr(
            slip_evidence,
            'evaluate',
            lambda *_, found=evaluation: found,
        )
        found.evaluate()
        assert found.evaluation is evaluation
        seen.append(found.caution)
    return seen


def test_a_caution_stays_until_the_drift_is_below_four_fifths_of_its_threshold(monkeypatch):
    """Of four deviations: squares of 16, and of 10.24."""
    drifted = 'joint_1b drifted by 0.20 deg since'
    seen = cautions_of(
        monkeypatch,
        15.9,
        16.1,
        10.3,
        10.2,
        15.9,
    )
    assert seen == ['', drifted, drifted, '', '']


def test_sensors_that_are_not_told_apart_are_all_named(monkeypatch):
    """And none where the best leaves more than is healthy."""
    found = replace(
        HEALTHY,
        explained=np.array([16.0, 20.0, 1.0, 17.0]),
        misfit=60.0,
    )
    monkeypatch.setattr(
        slip_evidence,
        'evaluate',
        lambda *_: found,
    )
    on = watch(4)
    on.take(*at_rest(4))
    on.evaluate()
    assert on.caution == 'joint_1b or joint_3a or joint_1a drifted since'
    assert cautions_of(monkeypatch, 30.0, misfit=120.0) == ['slow parity 0.33 deg, expected 0.11']
