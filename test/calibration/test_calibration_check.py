# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether a calibration holds for a motion, and which sensor changed: simulated rigs."""

from functools import cache
from math import degrees, radians

from calibrated_rig import CalibratedRig, MODE, motion
import numpy as np
import pytest
from spm_haptic_master.calibration.motion import calibration_check
from spm_haptic_master.calibration.motion.calibration_check import CalibrationChecker
from spm_haptic_master.calibration.watch import slip_evidence
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import quaternion_from_matrix


@cache
def rig(seed=0, sensors=4):
    """Return a rig and its angles in 20 s of motion at 100 Hz."""
    found = CalibratedRig(seed, sensors)
    return found, found.angles(motion(2000 + seed, 20.0, 100.0))


def check(found, angles):
    """Return what a check says."""
    return CalibrationChecker(
        sigma=found.sigma,
        bias=found.bias,
        geometry=found.geometry,
        working_mode=MODE,
    ).check((angles + np.pi) % (2.0 * np.pi) - np.pi)


@pytest.mark.slow
@pytest.mark.parametrize(
    'sensors', [4, *(pytest.param(number, marks=pytest.mark.evidence) for number in (5, 6))]
)
def test_no_healthy_rig_is_reported_and_no_healthy_sensor_named(sensors):
    named = 0
    for seed in range(10):
        found, angles = rig(seed, sensors)
        healthy = check(found, angles)
        assert healthy.holds, (seed, healthy.text)
        assert healthy.evaluation.merit < 1.2
        sensor = seed % sensors
        sign = (-1) ** seed
        slip = radians(0.1) * sign * np.eye(sensors)[sensor]
        changed = check(found, angles + slip)
        assert not changed.holds, seed
        assert sensor in [each.sensor for each in changed.candidates], (seed, changed.text)
        named += changed.changed is not None
    assert named >= 9


def test_a_reversed_direction_and_angles_that_fit_nothing_are_reported(monkeypatch):
    # Fewer poses for each slip that is tried: seconds instead of half a minute.
    monkeypatch.setattr(calibration_check, 'TRIED_POSES', 10)
    found, angles = rig()
    # With harmonics of the encoder (deg): such as it may have, and larger ones.
    for harmonic, text in (
        (2.0, 'joint_3a turns in the opposite direction'),
        (3.0, 'no change of one sensor explains the angles'),
    ):
        second = np.radians([0.0, 0.0, 0.0, harmonic]) * np.cos(2.0 * angles[::8])
        read = angles[::8] + second
        result = check(found, read * [1.0, 1.0, 1.0, -1.0])
        assert not result.holds
        assert result.text == text
    exchanged = angles[::8, [1, 2, 0, 3]]
    result = check(found, exchanged + np.array([1.0, -1.2, 0.7, 0.0]))
    assert not result.holds
    assert result.changed is None
    assert result.usable < 0.9
    assert result.text == text


def test_a_small_motion_decides_nothing_but_a_slip_that_shows():
    found, _ = rig()
    angles = found.angles(
        motion(
            7,
            20.0,
            100.0,
            tilt=3.0,
            turn=5.0,
        )
    )
    with pytest.raises(CalibrationError, match=r'too small to decide.*joint_3a \d.*turn it'):
        check(found, angles)
    slip = np.radians([0.0, 1.0, 0.0, 0.0])
    assert not check(found, angles + slip).holds


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_the_parity_of_a_sample_is_that_of_a_batch(sensors):
    found = CalibratedRig(3, sensors)
    rotation = motion(5, 1.0, 20.0)
    angles = found.angles(rotation)
    batch = slip_evidence.parities(
        angles,
        rotation,
        found.sigma,
        found.geometry,
        MODE,
    )
    for index, quaternion in enumerate(quaternion_from_matrix(rotation).tolist()):
        turns = 2.0 * np.pi * (np.arange(sensors) - index % 3)
        one = slip_evidence.parity_of_sample(
            (angles[index] + turns).tolist(),
            tuple(quaternion),
            found.sigma,
            found.geometry,
            MODE,
        )
        np.testing.assert_allclose(
            one.gain[0].T @ one.parity[0],
            batch.gain[index].T @ batch.parity[index],
            rtol=1e-6,
            atol=1e-3,
        )
        np.testing.assert_allclose(
            one.gain[0].T @ one.gain[0],
            batch.gain[index].T @ batch.gain[index],
            rtol=1e-6,
            atol=1e-3,
        )


def checked_rig(sensors):
    """Return a rig, and its angles in a motion of 20 s."""
    found = CalibratedRig(2, sensors)
    return found, found.angles(motion(2002, 20.0, 25.0))


def slipped(angles, **degrees_by_place):
    """Return angles after slips, deg, of the sensors named s0, s1, ..."""
    changed = angles.copy()
    for place, slip in degrees_by_place.items():
        changed[:, int(place[1:])] += radians(slip)
    return changed


@pytest.mark.parametrize('sensors', [4, 6])
def test_a_calibration_holds_and_says_which_slips_would_show(sensors):
    found, angles = checked_rig(sensors)
    result = check(found, angles)
    evaluation = result.evaluation
    assert result.holds
    assert 0.5 < evaluation.merit < 1.0
    assert 20 <= evaluation.poses <= 30
    assert evaluation.freedom == evaluation.poses * (sensors - 3)
    # Beyond 99.997 % of chi-square; for 75 degrees 137, for 25 64.
    assert evaluation.limit == pytest.approx({25: 64.0, 75: 134.4}[evaluation.freedom], rel=0.01)
    # White noise of 0.04 deg, averaged over the 20 samples of a pose.
    assert degrees(evaluation.white) == pytest.approx(0.009, rel=0.1)
    visible = np.degrees(evaluation.visible)
    assert (visible > 0.02).all()
    assert (visible < 0.1).all()
    # A slip of just so much shows, half of it does not.
    for place, slip in enumerate(visible):
        assert not check(found, slipped(angles, **{f's{place}': 1.5 * slip})).holds
        assert check(found, slipped(angles, **{f's{place}': 0.2 * slip})).holds


@pytest.mark.parametrize('sensors', [4, 6])
def test_a_small_slip_is_measured(sensors):
    found, angles = checked_rig(sensors)
    result = check(found, slipped(angles, s1=0.2))
    assert not result.holds
    assert result.changed.sensor == 1
    assert not result.changed.turned
    assert degrees(result.changed.slip) == pytest.approx(0.2, abs=0.03)
    assert result.text.startswith('joint_1b slipped by +0.1')


def test_a_slip_beyond_the_first_order_is_measured():
    found, angles = checked_rig(4)
    result = check(found, slipped(angles, s3=2.5))
    assert result.changed.sensor == 3
    assert degrees(result.changed.slip) == pytest.approx(2.5, abs=0.05)


def test_slips_of_two_sensors_are_no_slip_of_one():
    found, angles = checked_rig(4)
    result = check(found, slipped(angles, s1=0.3, s3=0.4))
    assert result.changed is None
    assert result.text.startswith('several zeros moved: joint_1a by')
    assert np.degrees(result.several) == pytest.approx([0.0, 0.3, 0.0, 0.4], abs=0.05)
