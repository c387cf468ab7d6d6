# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether a calibration holds for a motion, and which sensor changed: simulated rigs."""

from dataclasses import replace
from functools import cache
from math import degrees, radians, tau

from calibrated_rig import CalibratedRig, MODE, motion
import numpy as np
import pytest
from spm_haptic_master.calibration.motion import calibration_check
from spm_haptic_master.calibration.motion.calibration_check import (
    CalibrationChecker,
    Check,
    Hypothesis,
)
from spm_haptic_master.calibration.watch import slip_evidence
from spm_haptic_master.calibration.watch.slip_evidence import Evaluation
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import Geometry, quaternion_from_matrix
from spm_haptic_master.kinematics.rotations import wrapped


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


# Noise and bias of the checker below, rad.
SIGMA = radians(0.04)
BIAS = np.radians([0.1, 0.2, 0.03, 0.1])
HEALTHY = Evaluation(
    slip=np.zeros(4),
    deviation=np.full(4, 1e-4),
    explained=np.zeros(4),
    together=np.zeros(4),
    misfit=20.0,
    freedom=25,
    slow=1e-4,
    expected=1e-4,
    white=1e-4,
)


def checker(progress=lambda text, share: None):
    """Return a checker of a rig as drawn."""
    return CalibrationChecker(
        sigma=np.full(4, SIGMA),
        bias=BIAS,
        geometry=Geometry(),
        working_mode=MODE,
        progress=progress,
    )


def evaluated_by(monkeypatch, evaluation_of):
    """Replace the evaluation of angles; return the list of the angles that were evaluated."""
    seen = []

    def evaluated(self, angles):
        seen.append(angles)
        return evaluation_of(angles), 1.0

    monkeypatch.setattr(
        CalibrationChecker,
        '_evaluated',
        evaluated,
    )
    return seen


def test_two_thousand_samples_from_the_first_to_the_last_are_evaluated(monkeypatch):
    seen = evaluated_by(monkeypatch, lambda angles: HEALTHY)
    result = checker().check(np.arange(20_000.0).reshape(5000, 4))
    assert result.holds
    rows = seen[0][:, 0] / 4.0
    assert len(rows) == pytest.approx(2000, abs=1)
    assert (rows[0], rows[-1]) == (0.0, 4999.0)
    assert set(np.diff(rows)) == {2.0, 3.0}
    checker().check(np.arange(400.0).reshape(100, 4))
    assert len(seen[1]) == 100


@pytest.mark.parametrize(('usable', 'is_evaluated'), [(0.91, True), (0.9, True), (0.89, False)])
def test_angles_of_which_nine_tenths_fit_are_evaluated(
    monkeypatch,
    usable,
    is_evaluated,
):
    angles = motion_angles(100)
    number = round(100 * usable)
    found = checker()._solved(angles)
    parities = found._replace(usable=np.arange(100) < number)
    monkeypatch.setattr(
        CalibrationChecker,
        '_solved',
        lambda self, angles: parities,
    )
    evaluation, share = checker()._evaluated(angles)
    assert (evaluation is not None) is is_evaluated
    assert share == pytest.approx(usable)


def motion_angles(count, seed=5):
    """Return exact angles of a motion of the rig as drawn."""
    rotation = motion(seed, 1.0, count)
    return slip_evidence.sensor_angles(
        rotation,
        Geometry(),
        MODE,
        4,
    )


def test_the_parity_is_that_of_the_best_orientations():
    """From the closed form of the readings: a further step changes no orientation."""
    angles = motion_angles(20) + radians(2.0) * np.random.default_rng(2).normal(size=(20, 4))
    found = checker()._solved(angles)
    assert found.usable.all()
    assert np.abs(found.step).max() < 1e-5
    # What fits no orientation has none, and leaves the others as they are.
    angles[3, 0] += 2.5
    again = checker()._solved(angles)
    assert not again.usable[3] or np.abs(again.step[3]).max() > 0.01
    others = np.arange(20) != 3
    np.testing.assert_array_equal(again.parity[others], found.parity[others])


@pytest.mark.parametrize(
    ('deviation_deg', 'words'),
    [
        ([0.049, 0.099, 0.019, 0.049], None),
        (
            [0.049, 0.101, 0.021, 0.049],
            'the motion is too small to decide: in 25 poses only slips beyond joint_1b 0.40, '
            'joint_1c 0.08 deg would show, expected 0.40; tilt the handle farther in all '
            'directions and turn it farther both ways',
        ),
    ],
)
def test_a_motion_has_to_show_a_slip_of_twice_the_bias_or_noise(deviation_deg, words):
    """Four of its deviations are seen of four sensors."""
    found = replace(HEALTHY, deviation=np.radians(deviation_deg))
    if words is None:
        checker()._check_decidable(found)
        return
    with pytest.raises(CalibrationError) as refusal:
        checker()._check_decidable(found)
    assert str(refusal.value) == words


def slipping(
    monkeypatch,
    slips,
    share=1.0,
    left=20.0,
    slow=1e-4,
    offset=0.0,
):
    """Let readings be slips alone, of which an evaluation sees a share; return the readings."""
    readings = np.tile(np.asarray(slips, dtype=float), (7, 1))

    def evaluation_of(angles):
        away = wrapped(angles[0] - offset)
        return replace(
            HEALTHY,
            slip=share * away,
            together=share * away,
            explained=(away / 1e-3) ** 2,
            misfit=left + float(((away / 1e-3) ** 2).sum()),
            slow=slow,
        )

    return readings, evaluated_by(monkeypatch, evaluation_of)


def test_a_slip_is_refined_until_it_no_longer_changes(monkeypatch):
    """By a thousandth of a degree, at most six times."""
    readings, seen = slipping(monkeypatch, [0.0, 0.02, 0.0, 0.0])
    found = checker()._refined(
        readings,
        1,
        False,
        0.015,
    )
    assert found.slip == pytest.approx(0.02)
    assert found.left == pytest.approx(20.0)
    assert found.deviation == 1e-4
    assert found.explains
    assert found.fits
    assert (found.sensor, found.turned) == (1, False)
    assert len(seen) == 2
    # Half of what is left is found each time: the last change is less than a thousandth.
    readings, seen = slipping(
        monkeypatch,
        [0.0, 0.02, 0.0, 0.0],
        share=0.5,
    )
    start = 0.02 - radians(0.0025)
    assert (
        checker()
        ._refined(
            readings,
            1,
            False,
            start,
        )
        .slip
        < 0.02
    )
    assert len(seen) == 2
    readings, seen = slipping(
        monkeypatch,
        [0.0, 0.02, 0.0, 0.0],
        share=0.1,
    )
    checker()._refined(
        readings,
        1,
        False,
        0.0,
    )
    assert len(seen) == 6
    # What the slip itself explains is not left, even if it is not followed.
    readings, seen = slipping(
        monkeypatch,
        [0.0, 0.02, 0.0, 0.0],
        share=0.0,
    )
    assert checker()._refined(
        readings,
        1,
        False,
        0.0,
    ).left == pytest.approx(20.0)
    assert len(seen) == 1


def test_a_slip_of_a_reversed_sensor_is_that_of_its_right_direction(monkeypatch):
    """Beyond half a turn it is one the other way."""
    readings, _ = slipping(monkeypatch, [0.0, 0.0, 3.0, 0.0])
    found = checker()._refined(
        readings,
        2,
        True,
        -2.9,
    )
    assert found.turned
    assert found.slip == pytest.approx(-3.0)
    readings, _ = slipping(monkeypatch, [0.0, 0.0, 3.3, 0.0])
    assert checker()._refined(
        readings,
        2,
        False,
        3.1,
    ).slip == pytest.approx(3.3 - tau)


@pytest.mark.parametrize(
    ('slip_deg', 'other', 'left', 'slow_deg', 'explains', 'fits'),
    [
        (0.9, False, 63.0, 0.01, True, True),
        (0.9, False, 65.0, 0.01, False, False),
        # After a large change harmonics at other angles explain up to 0.3 deg.
        (1.1, False, 65.0, 0.29, False, True),
        (1.1, False, 65.0, 0.31, False, False),
        (0.0, True, 65.0, 0.29, False, True),
        (1.1, False, 63.0, 0.31, True, True),
    ],
)
def test_a_change_fits_if_noise_bias_or_harmonics_explain_the_rest(
    monkeypatch,
    slip_deg,
    other,
    left,
    slow_deg,
    explains,
    fits,
):
    """Of a misfit with 25 degrees of freedom 64 is healthy."""
    slips = [0.0, 0.0, radians(slip_deg), 0.0]
    readings, _ = slipping(
        monkeypatch,
        slips,
        left=left,
        slow=radians(slow_deg),
    )
    found = checker()._refined(
        readings,
        2,
        other,
        0.0,
    )
    assert (found.explains, found.fits) == (explains, fits)


def test_a_change_with_which_the_angles_fit_nothing_leaves_all(monkeypatch):
    evaluated_by(monkeypatch, lambda angles: None)
    found = checker()._refined(
        np.zeros((5, 4)),
        3,
        True,
        0.5,
    )
    assert found == Hypothesis(sensor=3, turned=True, slip=0.5)
    assert found.left == np.inf
    assert not found.explains
    assert not found.fits


@pytest.mark.parametrize(('left', 'known'), [(63.0, True), (65.0, False)])
def test_slips_of_all_sensors_explain_what_is_left_healthy(
    monkeypatch,
    left,
    known,
):
    slips = [0.01, -0.02, 0.0, 0.03]
    readings, seen = slipping(monkeypatch, slips, left=left)
    found = checker()._several(readings)
    if known:
        np.testing.assert_allclose(
            found,
            slips,
            atol=1e-12,
        )
    else:
        assert found is None
    assert len(seen) == 2
    # The last step is less than a thousandth of a degree.
    readings, seen = slipping(
        monkeypatch,
        np.radians([0.003, 0.0, 0.0, 0.0]),
        share=0.5,
    )
    assert checker()._several(readings)[0] == pytest.approx(radians(0.0015))
    readings, _ = slipping(monkeypatch, slips, share=0.01)
    assert checker()._several(readings) is None
    evaluated_by(monkeypatch, lambda angles: None)
    assert checker()._several(readings) is None


def hypotheses_of(monkeypatch, evaluation):
    """Return the starts of the hypotheses of all sensors, and the shares done."""
    starts = []
    shares = []

    def refined(
        self,
        angles,
        sensor,
        other,
        slip,
    ):
        starts.append((sensor, other, slip))
        return Hypothesis(
            sensor,
            other,
            slip,
            left=10.0 - slip,
        )

    monkeypatch.setattr(
        CalibrationChecker,
        '_refined',
        refined,
    )
    monkeypatch.setattr(
        CalibrationChecker,
        '_tried',
        lambda self, angles, sensor, other: 2.0 + other,
    )
    angles = motion_angles(60)
    found = checker(lambda text, share: shares.append((text, share)))._hypotheses(
        angles, evaluation
    )
    assert shares == [
        (f'changes of joint_{name}', 0.25 * number)
        for number, name in enumerate(('1a', '1b', '1c', '3a'))
    ]
    # The best one of each sensor: here that with the largest slip.
    for sensor, each in enumerate(found):
        assert each.slip == max(slip for of, _, slip in starts if of == sensor)
    return [(other, slip) for sensor, other, slip in starts if sensor == 2]


@pytest.mark.parametrize(('slow_deg', 'is_large'), [(0.9, False), (1.1, True)])
def test_slips_over_the_turn_are_tried_where_the_parity_is_large(
    monkeypatch,
    slow_deg,
    is_large,
):
    evaluation = replace(
        HEALTHY,
        slip=np.arange(4.0) / 10.0,
        slow=radians(slow_deg),
    )
    starts = hypotheses_of(monkeypatch, evaluation)
    tried = [(False, 2.0), (True, 3.0)]
    assert starts == [(False, 0.2), *(tried if is_large else [])]
    assert hypotheses_of(monkeypatch, None) == tried


@pytest.mark.parametrize(('slip_deg', 'other'), [(41.0, False), (-100.0, False), (64.0, True)])
def test_a_slip_is_found_by_trying_all_of_a_turn(slip_deg, other):
    """To half of a step of three degrees; one pose in ten may fit nothing."""
    angles = motion_angles(10)
    sign = -1.0 if other else 1.0
    angles[:, 3] = wrapped(sign * (angles[:, 3] + radians(slip_deg)))
    angles[4, 0] += 2.0
    tried = checker()._tried(angles, 3, other)
    assert degrees(wrapped(tried - radians(slip_deg))) == pytest.approx(0.0, abs=1.6)


def verdict(
    monkeypatch,
    hypotheses,
    evaluation,
    several=None,
):
    """Return what is said of angles that a calibration does not explain."""
    monkeypatch.setattr(
        CalibrationChecker,
        '_hypotheses',
        lambda *_: hypotheses,
    )
    monkeypatch.setattr(
        CalibrationChecker,
        '_several',
        lambda *_: several,
    )
    return checker()._changed(
        np.zeros((5, 4)),
        evaluation,
        0.95,
    )


def of_sensors(*left, explains=(), fits=()):
    """Return a hypothesis for each sensor, by what it leaves."""
    return [
        Hypothesis(
            sensor=sensor,
            turned=False,
            slip=0.1 * (sensor + 1),
            deviation=0.01,
            left=each,
            explains=sensor in explains,
            fits=sensor in (*fits, *explains),
        )
        for sensor, each in enumerate(left)
    ]


def test_one_sensor_that_fits_alone_is_named(monkeypatch):
    found = verdict(
        monkeypatch,
        of_sensors(
            90.0,
            20.0,
            95.0,
            80.0,
            explains=(1,),
        ),
        HEALTHY,
    )
    assert found.text == 'joint_1b slipped by +11.46 deg (+- 0.57)'
    assert found.changed == found.candidates[0]
    assert found.usable == 0.95
    assert not replace(found, evaluation=None).holds
    # Angles that fit nothing as they are may fit after one slip.
    found = verdict(
        monkeypatch,
        of_sensors(
            np.inf,
            20.0,
            np.inf,
            np.inf,
            fits=(1,),
        ),
        None,
    )
    assert found.changed.sensor == 1
    # Two that leave next to nothing are not told apart by less than three deviations.
    found = verdict(
        monkeypatch,
        of_sensors(
            np.inf,
            0.5,
            9.3,
            np.inf,
            fits=(1, 2),
        ),
        None,
    )
    assert found.changed is None
    assert len(found.candidates) == 2


def test_sensors_that_fit_about_as_well_are_candidates(monkeypatch):
    hypotheses = of_sensors(
        90.0,
        27.2,
        27.0,
        20.0,
        explains=(1, 3),
    )
    found = verdict(
        monkeypatch,
        hypotheses,
        HEALTHY,
        np.zeros(4),
    )
    assert found.changed is None
    assert [each.sensor for each in found.candidates] == [3, 1]
    assert found.text == (
        'not isolated: joint_3a slipped by +22.92 deg (+- 0.57), or joint_1b slipped by '
        '+11.46 deg (+- 0.57)'
    )


def test_slips_of_several_sensors_are_named_where_none_alone_explains_the_angles(monkeypatch):
    several = np.radians([0.1, -0.2, 0.0, 0.3])
    found = verdict(
        monkeypatch,
        of_sensors(
            90.0,
            80.0,
            70.0,
            99.0,
            fits=(2,),
        ),
        HEALTHY,
        several,
    )
    assert found.text == (
        'several zeros moved: joint_1a by +0.10 deg, joint_1b by -0.20 deg, joint_1c by '
        '+0.00 deg, joint_3a by +0.30 deg'
    )
    assert found.changed is None
    # Not where the angles fit nothing: then they are no small slips.
    alone = of_sensors(
        90.0,
        80.0,
        7.0,
        99.0,
        fits=(2,),
    )
    assert (
        verdict(
            monkeypatch,
            alone,
            None,
            several,
        ).changed.sensor
        == 2
    )
    assert verdict(monkeypatch, alone, HEALTHY).changed.sensor == 2


def test_that_no_change_of_one_sensor_explains_the_angles_is_said(monkeypatch):
    found = verdict(
        monkeypatch,
        of_sensors(
            90.0,
            20.0,
            70.0,
            99.0,
        ),
        HEALTHY,
    )
    assert found.text == 'no change of one sensor explains the angles'
    assert found.changed is None
    assert found.candidates == ()
    turned = Hypothesis(sensor=0, turned=True, slip=0.0)
    assert Check(None, 0.5, changed=turned).text == 'joint_1a turns in the opposite direction'
