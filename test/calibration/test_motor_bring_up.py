# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signs of the motors and friction of the device, from motions of known ones."""

import numpy as np
import pytest
from spm_haptic_master.calibration.motor_bring_up import (
    Friction,
    identify_friction,
    MOTOR_JOINTS,
    step_response,
    StepResponse,
    wiring_faults,
)
from spm_haptic_master.exceptions import CalibrationError, InputError

TRUE = Friction(
    inertia=2e-3,
    viscous=5e-3,
    dry=4e-3,
)
TIME = np.arange(0.0, 0.4, 1e-3)


def release(
    torque,
    friction=TRUE,
    rest=0.02,
):
    """Return a release in closed form: from rest, a torque for good, until a handle moves on."""
    moved = np.maximum(TIME - rest, 0.0)
    # I theta'' + b theta' = m - c from rest.
    rate = friction.viscous / friction.inertia
    push = torque - np.sign(torque) * friction.dry
    angle = push / friction.viscous * (moved - (1.0 - np.exp(-rate * moved)) / rate)
    return TIME, 0.3 + angle, torque * (TIME > rest)


def test_inertia_and_friction_are_those_of_the_motion():
    found = identify_friction([release(0.02), release(-0.03), release(0.05)])
    assert [found.inertia, found.viscous, found.dry] == pytest.approx(
        [TRUE.inertia, TRUE.viscous, TRUE.dry], rel=0.02
    )
    # Half of what Colgate's and Schenkel's condition allows.
    assert TRUE.stiffest(0.015, 1e-3, 2e-3) == pytest.approx(0.5 * 0.02 / 2.5e-3)
    assert (
        Friction(
            inertia=1.0,
            viscous=-0.01,
            dry=0.0,
        ).stiffest(0.005, 1e-3, 1e-3)
        == 0.0
    )


def test_what_determines_no_friction_is_refused_by_its_number():
    with pytest.raises(
        CalibrationError,
        match=r'release 2 turns the handle by 0\.0\d+ rad: '
        r'expected 0\.02 or more; is the handle free\?',
    ):
        identify_friction([release(0.02), release(0.0041)])
    # Of one push without friction, inertia and dry friction look the same.
    parabola = TIME, 4.0 * np.maximum(TIME - 0.02, 0.0) ** 2, 0.016 * (TIME > 0.02)
    with pytest.raises(CalibrationError, match='releases determine 2 of inertia'):
        identify_friction([parabola])
    with pytest.raises(InputError, match='release 1 has 19 samples: expected 20 or more'):
        identify_friction([tuple(each[:19] for each in release(0.02))])
    identify_friction([tuple(each[::20] for each in release(each)) for each in (0.05, 0.1)])


def stepped(
    motor,
    torque,
    turns,
):
    """Return what a step of a torque, N m, does that turns joints, rad, across a half turn."""
    step = np.arange(30) >= 10
    angles = np.pi - 0.01 + np.outer(step, turns)
    raw = (angles + np.pi) % (2.0 * np.pi) - np.pi
    return step_response(motor, 0.3 + torque * step, raw)


@pytest.mark.parametrize('torque', [0.1, -0.1])
@pytest.mark.parametrize('turn', [0.02, -0.02, 0.0051, -0.0051, 0.0049])
def test_a_motor_is_right_where_its_own_joint_turns_in_its_own_sense(torque, turn):
    found = stepped(1, torque, [0.001, turn, -0.001, 0.03])
    assert found.is_right is (torque * turn > 0.0 and abs(turn) > 0.005)
    assert found.is_seen is (abs(turn) > 0.005)
    assert found.turns[1] == pytest.approx(np.sign(torque) * turn)
    assert not stepped(1, 0.0, [0.0, turn, 0.0, 0.0]).is_seen
    with pytest.raises(InputError, match='a step has 9 samples: expected 10 or more'):
        step_response(1, np.ones(9), np.ones((9, 4)))


# Turns of th1A, th1B, th1C, th3A, rad, by motors on th1A, th1B, th1C: the paper's mechanism.
RIGHT = (
    (0.0186, -0.0075, -0.0080, 0.0055),
    (-0.0075, 0.0184, -0.0091, -0.0142),
    (-0.0078, -0.0091, 0.0206, 0.0315),
)


def faults_of(*turns):
    """Return what is wrong with motors that turn joints so, rad."""
    return wiring_faults([StepResponse(motor, each) for motor, each in enumerate(turns)])


def scaled(turns, factor):
    """Return turns by a motor whose torque is another one."""
    return tuple(factor * turn for turn in turns)


def test_motors_that_are_wired_right_have_no_fault():
    assert faults_of(*RIGHT) == []


def test_a_direction_is_to_be_reversed_only_where_nothing_else_is_wrong():
    assert faults_of(RIGHT[0], scaled(RIGHT[1], -1.0), RIGHT[2]) == [
        'motor on th1B: sign wrong: it turns the other way: reverse its direction'
    ]


@pytest.mark.parametrize('advice', [1.0, -1.0])
def test_swapped_motors_are_named_also_after_a_wrong_advice(advice):
    """Both reversed was the advice that was once given: then the device ran away."""
    found = faults_of(scaled(RIGHT[1], advice), scaled(RIGHT[0], advice), RIGHT[2])
    assert found[:2] == [
        'motor on th1A turns th1B most: are node ids or cables swapped?',
        'motor on th1B turns th1A most: are node ids or cables swapped?',
    ]
    assert not any('reverse' in text for text in found)


def test_a_fourth_motor_that_is_swapped_is_seen_by_the_joints_between():
    """A motor on th1A turns th3A more than th1A: that alone says nothing."""
    first = (0.0316, -0.0009, -0.0040, -0.0369)
    last = (-0.0369, -0.0313, 0.0043, 0.0600)
    second = (-0.0009, 0.0268, -0.0050, -0.0313)
    third = (-0.0041, -0.0051, 0.0202, 0.0043)
    assert faults_of(first, second, third, last) == []
    # Swapped and both reversed: each own joint turns in its own sense.
    found = faults_of(
        scaled(last, -1.0),
        second,
        third,
        scaled(first, -1.0),
    )
    assert any('are motors swapped?' in text for text in found)


@pytest.mark.parametrize('motor', [0, 1, 2])
def test_a_rated_torque_that_is_ten_times_wrong_is_named(motor):
    turns = [scaled(each, 10.0 if number == motor else 1.0) for number, each in enumerate(RIGHT)]
    found = faults_of(*turns)
    assert found
    assert all('is a rated torque wrong' in text for text in found)
    assert all(f'motor on {MOTOR_JOINTS[motor]} turns' in text for text in found)


def test_a_handle_that_turns_against_its_torque_is_said_in_words():
    against = [(time, -angle, torque) for time, angle, torque in map(release, (0.02, 0.05))]
    with pytest.raises(CalibrationError, match='the handle turns against the torque'):
        identify_friction(against)


@pytest.mark.parametrize('joint', [0, 1, 2, 3])
def test_a_joint_may_pass_the_end_of_its_turn_in_a_step(joint):
    angles = np.zeros((20, 4))
    angles[:10, joint] = 3.13
    angles[10:, joint] = -3.13
    found = step_response(joint, np.where(np.arange(20) < 10, 0.0, 0.1), angles)
    expected = np.zeros(4)
    expected[joint] = 2.0 * np.pi - 6.26
    assert found.turns == pytest.approx(expected)


def test_five_samples_before_a_step_and_five_after_it_are_enough():
    step = np.arange(10) >= 5
    found = step_response(
        2,
        0.3 - 0.1 * step,
        np.outer(step, [0.01, 0.0, -0.02, 0.03]),
    )
    assert found.turns == pytest.approx((-0.01, 0.0, 0.02, -0.03))


@pytest.mark.parametrize(
    ('there', 'back', 'equal'),
    [(0.0195, 0.005, True), (0.005, 0.0195, True), (0.0205, 0.005, False), (0.0049, 0.0, True)],
)
def test_motors_turn_each_others_joints_equally_within_a_factor_of_four(
    there,
    back,
    equal,
):
    """Or by so little that it is not seen."""
    found = faults_of((0.03, there, 0.0, 0.0), (back, 0.03, 0.0, 0.0))
    assert (found == []) is equal


def test_a_motor_that_turns_the_joint_of_another_alone_is_named():
    assert faults_of((0.03, 0.0, 0.0, 0.0), (0.0051, 0.03, 0.0, 0.0)) == [
        'motor on th1B turns th1A by 0.005 rad, but the motor on th1A turns th1B by 0.000: is a '
        'rated torque wrong, or are motors swapped?'
    ]


def test_a_step_is_described_in_words():
    right = StepResponse(0, (0.02, 0.0, 0.0, 0.9))
    assert right.words == 'motor on th1A: sign right'
    assert (right.is_right, right.is_reversed, right.most_turned) == (True, False, 0)
    reverse = StepResponse(3, (0.9, 0.0, 0.0, -0.02))
    assert reverse.words == 'motor on th3A: sign wrong: it turns the other way'
    assert (reverse.is_right, reverse.is_reversed, reverse.most_turned) == (False, True, 3)
    unseen = StepResponse(1, (0.004, 0.003, 0.0, 0.9))
    assert unseen.words.startswith('motor on th1B: not seen: no joint turned')
    swapped = StepResponse(1, (0.02, 0.01, 0.0, 0.0))
    assert swapped.words.startswith('motor on th1B turns th1A most')
    assert not swapped.is_right
    assert not StepResponse(1, (-0.02, -0.01, 0.0, 0.0)).is_reversed


@pytest.mark.parametrize(('turn', 'refused'), [(0.021, False), (0.019, True)])
def test_a_release_turns_the_handle_by_a_fiftieth_of_a_radian(turn, refused):
    whole = release(0.02)
    until_then = whole[1] - 0.3 <= turn
    releases = [tuple(each[until_then] for each in whole), release(0.05)]
    if refused:
        with pytest.raises(
            CalibrationError, match=r'release 1 turns the handle by 0\.01[89]\d rad'
        ):
            identify_friction(releases)
    else:
        identify_friction(releases)


def test_a_release_whose_torque_is_there_from_the_first_sample_is_one_from_rest():
    """In steps of a tenth of a millisecond, so that trapezia are nearly the integrals."""
    time = np.arange(0.0, 0.3, 1e-4)
    releases = []
    for torque in (0.02, -0.03, 0.05):
        rate = TRUE.viscous / TRUE.inertia
        push = torque - np.sign(torque) * TRUE.dry
        angle = push / TRUE.viscous * (time - (1.0 - np.exp(-rate * time)) / rate)
        releases.append((time, angle, np.full(len(time), torque)))
    found = identify_friction(releases)
    assert [found.inertia, found.viscous, found.dry] == pytest.approx(
        [TRUE.inertia, TRUE.viscous, TRUE.dry], rel=2e-3
    )
