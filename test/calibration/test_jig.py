# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Zero counts and directions from a jig: found and refused."""

from dataclasses import replace
from itertools import combinations
from math import pi, radians

import numpy as np
import pytest
from rclpy.parameter import parameter_dict_from_yaml_file, parameter_value_to_python
from spm_haptic_master.calibration import calibration_file, jig
from spm_haptic_master.encoders.encoder_layout import counts_from_angle
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.kinematics import Geometry, inverse, matrix_from_zxz, measured_angles
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.kinematics.rotations import matrix_from_vector

PER_TURN = (16384, 16383, 36000, 4096)
ZERO = (1201, 15870, 8003, 444)
DIRECTION = (1, 1, -1, 1)
GEOMETRY = Geometry()
LIMITS = (radians(0.1), radians(0.05))


def joint_angles(*pose_deg):
    rotation = tuple(matrix_from_zxz(*map(radians, pose_deg)).ravel())
    return measured_angles(
        rotation,
        GEOMETRY,
        (1, 1, 1),
        4,
    )


POSES = (
    (135.0, 54.7356, 0.0),
    (130.0, 50.0, 10.0),
    (140.0, 60.0, 25.0),
)
FIRST, SECOND, THIRD = (joint_angles(*pose) for pose in POSES)
TOLERANCE = radians(0.1)
BIAS = (radians(0.05),) * 4


def recorded(
    angles,
    sets=2000,
    noise_deg=0.04,
    drift_deg=0.0,
    direction=DIRECTION,
    zero=ZERO,
):
    """Return counts of encoders at rest: noise, and joint_1b drifting over the recording."""
    away = np.linspace(0.0, radians(drift_deg), sets)
    drift = away[:, None] * [0.0, 1.0, 0.0, 0.0]
    random = np.random.default_rng(5)
    noise = random.normal(0.0, radians(noise_deg), (sets, 4))
    return np.array(
        [
            [
                counts_from_angle(*each)
                for each in zip(
                    row,
                    zero,
                    direction,
                    PER_TURN,
                    strict=True,
                )
            ]
            for row in (angles + drift + noise).tolist()
        ]
    )


def station(
    angles,
    stated=None,
    sets=2000,
    **how,
):
    """Return the readings at joint angles, with those that the jig states."""
    counts = recorded(angles, sets, **how)
    means, noise = jig.read_still(counts, PER_TURN, *LIMITS)
    return jig.Station(
        pose=(2.3, 0.9, 0.0),
        angles=stated or angles,
        counts=tuple(means.tolist()),
        sigma=tuple(noise.tolist()),
        sets=sets,
    )


def calibrated(*stations, direction=DIRECTION, before=None):
    return jig.calibrate(
        stations or [station(FIRST)],
        direction,
        PER_TURN,
        '2026-01-02T03:04:05+00:00',
        BIAS,
        TOLERANCE,
        before,
    )


def assert_zeros(found):
    """Check the zero counts to one count."""
    assert found.zero_count == pytest.approx(ZERO, abs=1.0)


def test_zero_counts_and_noise_are_found():
    found = calibrated()
    assert_zeros(found)
    # With the noise of the quantisation: a quiet encoder at rest repeats one count.
    quantised = [2.0 * pi / per_turn / 12.0**0.5 for per_turn in PER_TURN]
    assert found.sigma == pytest.approx(np.hypot(radians(0.04), quantised), rel=0.05)
    assert calibrated(station(FIRST, noise_deg=0.0)).sigma == pytest.approx(quantised)
    assert found.direction_verified == (False,) * 4
    # At a second pose with less noise: the mean square of both.
    less = calibrated(station(FIRST), station(FIRST, noise_deg=0.0)).sigma
    assert less[2] == pytest.approx(found.sigma[2] / 2.0**0.5, rel=0.01)


@pytest.mark.parametrize(
    ('how', 'reason'),
    [
        ({'drift_deg': 0.2}, 'the device moved: joint_1b by 0.1'),
        ({'noise_deg': 0.3}, r'joint_1a is noisy: 0\.30\d deg'),
        ({'sets': 60}, '60 sets of four encoders; at least 100'),
        *(
            (
                {
                    'zero': tuple(
                        counts_from_angle(
                            -FIRST[at],
                            0,
                            DIRECTION[at],
                            PER_TURN[at],
                        )
                        if at == index
                        else zero
                        for at, zero in enumerate(ZERO)
                    )
                },
                f'{JOINT_NAMES[index]} wraps',
            )
            for index in range(4)
        ),
    ],
)
def test_an_unusable_recording_is_refused(how, reason):
    with pytest.raises(CalibrationError, match=reason):
        jig.read_still(recorded(FIRST, **how), PER_TURN, *LIMITS)
    # A few or many sets at rest are not refused for a noise within the limit.
    for sets in (100, 2000):
        jig.read_still(recorded(FIRST, sets, 0.09), PER_TURN, *LIMITS)


WRONG = (1, -1, -1, -1)


def directions(*stations):
    return jig.observed_directions(combinations(stations, 2), PER_TURN)


def test_one_pose_verifies_no_direction_and_further_ones_determine_it():
    wrong = calibrated(direction=WRONG)
    assert (wrong.direction, wrong.direction_verified) == (WRONG, (False,) * 4)
    assert directions(station(FIRST), station(FIRST)) == (0, 0, 0, 0)
    # In one run, in a later one, and in a third one at the same pose again.
    together = calibrated(
        station(FIRST),
        station(THIRD),
        station(SECOND),
        direction=WRONG,
    )
    later = calibrated(station(SECOND), direction=WRONG, before=wrong)
    again = calibrated(station(SECOND), direction=WRONG, before=later)
    for found in (together, later, again):
        assert (found.direction, found.direction_verified) == (DIRECTION, (True,) * 4)
        assert_zeros(found)


def test_a_joint_that_hardly_moves_leaves_its_direction_open():
    near = tuple(angle + radians(0.9) for angle in FIRST)
    assert directions(station(FIRST), station(near)) == (0, 0, 0, 0)
    far = tuple(angle + radians(1.2) for angle in FIRST)
    assert directions(station(FIRST), station(far)) == DIRECTION
    # Nor does a shaft that slipped determine one.
    slipped = station(SECOND, zero=(ZERO[0] + 3000, *ZERO[1:]))
    assert directions(station(FIRST), slipped) == (0, *DIRECTION[1:])
    second = station((FIRST[0], *far[1:]))
    found = calibrated(station(FIRST), second, direction=WRONG)
    assert found.direction == (1, *DIRECTION[1:])
    assert found.direction_verified == (False, True, True, True)


def test_poses_that_contradict_each_other_are_refused():
    off = tuple(angle + radians(0.3) for angle in THIRD)
    slightly = tuple(angle + radians(0.05) for angle in THIRD)
    with pytest.raises(CalibrationError, match=r'joint_1a is [+-]0\.\d+ deg off at pose 3 of 3'):
        calibrated(station(FIRST), station(SECOND), station(THIRD, off))
    # The zero counts are the mean over the poses.
    per_radian = np.multiply(DIRECTION, PER_TURN) / (2.0 * pi)
    shift = radians(0.05) / 3.0 * per_radian
    third = station(THIRD, slightly)
    found = calibrated(station(FIRST), station(SECOND), third)
    np.testing.assert_allclose(
        found.zero_count,
        ZERO - shift,
        rtol=0.0,
        atol=1.0,
    )
    # Two in the wrong order reverse every direction, and fit; three do not.
    swapped = station(SECOND, FIRST), station(FIRST, SECOND)
    assert calibrated(*swapped).direction == tuple(-sign for sign in DIRECTION)
    with pytest.raises(CalibrationError, match='the poses contradict each other'):
        calibrated(*swapped, station(THIRD))


def test_the_error_of_the_jig_becomes_the_bias_of_each_sensor():
    """No pose off by that angle, about any axis, has a joint angle that is off by more."""
    error = radians(0.1)
    pose = [*map(radians, POSES[0])]
    bias = np.array(
        jig.jig_bias(
            pose,
            GEOMETRY,
            (1, 1, 1),
            error,
            4,
        )
    )
    axes = np.random.default_rng(3).normal(size=(2000, 3))
    turned = matrix_from_vector(
        error * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    ) @ matrix_from_zxz(*pose)
    found = inverse(turned, GEOMETRY)
    angles = np.column_stack([found.theta1, found.theta3a])
    worst = np.abs(angles - FIRST).max(axis=0)
    assert (worst <= 1.01 * bias).all()
    assert (worst >= 0.98 * bias).all()


def test_the_file_holds_it_all_and_every_node_loads_it(tmp_path):
    path = tmp_path / 'rig.yaml'
    found = calibrated(station(FIRST), station(SECOND))
    path.write_text(calibration_file.calibration_text(found, {'geometry.alpha_deg': 39.0}))
    read = calibration_file.read_calibration(path)
    assert isinstance(read, jig.Calibration)
    assert replace(read, stations=(), bias=()) == replace(found, stations=(), bias=())
    assert read.bias == pytest.approx(found.bias, abs=1e-7)
    for one, other in zip(read.stations, found.stations, strict=True):
        assert [*one.pose, *one.angles, *one.counts, *one.sigma, one.sets] == pytest.approx(
            [*other.pose, *other.angles, *other.counts, *other.sigma, other.sets], abs=1e-3
        )
    # The section is that of all nodes.
    loaded = {
        name: parameter_value_to_python(each.value)
        for name, each in parameter_dict_from_yaml_file(str(path), target_nodes=['/**']).items()
    }
    assert loaded == {
        'calibration': f'jig, {found.date}',
        'geometry.alpha_deg': 39.0,
        'encoders.counts_per_turn': list(PER_TURN),
        'encoders.direction': list(DIRECTION),
        'encoders.direction_verified': [True] * 4,
        'encoders.zero_count': list(found.zero_count),
        'sigma_deg': pytest.approx(np.degrees(found.sigma), abs=1e-6),
        'bias_deg': pytest.approx([0.05] * 4),
    }
    assert 'NOT verified' not in path.read_text()
    assert (
        'NOT verified: joint_1a, joint_1b, joint_1c, joint_3a'
        in calibration_file.calibration_text(calibrated(), {})
    )


@pytest.mark.parametrize(
    ('old', 'new', 'reason'),
    [
        ('direction: [1,', 'direction: {1,', 'not valid YAML'),
        ('/**', 'nodes', "'encoders.direction' is not set; expected a list of 4"),
        ('direction: [1, 1, -1, 1]', 'direction: [1, 1, 2, 1]', 'a list of 4, each one of 1, -1'),
        ('direction: [1, 1, -1, 1]', 'direction: [1, 1, -1]', 'expected a list of 4'),
        ('zero_count: [', 'zero_count: [7, ', 'expected a list of 4'),
        ('direction_verified: [false,', 'direction_verified: ["no",', 'no'),
        ('bias_deg: [0.05,', 'bias_deg: [.nan,', 'bias_deg'),
        ('mean_counts: [', 'mean_counts: [1.0, ', "'mean_counts' is .*; expected a list of 4"),
        ('direction_verified', 'direction_checked', 'direction_verified'),
    ],
)
def test_a_calibration_that_was_edited_wrongly_is_refused(
    tmp_path,
    old,
    new,
    reason,
):
    path = tmp_path / 'rig.yaml'
    text = calibration_file.calibration_text(calibrated(), {})
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=reason):
        calibration_file.read_calibration(path)


def at_rest(shift, sets=1000):
    """Return counts that alternate by 100, of which the last tenth is shifted."""
    counts = np.tile(np.where(np.arange(sets) % 2, 5100, 4900)[:, None], 4)
    counts[-sets // 10 :, 1] += shift
    return counts


def test_a_device_has_moved_if_the_means_of_tenths_differ_by_eight_deviations():
    """The noise is 141.4 counts, and that of the mean of a hundred sets a tenth of it."""
    per_turn = (1_000_000,) * 4
    allowed = radians(8.0 * 14.142 * 360e-6)
    mean, noise = jig.read_still(
        at_rest(112),
        per_turn,
        radians(1.0),
        radians(0.001),
    )
    np.testing.assert_allclose(mean, [5000.0, 5011.2, 5000.0, 5000.0])
    np.testing.assert_allclose(
        noise,
        radians(141.4 * 360e-6),
        rtol=1e-2,
    )
    with pytest.raises(CalibrationError, match=r'joint_1b by 0\.041 deg, limit 0\.041 deg$'):
        jig.read_still(
            at_rest(115),
            per_turn,
            radians(1.0),
            radians(0.001),
        )
    # A limit that is larger than noise makes it counts.
    jig.read_still(
        at_rest(115),
        per_turn,
        radians(1.0),
        1.05 * allowed,
    )


def test_counts_that_are_more_than_half_a_turn_apart_wrap():
    counts = np.zeros((200, 4), dtype=np.int64)
    counts[100:, 2] = 500
    with pytest.raises(CalibrationError, match='^joint_1c is noisy'):
        jig.read_still(counts, (1000,) * 4, *LIMITS)
    counts[100:, 2] = 501
    with pytest.raises(CalibrationError, match='^joint_1c wraps: its counts pass from 999 to 0 '):
        jig.read_still(counts, (1000,) * 4, *LIMITS)


def exact_station(angles_deg, counts):
    """Return the readings at stated angles, without noise."""
    return jig.Station(
        pose=(0.0, 0.0, 0.0),
        angles=tuple(np.radians(angles_deg)),
        counts=tuple(counts),
        sigma=(1e-4,) * len(counts),
        sets=100,
    )


@pytest.mark.parametrize(
    ('angle_deg', 'counts', 'direction'),
    [
        (20.0, 249.0, 1),
        (20.0, -249.0, -1),
        (20.0, 251.0, 0),
        (20.0, 151.0, 1),
        (20.0, 149.0, 0),
        (-20.0, 210.0, -1),
        (0.99, 9.9, 0),
        (1.01, 10.1, 1),
        # Across the turn of both.
        (355.0, 3550.0, 1),
    ],
)
def test_counts_that_move_as_the_jig_but_for_a_quarter_determine_a_direction(
    angle_deg,
    counts,
    direction,
):
    """Of two joints, the other of which does not move; 10 counts are a degree."""
    stations = (
        exact_station([30.0, 5.0], [100.0, 7.0]),
        exact_station([30.0 + angle_deg, 5.0], [100.0 + counts, 7.0]),
    )
    assert jig.observed_directions([stations], (3600, 3600)) == (direction, 0)
    assert jig.observed_directions([], (3600, 3600)) == (0, 0)


def test_the_zero_count_is_the_mean_and_the_pose_that_is_off_is_named():
    """Three poses with zeros of 100, 101 and 105 counts; ten are a degree."""
    angles = np.array([[10.0], [40.0], [-20.0]])
    counts = 10.0 * angles + [[100.0], [101.0], [105.0]]
    stations = [exact_station(*each) for each in zip(angles, counts, strict=True)]

    def calibrated_to(tolerance_deg):
        return jig.calibrate(
            stations,
            (1,),
            (3600,),
            'today',
            (0.1,),
            radians(tolerance_deg),
        )

    assert calibrated_to(0.51).zero_count == (102,)
    words = (
        r'^the poses contradict each other: joint_1a is \+0\.300 deg off at pose 3 of 3 '
        r'\(tolerance 0\.49 deg between two\)'
    )
    with pytest.raises(CalibrationError, match=words):
        calibrated_to(0.49)
