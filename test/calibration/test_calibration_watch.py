# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The slow watch on the calibration: a drift is reported before it is a fault."""

from functools import cache
from math import degrees, radians

from calibrated_rig import CalibratedRig, MODE, motion
import numpy as np
import pytest
from spm_haptic_master.calibration.watch.calibration_watch import CalibrationWatch
from spm_haptic_master.calibration.watch.slip_evidence import evaluate, parities, summed
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
    more = {
        name: angles[:, index]
        for index, name in ((4, 'theta3b'), (5, 'theta3c'))
        if index < len(drift)
    }
    fitted = estimate(
        angles[:, :3],
        angles[:, 3],
        tuple(found.sigma),
        found.geometry,
        **more,
    )
    seen = []
    for second, (quaternion, row) in enumerate(
        zip(quaternion_from_matrix(fitted.rotation).tolist(), angles.tolist(), strict=True), 1
    ):
        into.take(tuple(quaternion), tuple(row))
        if second % 10 == 0:
            into.evaluate()
            seen.append((second, into.caution))
    return seen


@pytest.mark.parametrize(('sensors', 'drifting'), [(4, 1), (6, 5)])
def test_a_drift_is_reported_with_sensor_and_size_within_minutes_until_it_is_over(
    sensors, drifting
):
    found = watch(sensors)
    none = np.zeros(sensors)
    assert {caution for _, caution in feed(found, 600, none)} == {''}
    assert 0.3 < found.evaluation.merit < 1.2
    seen = feed(
        found,
        1000,
        DRIFT * np.eye(sensors)[drifting],
        seed=6,
    )
    first = next(second for second, caution in seen if caution)
    assert first <= 300
    drift = degrees(found.evaluation.slip[drifting])
    assert drift == pytest.approx(DRIFT, abs=0.015)
    name = ALL_JOINT_NAMES[drifting]
    assert seen[-1][1] == f'{name} drifted by {drift:.2f} deg since'
    assert all(name in caution for _, caution in seen if caution)
    # While the device rests, the estimate is frozen.
    before = found.evaluation
    sample = at_rest(sensors)
    assert found.take(*sample)
    assert not any(found.take(*sample) for _ in range(500))
    found.evaluate()
    assert found.evaluation.slip[drifting] == pytest.approx(
        before.slip[drifting], abs=radians(0.005)
    )
    feed(found, 1000, none, seed=6)
    assert found.caution == ''


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
    assert {caution for _, caution in feed(found, 600, np.zeros(4))} == {''}
    assert found.evaluation.freedom <= 8


@pytest.mark.parametrize('sensors', [4, 6])
def test_all_sensors_at_their_bias_feign_no_slip_at_one_pose(sensors):
    bias = np.full(sensors, radians(0.05))
    rotation = motion(5, 1.0, 1.0)
    found = inverse(rotation)
    true = np.column_stack([found.theta1, found.theta3a, found.theta3b, found.theta3c])[
        :, :sensors
    ]
    sigma = np.full(sensors, radians(0.001))
    gain = parities(
        true,
        rotation,
        sigma,
        Geometry(),
        MODE,
    ).gain[0]
    for row in gain:
        for factor, slips in ((1.0, False), (4.0, True)):
            angles = true + factor * bias * np.sign(row)
            sums = summed(
                angles,
                parities(
                    angles,
                    rotation,
                    sigma,
                    Geometry(),
                    MODE,
                ),
            )
            assert evaluate(sums, bias).holds() != slips


@pytest.mark.parametrize('joint', [0, 4])
def test_samples_that_lack_a_joint_leave_no_trace(joint):
    """Neither while it is missing nor when it is back."""
    found = watch(6)
    feed(found, 60, np.zeros(6))
    before = found.evaluation.slip
    quaternion, angles = at_rest(6)
    lacking = tuple(np.nan if at == joint else angle for at, angle in enumerate(angles))
    assert not any(found.take(quaternion, lacking) for _ in range(20))
    found.evaluate()
    np.testing.assert_array_equal(found.evaluation.slip, before)
    assert found.take(quaternion, angles)
