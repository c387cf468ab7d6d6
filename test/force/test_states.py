# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""When force begins, goes on and ends, what it renders, and no torque in other states."""

from dataclasses import replace
import math
import random

from bench import ANGLES, at, Bench, MS, POSE, STILL, TORQUE, turned
from benchmarks.model_costs import force
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.force import (
    DrivesState,
    FORCE_STATES,
    ForceCondition,
    ForceController,
    ForceLimits,
    ForceState,
    Gravity,
    Wrench,
)
from spm_haptic_master.force.samples import ENDS_ALL, ForceReason, LATCHED
from spm_haptic_master.kinematics import workspace_pose

NAN = math.nan
ZERO = (0.0, 0.0, 0.0)
# A locked orientation 0.1 rad away, and the torque towards it.
LOCK = turned(0.1)
PULL = (0.0, 0.1, 0.0)
POWERED = (ForceCondition.ENGAGED, ForceCondition.HOLDING, ForceCondition.FADING)
# What ends force, and for what reason.
ENDS = [
    ({'enabled': False}, ForceReason.DISABLED),
    ({'engaged': False}, ForceReason.DISENGAGED),
    ({'present': False}, ForceReason.ABSENT),
    ({'drives': DrivesState.OFF}, ForceReason.DRIVES_OFF),
    ({'drives': DrivesState.FAULT}, ForceReason.DRIVE),
    ({'quaternion': None, 'velocity': None}, ForceReason.NO_ORIENTATION),
    ({'protection_level': math.radians(1.1)}, ForceReason.UNPROTECTED),
    ({'protection_level': NAN}, ForceReason.UNPROTECTED),
    ({'noise': 5.1}, ForceReason.NOISY),
    ({'noise': NAN}, ForceReason.NOISY),
    ({'velocity': (8.0, 7.0, 0.0)}, ForceReason.SPEED),
    ({'velocity': (NAN, 0.0, 0.0)}, ForceReason.SPEED),
    ({'angles': (NAN, *ANGLES[1:])}, ForceReason.ANGLE),
    ({'sources': 2}, ForceReason.SOURCES),
    ({'wrench': Wrench(0, TORQUE)}, ForceReason.STALE),
    ({'wrench': Wrench(10**12, TORQUE)}, ForceReason.STALE),
    ({'wrench': None}, ForceReason.STALE),
    ({'wrench': Wrench(0, (NAN, 0.0, 0.0))}, ForceReason.NOT_FINITE),
    ({'lock': (NAN, 0.0, 0.0, 1.0)}, ForceReason.NOT_FINITE),
    ({'lock': (0.0, -math.inf, 0.0, 1.0)}, ForceReason.NOT_FINITE),
]


def texts(bench):
    """Return the states of a bench, each change once."""
    found = []
    for output in bench.outputs:
        if not found or output.state.text != found[-1]:
            found.append(output.state.text)
    return found


def size(torque):
    """Return the size of a torque on the handle, N m."""
    return np.linalg.norm(torque)


def steps(bench, count):
    """Return how far the torque on the handle went in each of the latest samples, N m."""
    felt = np.array([output.rendered for output in bench.outputs[-count:]])
    return np.linalg.norm(np.diff(felt, axis=0), axis=1)


def test_the_way_to_force_and_back():
    bench = Bench()
    bench.engage()
    bench.run(50, clutched=True)
    bench.torque = STILL
    bench.run(10)
    bench.run(30, present=False)
    assert texts(bench) == [
        'off',
        'ready',
        'engaged',
        'holding',
        'engaged',
        f'fading: {ForceReason.ABSENT.value}',
        'ready',
    ]


def test_ready_needs_a_tenth_of_a_second_without_a_break():
    bench = Bench()
    bench.run(90)
    bench.step(drives=DrivesState.OFF)
    assert bench.run(95).state.text == 'off'
    assert bench.run(10).state.text != 'off'


@pytest.mark.parametrize('motors', [3, 4])
def test_the_torque_of_the_wrench_is_rendered(motors):
    bench = Bench(motors)
    output = bench.engage()
    np.testing.assert_allclose(output.rendered, TORQUE, atol=1e-12)
    np.testing.assert_allclose(output.asked, TORQUE, atol=1e-12)
    assert len(output.motor_torque) == motors
    # A wrench in the handle's frame turns with it.
    for _ in range(50):
        output = bench.step(wrench=Wrench(bench.now, TORQUE, in_handle=True))
    np.testing.assert_allclose(output.rendered, POSE @ TORQUE, atol=1e-12)


@pytest.mark.parametrize('axis', np.eye(3))
def test_damping_opposes_the_turn_of_the_handle_about_each_axis(axis):
    bench = Bench(4)
    bench.engage()
    output = bench.run(5, velocity=tuple((2.0 * axis).tolist()))
    added = np.array(output.rendered) - TORQUE
    assert added @ axis <= -0.005 * 2.0 * (1.0 - 1e-9)
    np.testing.assert_allclose(added - (added @ axis) * axis, 0.0, atol=1e-12)


def test_a_larger_torque_keeps_its_direction():
    output = Bench().engage((0.0, 6.0, 8.0))
    np.testing.assert_allclose(output.asked, (0.0, 0.18, 0.24), atol=1e-12)


def test_engaging_with_a_torque_already_commanded():
    """Nothing until the wrench is small in three messages; then no step, and 10 N m/s at most."""
    bench = Bench()
    bench.torque = (0.18, 0.0, 0.24)
    bench.run(1000)
    assert bench.outputs[-1].state.condition is ForceCondition.READY
    assert all(output.motor_torque == ZERO for output in bench.outputs)
    bench.torque = (0.0, 0.0, 0.04)
    bench.run(2)
    bench.torque = (0.18, 0.0, 0.24)
    bench.run(100)
    assert bench.outputs[-1].state.condition is ForceCondition.READY
    bench.torque = (0.0, 0.0, 0.04)
    assert bench.run(2).state.condition is ForceCondition.READY
    assert bench.run(1).state.condition is ForceCondition.ENGAGED
    bench.torque = (0.18, 0.0, 0.24)
    assert bench.run(800).rendered == pytest.approx((0.18, 0.0, 0.24))
    assert steps(bench, len(bench.outputs)).max() <= 0.01 + 1e-9


def test_the_wrench_comes_up_in_half_a_second():
    bench = Bench()
    bench.torque = STILL
    while bench.step().state.condition is not ForceCondition.ENGAGED:
        pass
    bench.torque = (0.0, 0.0, 0.3)
    asked = [bench.run(100).asked[2] for _ in range(6)]
    assert asked == pytest.approx([0.06, 0.12, 0.18, 0.24, 0.3, 0.3], abs=0.002)


def test_a_message_that_repeats_is_not_three_small_ones():
    bench = Bench()
    bench.run(2)
    first = bench.wrench
    bench.torque = None
    for _ in range(200):
        bench.wrench = replace(first, received=first.received)
        bench.step()
    assert ForceCondition.ENGAGED not in {output.state.condition for output in bench.outputs}


def end_force(bench, changed, reason):
    """Have what ends force come while a torque is made; return the outputs before and at it."""
    before = bench.engage()
    if reason is ForceReason.STALE:
        bench.torque = None
    return before, bench.step(**changed)


def assert_goes_down(output, before):
    """Assert that no motor turns up, or to the other side."""
    for new, old in zip(output.motor_torque, before.motor_torque, strict=True):
        assert abs(new) <= abs(old)
        assert new * old >= 0.0


@pytest.mark.parametrize(('changed', 'reason'), ENDS)
@pytest.mark.parametrize('motors', [3, 4])
def test_what_ends_force_lets_each_motor_go_down_steadily(changed, reason, motors):
    """In 15 ms, after a drive's fault in 5."""
    bench = Bench(motors)
    previous, output = end_force(bench, changed, reason)
    assert max(map(abs, previous.motor_torque)) > 0.05
    assert output.state.text == f'fading: {reason.value}'
    assert output.obstacle is reason
    for _ in range(15):
        assert_goes_down(output, previous)
        previous = output
        output = bench.step(**changed)
    assert not any(output.motor_torque)
    if reason is ForceReason.DRIVE:
        assert not any(bench.outputs[-12].motor_torque)


@pytest.mark.parametrize(('changed', 'reason'), ENDS)
@pytest.mark.parametrize('motors', [3, 4])
def test_after_what_ended_force_it_begins_again_where_it_may(changed, reason, motors):
    """What latches waits for one acknowledgement."""
    bench = Bench(motors)
    end_force(bench, changed, reason)
    for _ in range(15):
        bench.step(**changed)
    bench.torque = STILL
    after = bench.run(700)
    if reason in LATCHED:
        assert after.state.text == f'fault: {reason.value}'
        assert bench.controller.acknowledge()
        assert not bench.controller.acknowledge()
        assert bench.step().state.text == 'off'
    bench.engage()
    assert bench.outputs[-1].state.condition is ForceCondition.ENGAGED


@pytest.mark.parametrize(('changed', 'reason'), ENDS)
def test_what_ends_force_does_not_let_it_begin(changed, reason):
    bench = Bench()
    if reason is ForceReason.STALE:
        bench.run(90)
        bench.torque = None
    bench.run(300, **changed)
    for output in bench.outputs:
        assert output.motor_torque == ZERO
        assert output.state.condition in (ForceCondition.OFF, ForceCondition.READY)


def test_an_encoder_that_jumps_turns_no_motor_up():
    """Its orientation is withheld at once; the joint damping of the fade follows no jump."""
    bench = Bench()
    before = bench.engage()
    a, b, c, third = ANGLES
    jumped = {
        'angles': (a, b + math.radians(5.0), c, third),
        'quaternion': None,
        'velocity': None,
    }
    for _ in range(20):
        output = bench.step(**jumped)
        assert_goes_down(output, before)
        before = output
    assert output.state.why is ForceReason.NO_ORIENTATION


def test_torque_of_before_a_fade_does_not_come_back():
    bench = Bench()
    bench.engage()
    bench.run(40, present=False)
    bench.torque = STILL
    while bench.step().state.condition is not ForceCondition.ENGAGED:
        assert bench.outputs[-1].asked == ZERO
    assert bench.outputs[-1].asked == ZERO
    assert np.linalg.norm(bench.outputs[-1].rendered) < 1e-3


WEIGHT = Gravity(handle=(0.0, 0.0, 0.004))
WRENCH_ALONE = (
    ForceReason.DISENGAGED,
    ForceReason.ABSENT,
    ForceReason.STALE,
    ForceReason.NOT_FINITE,
    ForceReason.SOURCES,
)
OF_THE_WRENCH = [end for end in ENDS if end[1] in WRENCH_ALONE]
OF_ALL = [end for end in ENDS if end[1] in ENDS_ALL]


@pytest.mark.parametrize(('changed', 'reason'), OF_THE_WRENCH)
def test_what_says_nothing_about_orientation_or_motors_ends_the_wrench_alone(changed, reason):
    """A1: the weight is borne on, without a step; the hand does not notice."""
    bench = Bench(gravity=WEIGHT)
    weight = bench.engage(STILL).rendered
    assert np.linalg.norm(weight) > 0.01
    if reason is ForceReason.STALE:
        bench.torque = None
    output = bench.run(700, **changed)
    expected = f'fault: {reason.value}' if reason in LATCHED else 'ready'
    assert output.state.text == expected
    for each in bench.outputs[-700:]:
        np.testing.assert_allclose(each.rendered, weight, atol=1e-12)
    # It stays after an acknowledgement, too.
    if bench.controller.acknowledge():
        assert bench.step(**changed).rendered == pytest.approx(weight)


def test_the_weight_is_borne_in_ready_and_comes_up_by_the_ramp():
    """A1."""
    bench = Bench(gravity=WEIGHT)
    bench.torque = None
    output = bench.run(700)
    assert output.state.text == 'ready'
    expected = np.cross(POSE @ WEIGHT.handle, (0.0, 0.0, 9.80665))
    of_the_ramp = 1.01e-3 / 0.5 * size(expected)
    np.testing.assert_allclose(output.rendered, expected, atol=1e-12)
    assert steps(bench, 590).max() <= of_the_ramp


@pytest.mark.parametrize('changed', [{'enabled': False}, {'weightless': False}])
def test_a_weight_that_is_no_more_wanted_goes_by_the_ramp(changed):
    """A1."""
    bench = Bench(gravity=WEIGHT)
    weight = size(bench.engage(STILL).rendered)
    half = size(bench.run(250, **changed).rendered)
    output = bench.run(300, **changed)
    of_the_ramp = 1.01e-3 / 0.5 * weight
    assert half == pytest.approx(0.5 * weight, rel=0.1)
    assert output.motor_torque == ZERO
    assert steps(bench, 540).max() <= of_the_ramp
    assert output.state.text == ('engaged' if 'weightless' in changed else 'off')


@pytest.mark.parametrize(('changed', 'reason'), OF_ALL)
def test_what_the_motors_bear_in_ready_ends_with_orientation_or_motors(changed, reason):
    """A1: as in `engaged`, within 15 ms; a reason that latches does so as there is torque."""
    bench = Bench(gravity=WEIGHT)
    bench.torque = None
    assert any(bench.run(700).motor_torque)
    output = bench.run(16, **changed)
    assert output.motor_torque == ZERO
    expected = f'fault: {reason.value}' if reason in LATCHED else 'off'
    assert bench.run(5, **changed).state.text == expected


def test_a_weight_that_was_never_up_latches_nothing():
    """At the start the protection level is high, and now and then there is no orientation."""
    bench = Bench(gravity=WEIGHT)
    for changed in ({'protection_level': 1.0}, {'quaternion': None, 'velocity': None}):
        output = bench.run(300, **changed)
        assert output.state.text == 'ready'
        assert output.motor_torque == ZERO


def test_a_fault_of_the_wrench_becomes_one_of_the_orientation():
    """A1: the weight that is borne in it ends then."""
    bench = Bench(gravity=WEIGHT)
    bench.engage(STILL)
    assert bench.run(100, sources=2).state.why is ForceReason.SOURCES
    output = bench.run(
        20,
        sources=2,
        quaternion=None,
        velocity=None,
    )
    assert output.state.text == f'fault: {ForceReason.NO_ORIENTATION.value}'
    assert output.motor_torque == ZERO


def test_energy_that_is_generated_lets_the_weight_go_by_the_ramp():
    """It may be the weight that generates it."""
    bench = Bench(gravity=WEIGHT)
    weight = size(bench.engage(STILL).rendered)
    bench.controller._energy.energy = -25e-3
    bench.run(1000)
    while bench.step().state.condition is ForceCondition.ENGAGED:
        pass
    assert bench.outputs[-1].state.text == f'fading: {ForceReason.ENERGY.value}'
    half = size(bench.run(250).rendered)
    assert half == pytest.approx(0.5 * weight, rel=0.1)
    assert bench.run(300).state.text == f'fault: {ForceReason.ENERGY.value}'
    assert bench.outputs[-1].motor_torque == ZERO


@pytest.mark.parametrize('speed', [1.0, 2.0, 3.0, 5.0, 8.0])
def test_a_wrench_that_is_lost_gives_no_blow(speed):
    """A4: the fade has no damping that was not there before; 10 N m/s at most."""
    bench = Bench(4, limits=ForceLimits(speed=10.0))
    bench.engage(STILL)
    for number in range(100):
        if number == 40:
            bench.torque = None
        turned_by = 1e-3 * speed * max(0, number - 10)
        R = workspace_pose(0.1, 0.4, math.radians(15.0) + turned_by)
        spin = min(1.0, 0.1 * number) * speed
        velocity = tuple((spin * R[:, 2]).tolist())
        bench.step(**at(R), velocity=velocity)
    assert bench.outputs[-70].state.text == 'engaged'
    assert bench.outputs[-1].state.text == 'ready'
    assert size(bench.outputs[-65].rendered) == pytest.approx(0.005 * speed)
    assert steps(bench, 100).max() <= 0.01


@pytest.mark.parametrize('drift', [1.0, 5.0, 10.0, 20.0, 28.0])
def test_an_angle_that_lies_moves_no_motor_in_a_fade(drift):
    """A5: an encoder that runs away, out of zero torque."""
    bench = Bench()
    bench.engage(STILL)
    bench.run(50)
    for number in range(40):
        a, b, c, third = ANGLES
        lying = {'angles': (a, b + 1e-3 * drift * number, c, third)}
        if number >= 5:
            lying |= {'quaternion': None, 'velocity': None}
        output = bench.step(**lying)
        assert np.abs(output.motor_torque).max() <= 1e-9
    assert output.state.why is ForceReason.NO_ORIENTATION


@pytest.mark.parametrize('torque', [(0.0, 0.0, 0.3), (0.0, 0.1, 0.0)])
def test_a_wrench_fades_by_its_age_and_then_from_what_is_left(torque):
    """10 N m/s at most, and zero after 50 ms."""
    bench = Bench()
    bench.engage(torque)
    bench.torque = None
    bench.run(45)
    assert steps(bench, 46).max() <= 0.01 + 1e-9
    assert bench.run(5).motor_torque == ZERO


@pytest.mark.parametrize('elapsed', [0, -1, -20, -500])
def test_a_repeated_or_older_stamp_changes_nothing(elapsed):
    """A10."""
    bench = Bench()
    before = bench.engage()
    bench.now += elapsed * MS
    repeated = bench.step(
        0,
        quaternion=None,
        velocity=None,
        drives=DrivesState.FAULT,
    )
    assert repeated == before
    bench.now -= elapsed * MS
    after = bench.step()
    assert after.state.text == 'engaged'
    np.testing.assert_allclose(after.motor_torque, before.motor_torque, atol=1e-9)


def test_a_clock_that_is_set_back_begins_at_zero():
    bench = Bench()
    bench.engage()
    assert bench.step(-3000).motor_torque == ZERO
    assert bench.run(60).state.text == 'engaged'


def test_a_wrench_that_stops_is_let_go_within_50_ms():
    bench = Bench()
    bench.engage()
    bench.torque = None
    last = bench.now
    while any(bench.step().motor_torque):
        assert bench.now - last <= 50 * MS
    assert texts(bench)[-2:] == [f'fading: {ForceReason.STALE.value}', 'ready']
    bench.torque = TORQUE
    assert bench.run(200).state.condition is ForceCondition.READY


def test_a_worse_reason_during_the_fade_is_latched():
    bench = Bench()
    bench.engage()
    bench.step(present=False)
    bench.step(quaternion=None)
    assert bench.outputs[-1].state.why is ForceReason.NO_ORIENTATION
    assert bench.run(25).state.text == f'fault: {ForceReason.NO_ORIENTATION.value}'
    count = [output.state.condition for output in bench.outputs].count(ForceCondition.FADING)
    assert count < 20


def test_the_clutch_lets_the_wrench_go_and_holds_the_weight():
    gravity = Gravity(handle=(0.0, 0.0, 0.004))
    bench = Bench(gravity=gravity)
    bench.engage((0.0, 0.0, 0.2))
    output = bench.run(60, clutched=True)
    assert output.state.text == 'holding'
    assert output.asked == ZERO
    weight = size(output.rendered)
    assert 0.01 < weight < 0.05
    assert steps(bench, 61).max() <= 0.01 + 1e-9
    # The wrench may stop meanwhile, and has to be small when it comes back.
    bench.torque = None
    assert bench.run(100, clutched=True).state.text == 'holding'
    bench.torque = (0.0, 0.0, 0.2)
    assert bench.run(100).state.text == 'holding'
    bench.torque = STILL
    output = bench.run(3)
    assert output.state.text == 'engaged'
    assert size(output.rendered) == pytest.approx(weight)


def test_a_gap_of_the_samples_begins_at_zero():
    bench = Bench()
    bench.engage((0.0, 0.0, 0.3))
    output = bench.step(milliseconds=11)
    assert output.state.condition is ForceCondition.ENGAGED
    assert output.motor_torque == ZERO
    assert size(bench.step().rendered) <= 0.01 + 1e-9


@pytest.mark.parametrize('lock', [None, LOCK])
def test_without_a_velocity_neither_wrench_nor_lock_is_rendered(lock):
    """Nothing could damp it; the torque goes down by the slew rate and comes up again."""
    bench = Bench()
    bench.engage((0.18, 0.0, 0.24))
    output = bench.run(40, velocity=None, lock=lock)
    assert output.state.condition is ForceCondition.ENGAGED
    assert output.asked == ZERO
    assert bench.run(40).asked == pytest.approx((0.18, 0.0, 0.24))
    asked = [each.asked for each in bench.outputs[-81:]]
    changes = np.diff(asked, axis=0)
    assert np.linalg.norm(changes, axis=1).max() <= 0.01 + 1e-9


@pytest.mark.parametrize('motors', [3, 4])
def test_the_torque_from_before_a_gap_does_no_work_after_it(motors):
    """The drives have dropped it: from the first sample behind the gap on there is none."""
    bench = Bench(motors)
    before = bench.engage().motor_torque
    energy = bench.step(milliseconds=11).energy
    ahead = [
        angle + math.copysign(0.01, torque) for angle, torque in zip(ANGLES, before, strict=False)
    ]
    assert bench.step(angles=(*ahead, ANGLES[3])[:4]).energy == energy


def test_a_gap_of_the_samples_leaves_nothing_to_fade():
    """The drives have dropped the torque meanwhile: none of it comes back."""
    bench = Bench()
    bench.engage()
    assert bench.step(milliseconds=11, quaternion=None).motor_torque == ZERO
    assert bench.step(quaternion=None).state.text == f'fault: {ForceReason.NO_ORIENTATION.value}'


@pytest.mark.parametrize('quaternion', [(0.0, 0.0, 0.0, 1.0), (NAN, 0.0, 0.0, 1.0)])
def test_a_pose_that_a_leg_does_not_reach_ends_force(quaternion):
    bench = Bench()
    bench.engage()
    output = bench.step(quaternion=quaternion)
    assert output.state.text == f'fading: {ForceReason.NO_ORIENTATION.value}'
    assert output.rendered is None
    assert all(map(math.isfinite, output.motor_torque))


def random_event(rng, bench):
    """Change the torque by chance, acknowledge at times; return what else changes."""
    changed = dict(rng.choice(ENDS)[0]) if rng.random() < 0.1 else {}
    changed.pop('wrench', None)
    if rng.random() < 0.05:
        changed['clutched'] = True
    if rng.random() < 0.02:
        bench.controller.acknowledge()
    bench.torque = rng.choice((None, STILL, STILL, STILL, TORQUE, TORQUE, (0.0, 0.0, 9.0)))
    if rng.random() < 0.001:
        bench.torque = (NAN, 0.0, math.inf)
    if rng.random() < 0.4:
        bench.torque = STILL
        changed = {}
    return changed


def may_make_no_torque(state):
    """Return whether a state is off, or a fault that ends the weight as well."""
    is_fault = state.condition is ForceCondition.FAULT
    return state.condition is ForceCondition.OFF or (is_fault and state.why in ENDS_ALL)


def check_torque(output):
    """Check that it is within the limit, and none, or the weight at most, where it has to be."""
    assert all(abs(torque) <= 0.5 for torque in output.motor_torque)
    if may_make_no_torque(output.state):
        assert output.motor_torque == ZERO
    elif output.state.condition not in POWERED:
        assert output.asked == ZERO
        assert np.linalg.norm(output.rendered) <= 0.05


@pytest.mark.slow
@pytest.mark.parametrize('count', [2_000, pytest.param(10_000, marks=pytest.mark.evidence)])
def test_thousands_of_random_faults_and_transitions(count):
    """Torque in engaged, holding and fading only; finite, and never above the limit."""
    rng = random.Random(11)
    bench = Bench(gravity=Gravity(handle=(0.001, 0.0, 0.004)))
    seen = set()
    changes = 0
    latest = None
    while changes < count:
        changed = random_event(rng, bench)
        period = rng.choice((1, 1, 4, 8, 8, 12))
        for _ in range(rng.choice((1, 2, 3, 5, 20))):
            output = bench.step(period, **changed)
            changes += output.state != latest
            latest = output.state
            seen.add(output.state.text)
            check_torque(output)
        bench.outputs.clear()
    assert {'off', 'ready', 'engaged', 'holding'} < seen
    assert len(seen) > 20


@pytest.mark.parametrize(
    'wrong',
    [
        {'torque': 0.0},
        {'slew': -1.0},
        {'sigma_off': 0.2},
        {'speed': NAN},
        {'ramp': 'x'},
        {'noise': True},
    ],
)
def test_wrong_limits(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        ForceLimits(**wrong)


def test_there_are_three_motors_unless_another_number_is_given():
    assert ForceController().output.motor_torque == ZERO
    assert ForceController(motors=4).output.motor_torque == (*ZERO, 0.0)
    with pytest.raises(InputError, match='motors = 2'):
        ForceController(motors=2)


def test_every_word_of_the_state_is_read_as_it_was_made():
    whys = {ForceCondition.FADING: ForceReason, ForceCondition.FAULT: ForceReason}
    states = [
        ForceState(condition, why)
        for condition in ForceCondition
        for why in whys.get(condition, [None])
    ]
    assert len(states) == 4 + 2 * len(ForceReason)
    assert [FORCE_STATES.get(state.text) for state in states] == states


def test_a_lock_is_rendered_beside_the_wrench_and_without_a_step():
    bench = Bench()
    bench.engage((0.1, 0.0, 0.0))
    output = bench.run(260, lock=LOCK)
    np.testing.assert_allclose(output.rendered, (0.1, 0.1, 0.0), atol=1e-9)
    assert steps(bench, 261).max() <= 0.01 + 1e-9


def test_a_lock_far_away_pulls_by_a_slow_slope():
    """A12: 30 deg away; its centre moves at 0.5 rad/s, with 1 N m/rad."""
    bench = Bench()
    bench.engage(STILL)
    far = turned(math.radians(30.0))
    begun = bench.run(30, lock=far)
    assert size(begun.rendered) <= 0.5 * 0.03 + 1e-9
    assert steps(bench, 30).max() <= 0.5e-3 + 1e-9
    pulled = bench.run(1200, lock=far)
    assert size(pulled.rendered) == pytest.approx(0.3)


def test_a_lock_holds_without_wrenches_and_ends_when_it_is_let_go():
    """K2: also where no wrench has ever come, as while dVRK's clutch is pressed."""
    bench = Bench()
    bench.torque = None
    assert bench.run(150).state.text == 'ready'
    output = bench.run(700, lock=LOCK)
    assert output.state.text == 'holding'
    np.testing.assert_allclose(output.rendered, PULL, atol=1e-9)
    # A small wrench that comes has both rendered.
    bench.torque = STILL
    assert bench.run(10, lock=LOCK).state.text == 'engaged'
    bench.torque = None
    assert bench.run(100, lock=LOCK).state.text == 'holding'
    np.testing.assert_allclose(bench.outputs[-1].rendered, PULL, atol=1e-9)
    assert bench.run(40).state.text == 'ready'
    assert bench.outputs[-1].motor_torque == ZERO
    assert steps(bench, 100).max() <= 0.02


@pytest.mark.parametrize(
    'changed',
    [
        {'enabled': False},
        {'engaged': False},
        {'present': False},
    ],
)
def test_a_lock_holds_only_where_force_is_wanted(changed):
    """K2."""
    bench = Bench()
    bench.torque = None
    bench.run(400, lock=LOCK, **changed)
    assert bench.outputs[-1].state.text in ('off', 'ready')
    assert not any(any(output.motor_torque) for output in bench.outputs)


def test_a_lock_holds_while_the_clutch_is_pressed_and_after_it():
    bench = Bench()
    bench.engage((0.1, 0.0, 0.0))
    bench.run(260, lock=LOCK)
    output = bench.run(60, lock=LOCK, clutched=True)
    assert output.state.text == 'holding'
    np.testing.assert_allclose(output.rendered, PULL, atol=1e-9)
    bench.torque = STILL
    bench.run(30, lock=LOCK)
    assert bench.outputs[-1].state.text == 'engaged'
    for output in bench.outputs[-40:]:
        np.testing.assert_allclose(output.rendered, PULL, atol=1e-9)


def test_lock_and_wrench_together_are_limited():
    bench = Bench()
    bench.engage((0.3, 0.0, 0.0))
    output = bench.run(1500, lock=turned(0.5))
    assert np.linalg.norm(output.asked) == pytest.approx(0.3)
    assert output.asked[1] > output.asked[0] > 0.0


def test_the_compensation_of_weight_goes_and_comes_over_the_ramp():
    bench = Bench(gravity=Gravity(handle=(0.0, 0.0, 0.004)))
    weight = size(bench.engage(STILL).rendered)
    assert weight > 0.01
    half = size(bench.run(250, weightless=False).rendered)
    assert half == pytest.approx(0.5 * weight, rel=0.02)
    assert bench.run(300, weightless=False).rendered == STILL
    assert size(bench.run(510).rendered) == pytest.approx(weight)
    assert steps(bench, 1060).max() < 0.02 * weight


def test_make_bench_measures_a_sample():
    assert 0.0 < force(3)() < 0.01


def test_a_clutch_that_is_released_holds_nothing_without_wrenches():
    bench = Bench()
    bench.engage()
    bench.run(50, clutched=True)
    bench.torque = None
    assert bench.run(200, clutched=True).state.text == 'holding'
    assert bench.step().state.why is ForceReason.STALE
    assert bench.run(40).motor_torque == ZERO


def test_after_a_gap_the_weight_comes_up_from_zero():
    bench = Bench(gravity=Gravity(handle=(0.0, 0.02, 0.0)))
    held = max(map(abs, bench.engage(STILL).motor_torque))
    assert held > 0.05
    after = bench.step(5000).motor_torque
    assert max(map(abs, after)) < 0.01 * held
