# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Zero counts from a jig: found, refused, and verified."""

from dataclasses import replace
from math import radians
import random

import pytest
from rclpy.parameter import parameter_dict_from_yaml_file
from spm_haptic_master.calibration.calibration_file import (
    calibration_text,
    read_calibration,
    write_calibration,
)
from spm_haptic_master.calibration.jig_pose import (
    calibrate,
    Calibration,
    observed_directions,
    read_still,
)
from spm_haptic_master.calibration.verification import deviations
from spm_haptic_master.encoders.encoder_layout import counts_from_angle
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.geometry_settings import geometry_from, GEOMETRY_SETTINGS
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics import inverse_angles, matrix_from_zxz

PER_TURN = (16384, 16383, 36000, 4096)
ZERO = (1201, 15870, 8003, 444)
DIRECTION = (1, 1, -1, 1)
GEOMETRY = geometry_from({setting.name: setting.default for setting in GEOMETRY_SETTINGS})
LIMITS = (radians(0.1), radians(0.05))


def joint_angles(*pose_deg):
    rotation = tuple(matrix_from_zxz(*map(radians, pose_deg)).ravel())
    th1a, th1b, th1c, _, th3a = inverse_angles(rotation, GEOMETRY, (1, 1, 1))
    return th1a, th1b, th1c, th3a


FIRST, SECOND = joint_angles(135.0, 54.7356, 0.0), joint_angles(130.0, 50.0, 10.0)


def recorded(angles, sets=2000, noise_deg=0.04, drift_deg=0.0, direction=DIRECTION, zero=ZERO):
    """Return counts of encoders at rest: noise, and joint_1b drifting over the recording."""
    rng = random.Random(5)
    return [[counts_from_angle(
        angle + rng.gauss(0.0, radians(noise_deg))
        + (radians(drift_deg) * number / sets if index == 1 else 0.0),
        zero[index], direction[index], PER_TURN[index])
        for index, angle in enumerate(angles)] for number in range(sets)]


def calibrated(angles=FIRST, direction=DIRECTION, before=None, **how):
    readings = read_still(recorded(angles, **how), PER_TURN, *LIMITS)
    return calibrate(readings, angles, direction, PER_TURN, '2026-01-02T03:04:05+00:00',
                     (2.3, 0.9, 0.0), 2000, before)


def test_zero_counts_and_noise_are_found():
    found = calibrated()
    assert all(abs(got - true) <= 1 for got, true in zip(found.zero_count, ZERO, strict=True))
    for sigma, per_turn in zip(found.sigma, PER_TURN, strict=True):
        expected = (radians(0.04) ** 2 + (2.0 * 3.14159 / per_turn) ** 2 / 12.0) ** 0.5
        assert sigma == pytest.approx(expected, rel=0.05)
    assert found.direction_checked == (False,) * 4


@pytest.mark.parametrize(('how', 'reason'), [
    ({'drift_deg': 0.2}, 'the device moved: joint_1b by 0.1'),
    ({'noise_deg': 0.3}, 'joint_1a is noisy: 0.29. deg'),
    ({'sets': 60}, '60 sets of four encoders; at least 100'),
])
def test_an_unusable_recording_is_refused(how, reason):
    with pytest.raises(CalibrationError, match=reason):
        read_still(recorded(FIRST, **how), PER_TURN, *LIMITS)


@pytest.mark.parametrize('index', range(4))
def test_a_sensor_that_wraps_is_refused(index):
    zero = list(ZERO)
    zero[index] = counts_from_angle(-FIRST[index], 0, DIRECTION[index], PER_TURN[index])
    with pytest.raises(CalibrationError, match=f'{JOINT_NAMES[index]} wraps'):
        read_still(recorded(FIRST, zero=tuple(zero)), PER_TURN, *LIMITS)


def test_a_resting_device_is_not_refused_at_any_noise_within_the_limit():
    for noise in (0.0, 0.01, 0.05, 0.09):
        read_still(recorded(FIRST, noise_deg=noise), PER_TURN, *LIMITS)
    read_still(recorded(FIRST, sets=120, noise_deg=0.09), PER_TURN, *LIMITS)


def test_a_second_pose_determines_the_directions():
    wrong = calibrated(direction=(1, -1, -1, -1))
    same = read_still(recorded(FIRST), PER_TURN, *LIMITS)
    # At the first pose all is well, whatever the directions.
    assert max(map(abs, deviations(wrong, same, FIRST))) < radians(0.1)
    assert observed_directions(wrong, same, FIRST) == (0, 0, 0, 0)
    other = read_still(recorded(SECOND), PER_TURN, *LIMITS)
    assert observed_directions(wrong, other, SECOND) == DIRECTION
    off = deviations(wrong, other, SECOND)
    assert [abs(angle) > radians(1.0) for angle in off] == [False, True, False, True]
    right = calibrated(SECOND, (1, -1, -1, -1), before=wrong)
    assert right.direction == DIRECTION
    assert right.direction_checked == (True,) * 4
    assert all(abs(got - true) <= 1 for got, true in zip(right.zero_count, ZERO, strict=True))


def test_a_joint_that_hardly_moves_leaves_its_direction_open():
    near = tuple(angle + radians(0.5) for angle in FIRST)
    before = calibrated()
    readings = read_still(recorded(near), PER_TURN, *LIMITS)
    assert observed_directions(before, readings, near) == (0, 0, 0, 0)


def test_a_shaft_that_slipped_is_no_direction():
    before = calibrated()
    slipped = (ZERO[0] + 3000, *ZERO[1:])
    readings = read_still(recorded(SECOND, zero=slipped), PER_TURN, *LIMITS)
    assert observed_directions(before, readings, SECOND) == (0, *DIRECTION[1:])
    assert abs(deviations(before, readings, SECOND)[0]) > radians(10.0)


def test_the_file_holds_it_all_and_ros_loads_it(tmp_path):
    path = tmp_path / 'rig.yaml'
    found = calibrated()
    write_calibration(path, found)
    read = read_calibration(path)
    assert isinstance(read, Calibration)
    rounded = {'pose': (), 'counts': (), 'sigma': ()}
    assert replace(read, **rounded) == replace(found, **rounded)
    assert read.sigma == pytest.approx(found.sigma, abs=1e-7)
    loaded = parameter_dict_from_yaml_file(str(path), target_nodes=['/**/encoder_driver'])
    assert list(loaded['encoders.zero_count'].value.integer_array_value) == list(found.zero_count)
    assert set(loaded) == {'encoders.counts_per_turn', 'encoders.direction', 'encoders.zero_count'}
    assert 'NOT checked' in calibration_text(found)
    assert 'NOT checked' not in calibration_text(replace(found, direction_checked=(True,) * 4))


@pytest.mark.parametrize(
    'text', ['', 'a: 1', '{', 'calibration_record: {ros__parameters: {date: 1}}'])
def test_a_file_that_calibrate_did_not_write_is_refused(tmp_path, text):
    path = tmp_path / 'rig.yaml'
    path.write_text(text)
    with pytest.raises(InputError, match='not a calibration that calibrate wrote'):
        read_calibration(path)
