# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Each limit of the force feedback: what is allowed just below it, and what is not just above."""

from math import inf, radians

from bench import Bench, MS, POSE, STILL, TORQUE, turned
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.force import (
    DrivesState,
    ForceCondition,
    ForceLimits,
    Gravity,
    identify_gravity,
    Wrench,
)
from spm_haptic_master.force.energy import EnergyBudget
from spm_haptic_master.force.joint_motion import JointMotion
from spm_haptic_master.force.samples import ForceReason
from spm_haptic_master.kinematics import workspace_pose

ZERO = (0.0, 0.0, 0.0)
WEIGHT = Gravity(handle=(0.0, 0.0, 0.004))
DT = 1e-3


# What a sample may be, and its obstacle.
@pytest.mark.parametrize(
    ('changed', 'obstacle'),
    [
        ({'protection_level': radians(1.0)}, None),
        ({'protection_level': radians(1.01)}, ForceReason.UNPROTECTED),
        ({'noise': 5.0}, None),
        ({'noise': 5.01}, ForceReason.NOISY),
        ({'velocity': (0.0, 4.8, 3.5)}, None),
        ({'velocity': (0.0, 0.0, 6.0)}, None),
        ({'velocity': (0.0, 4.8, 3.7)}, ForceReason.SPEED),
        ({'sources': 0}, None),
        ({'sources': 1}, None),
        ({'sources': 2}, ForceReason.SOURCES),
    ],
)
def test_a_sample_within_the_limits_goes_on(changed, obstacle):
    bench = Bench()
    bench.engage(STILL)
    assert bench.step(**changed).obstacle is obstacle


@pytest.mark.parametrize(
    ('age', 'obstacle'),
    [
        (-30 * MS, None),
        (-30 * MS - 1, ForceReason.STALE),
        (30 * MS, None),
        (30 * MS + 1, ForceReason.STALE),
    ],
)
def test_a_wrench_may_be_30_ms_from_its_sample(age, obstacle):
    bench = Bench()
    bench.engage(STILL)
    bench.torque = None
    wrench = Wrench(bench.now + MS - age, STILL)
    assert bench.step(wrench=wrench).obstacle is obstacle


@pytest.mark.parametrize(('torque', 'begins'), [(0.0499, True), (0.05, False), (0.07, False)])
def test_force_begins_with_a_torque_below_50_millinewtonmetres(torque, begins):
    bench = Bench()
    bench.torque = (0.0, torque, 0.0)
    bench.run(200)
    assert (bench.outputs[-1].state.condition is ForceCondition.ENGAGED) is begins


def test_the_torque_of_a_wrench_falls_by_its_age_from_a_third_on():
    """By 0.3 N m from 10 ms to the longest age and the time of a fade: 45 ms."""
    bench = Bench()
    bench.engage((0.3, 0.0, 0.0))
    bench.torque = None
    for age in range(1, 31):
        expected = 0.3 * min(1.0, (45 - age) / 35)
        assert bench.step().asked == pytest.approx((expected, 0.0, 0.0))


def test_a_pause_of_10_ms_is_no_gap():
    """A longer one is: its torque is zero, and so is that of the sample after the next fade."""
    bench = Bench()
    before = bench.engage()
    assert bench.step(10.0).motor_torque == pytest.approx(before.motor_torque)
    assert bench.step(10.000001).motor_torque == ZERO


@pytest.mark.parametrize(('back', 'is_seen'), [(1000.0, True), (1000.000001, False)])
def test_a_stamp_that_is_more_than_a_second_older_is_of_a_clock_that_was_set_back(back, is_seen):
    bench = Bench()
    bench.engage()
    now = bench.now
    bench.step(-back)
    assert bench.controller.has_seen(now - 1) is is_seen


def test_force_is_ready_after_a_tenth_of_a_second_from_the_start_and_after_a_fault():
    """An acknowledgement does not shorten it."""
    bench = Bench()
    assert bench.run(97).state.text == 'off'
    assert bench.run(6).state.text != 'off'
    bench.run(20)
    bench.run(20, quaternion=None)
    assert bench.controller.acknowledge()
    assert bench.controller.output.state.text == 'off'
    bench.torque = None
    assert bench.run(97).state.text == 'off'
    assert bench.run(6).state.text == 'ready'


@pytest.mark.parametrize(
    ('changed', 'samples'),
    [
        ({'present': False}, 15),
        ({'quaternion': None}, 15),
        ({'drives': DrivesState.OFF}, 15),
        ({'drives': DrivesState.FAULT}, 3),
    ],
)
def test_torque_fades_evenly_in_15_ms_and_after_the_fault_of_a_drive_in_3(changed, samples):
    bench = Bench()
    begin = np.array(bench.engage().motor_torque)
    for number in range(1, samples + 3):
        left = max(0.0, 1.0 - number / samples)
        assert bench.step(**changed).motor_torque == pytest.approx(left * begin, abs=1e-12)


def test_after_a_fade_three_small_wrenches_are_needed_again():
    bench = Bench()
    bench.engage(STILL)
    while bench.step(present=False).state.condition is ForceCondition.FADING:
        pass
    states = [bench.step().state.text for _ in range(4)]
    assert states == ['ready', 'ready', 'engaged', 'engaged']


def test_an_old_wrench_between_small_ones_starts_the_count_anew():
    bench = Bench()
    bench.torque = None
    bench.run(150)
    bench.torque = STILL
    bench.run(2)
    bench.torque = None
    bench.run(40)
    bench.torque = STILL
    assert bench.run(2).state.text == 'ready'
    assert bench.step().state.text == 'engaged'


def test_after_the_clutch_the_wrench_comes_up_by_its_ramp_again():
    """In half a second; the damping, which was there all the time, stays."""
    bench = Bench()
    bench.engage(STILL)
    bench.run(50, clutched=True)
    bench.run(4)
    bench.torque = (0.0, 0.0, 0.3)
    asked = [bench.run(100).asked[2] for _ in range(6)]
    assert asked == pytest.approx([0.06, 0.12, 0.18, 0.24, 0.3, 0.3], abs=0.003)


def test_a_weight_that_is_switched_off_in_ready_fades_under_that_name():
    bench = Bench(gravity=WEIGHT)
    bench.torque = None
    assert bench.run(700).state.text == 'ready'
    assert bench.step(enabled=False).state.text == 'fading: disabled'
    assert bench.run(520, enabled=False).state.text == 'off'


@pytest.mark.parametrize('changed', [{'quaternion': None}, {'drives': DrivesState.OFF}])
def test_a_weight_that_was_lost_comes_up_by_the_ramp_again(changed):
    bench = Bench(gravity=WEIGHT)
    weight = np.linalg.norm(bench.engage(STILL).rendered)
    bench.run(30, **changed)
    bench.controller.acknowledge()
    bench.torque = None
    felt = np.linalg.norm([bench.step().rendered for _ in range(800)], axis=1)
    assert felt[-1] == pytest.approx(weight)
    assert felt[0] <= 0.003 * weight
    assert np.diff(felt).max() <= 0.003 * weight


def test_in_ready_a_moving_handle_is_not_damped():
    bench = Bench()
    bench.engage()
    bench.run(30, present=False)
    bench.torque = None
    output = bench.run(20, velocity=(1.0, 0.0, 0.0))
    assert output.state.text == 'ready'
    assert output.motor_torque == ZERO


def test_the_damping_is_5_millinewtonmetres_at_1_rad_per_second():
    bench = Bench(4)
    bench.engage(STILL)
    output = bench.run(5, velocity=(0.0, -2.0, 1.0))
    np.testing.assert_allclose(output.rendered, (0.0, 0.01, -0.005), atol=1e-12)


# A reason that comes during the fade of another, and under which name it goes on.
@pytest.mark.parametrize(
    ('first', 'second', 'named'),
    [
        ({'present': False}, {'sources': 2}, ForceReason.SOURCES),
        ({'sources': 2}, {'present': False}, ForceReason.SOURCES),
        ({'sources': 2}, {'drives': DrivesState.OFF}, ForceReason.DRIVES_OFF),
        ({'drives': DrivesState.OFF}, {'sources': 2}, ForceReason.DRIVES_OFF),
        ({'drives': DrivesState.OFF}, {'drives': DrivesState.FAULT}, ForceReason.DRIVE),
        ({'drives': DrivesState.FAULT}, {'drives': DrivesState.OFF}, ForceReason.DRIVE),
        ({'present': False}, {'enabled': False}, ForceReason.ABSENT),
    ],
)
def test_only_a_worse_reason_takes_the_name_of_a_fade(first, second, named):
    bench = Bench()
    bench.engage()
    bench.step(**first)
    assert bench.step(**second).state.why is named


def test_an_acknowledged_fault_renews_the_energy_only_where_energy_was_its_reason():
    bench = Bench()
    bench.engage(STILL)
    bench.controller._energy.energy = -25e-3
    bench.run(40, sources=2)
    assert bench.controller.acknowledge()
    assert bench.run(5).energy < -20e-3
    bench.run(1200)
    assert bench.outputs[-1].state.text == f'fault: {ForceReason.ENERGY.value}'
    assert bench.controller.acknowledge()
    assert bench.step().energy == pytest.approx(2e-3)
    assert bench.outputs[-1].share == 1.0


def test_a_lock_begins_where_the_handle_is_each_time():
    """Also after one that was let go elsewhere, and after the end of force."""
    bench = Bench()
    bench.engage(STILL)
    bench.run(300, lock=turned(0.1))
    bench.run(30)
    assert np.linalg.norm(bench.step(lock=turned(-0.1)).asked) <= 0.5e-3 + 1e-9
    bench.run(300, lock=turned(0.1))
    bench.run(30, lock=turned(0.1), present=False)
    bench.torque = None
    assert np.linalg.norm(bench.run(3, lock=turned(-0.1)).asked) <= 1.5e-3 + 1e-9


@pytest.mark.parametrize('lock', [None, *(turned(0.02 * step) for step in range(6))])
def test_a_gap_where_nothing_has_to_move_is_like_any_other(lock):
    """The centre of the lock, and the torque that is asked, are where they should be: no way."""
    bench = Bench()
    bench.engage(STILL)
    bench.run(300, lock=lock)
    bench.step(20.0, lock=lock)
    output = bench.step(20.0, lock=lock)
    assert output.state.text == 'engaged'
    assert output.motor_torque == ZERO


# Energy that is left (J), share of the damping and share of the wrench after a while.
@pytest.mark.parametrize(
    ('energy', 'damping', 'share'),
    [
        (2.0e-3, 0.0, 1.0),
        (1.5e-3, 0.0, 1.0),
        (1.25e-3, 0.15625, 1.0),
        (1.0e-3, 0.5, 1.0),
        (0.5e-3, 1.0, 1.0),
        (-5e-3, 1.0, 0.84375),
        (-15e-3, 1.0, 0.15625),
        (-20e-3, 1.0, 0.0),
    ],
)
def test_what_is_left_of_the_energy_sets_damping_and_wrench(energy, damping, share):
    budget = EnergyBudget()
    budget.count(2e-3 - energy, ZERO, DT)
    for _ in range(30):
        budget.count(0.0, ZERO, DT)
    assert budget.energy == pytest.approx(energy, abs=1e-12)
    assert budget.damping == pytest.approx(damping, abs=1e-9)
    assert budget.share == pytest.approx(share, abs=1e-9)


def test_a_new_budget_damps_nothing_and_what_is_stored_is_given_back():
    """A hand that winds a spring of 0.2 N m/rad up by 1 rad gives 0.1 J: it is no more."""
    budget = EnergyBudget()
    assert budget.damping == 0.0
    budget.count(-0.05, (0.0, 0.2, 0.0), DT)
    assert budget.energy == pytest.approx(52e-3)
    budget.count(-0.06, (0.0, 0.2, 0.0), DT)
    assert budget.energy == pytest.approx(102e-3)
    assert (budget.damping, budget.share) == (0.0, 1.0)


def test_the_damping_grows_in_4_ms_and_goes_in_20():
    budget = EnergyBudget()
    budget.count(1.5e-3, ZERO, DT)
    found = [budget.damping]
    for _ in range(3):
        budget.count(0.0, ZERO, DT)
        found.append(budget.damping)
    assert found == pytest.approx([0.25, 0.5, 0.75, 1.0])
    budget.count(-1.5e-3, ZERO, DT)
    found = [budget.damping]
    for _ in range(19):
        budget.count(0.0, ZERO, DT)
        found.append(budget.damping)
    assert found == pytest.approx(np.linspace(0.95, 0.0, 20), abs=1e-9)


def note_for(budget, milliseconds):
    for _ in range(milliseconds):
        budget.note_wrench(DT)
    return budget.is_spent


def test_a_budget_is_spent_after_a_second_below_a_tenth_of_the_wrench_without_a_break():
    budget = EnergyBudget()
    budget.count(17e-3, ZERO, DT)
    assert budget.share == pytest.approx(0.156, abs=0.001)
    assert not note_for(budget, 3000)
    budget.count(1.5e-3, ZERO, DT)
    assert budget.share == pytest.approx(0.081, abs=0.001)
    assert not note_for(budget, 998)
    budget.count(-1.5e-3, ZERO, DT)
    assert not note_for(budget, 1)
    budget.count(1.5e-3, ZERO, DT)
    assert not note_for(budget, 998)
    assert note_for(budget, 4)
    budget.restart()
    assert not budget.is_spent
    assert (budget.energy, budget.share) == (2e-3, 1.0)


@pytest.mark.parametrize(
    ('turn', 'is_motion'),
    [(0.0299, True), (-0.0299, True), (0.0301, False), (-0.0301, False)],
)
def test_a_joint_faster_than_30_rad_per_second_is_an_encoder_that_jumps(turn, is_motion):
    for begin in (0.1, np.pi - 0.01, -np.pi + 0.01):
        motion = JointMotion(3)
        motion.follow(0, (0.0, begin, 0.0), (1.0, 1.0, 1.0), DT)
        end = float(np.remainder(begin + turn + np.pi, 2.0 * np.pi) - np.pi)
        work = motion.follow(MS, (0.0, end, 0.0), (1.0, 1.0, 1.0), DT)
        assert (work is not None) is is_motion


def test_a_joint_velocity_is_that_over_the_last_10_ms():
    """None before half of them."""
    motion = JointMotion(3)
    velocities = []
    for step in range(30):
        angle = 1e-3 * step if step < 15 else 0.014
        motion.follow(step * MS, (angle, 0.0, 0.0), ZERO, DT)
        velocities.append(motion.velocity)
    assert velocities[:5] == [None] * 5
    speeds = [velocity[0] for velocity in velocities[5:]]
    assert speeds[:10] == pytest.approx([1.0] * 10)
    assert speeds[10:] == pytest.approx([*np.arange(0.9, -0.05, -0.1), 0.0, 0.0, 0.0, 0.0, 0.0])
    motion.restart()
    assert motion.velocity is None


@pytest.mark.parametrize('name', ['damping', 'lock_stiffness', 'end_stop'])
def test_what_may_be_switched_off_may_be_zero_and_not_less(name):
    assert getattr(ForceLimits(**{name: 0.0}), name) == 0.0
    with pytest.raises(InputError, match=f'{name} = -1e-09: expected a finite number 0 or more'):
        ForceLimits(**{name: -1e-9})


@pytest.mark.parametrize(
    'wrong',
    [
        {'torque': inf},
        {'wrench_age': 0.0},
        {'sigma_off': 0.1, 'sigma_full': 0.1},
    ],
)
def test_limits_that_limit_nothing_are_refused(wrong):
    with pytest.raises(InputError, match=next(reversed(wrong))):
        ForceLimits(**wrong)


def test_gravity_needs_six_poses_that_differ():
    R = workspace_pose(0.3, np.arange(6.0), 0.3)
    gravity, left = identify_gravity(R, np.zeros((6, 3)))
    assert left == pytest.approx(0.0, abs=1e-12)
    assert gravity.handle == pytest.approx(ZERO, abs=1e-12)
    with pytest.raises(InputError, match='6 or more'):
        identify_gravity(R[:5], np.zeros((5, 3)))
    with pytest.raises(InputError, match='as many of each'):
        identify_gravity(R, np.zeros((7, 3)))


def test_a_wrench_in_the_frame_of_the_handle_turns_with_it():
    bench = Bench()
    bench.engage(STILL)
    bench.torque = None
    for _ in range(60):
        output = bench.step(wrench=Wrench(bench.now + MS, TORQUE, in_handle=True))
    np.testing.assert_allclose(output.asked, POSE @ TORQUE, atol=1e-9)
