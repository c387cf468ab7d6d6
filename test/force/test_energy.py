# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The energy that the motors give: budget, loops in the fade zone, noise at rest."""

from itertools import islice
import math

from bench import ANGLES, at, Bench, MS, POSE, STILL, turned
import numpy as np
import pytest
from spm_haptic_master.force import ForceCondition, ForceController, ForceLimits, Gravity
from spm_haptic_master.force.energy import ADVANCE, EnergyBudget
from spm_haptic_master.force.joint_motion import JointMotion
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.kinematics.rotations import matrix_from_quaternion, quaternion_from_vector

pytest.importorskip('mujoco', reason='needs mujoco')

from study.force.bare import without_energy_law  # noqa: E402, I100
from study.force.loop import constant, run, Slave  # noqa: E402
from study.force.motions import axis, loops, pose, push  # noqa: E402

# Self-rotation in the fade zone, s_3 = 0.11 (deg).
FADE_ZONE = 44.0
DT = 1e-3


def spend(budget, energy, steps, asked=(0.0, 0.0, 0.0)):
    """Let the motors give an energy, J, in some steps; return whether each left it spent."""
    found = []
    for _ in range(steps):
        budget.count(energy / steps, asked, DT)
        budget.note_wrench(DT)
        found.append(budget.is_spent)
    return found


def test_what_the_motors_give_is_taken_from_the_budget():
    budget = EnergyBudget()
    spend(budget, 0.4e-3, 4)
    assert budget.energy == pytest.approx(ADVANCE - 0.4e-3)
    assert (budget.damping, budget.share) == (0.0, 1.0)
    spend(budget, 1.2e-3, 5)
    assert budget.damping == 1.0
    assert budget.share == 1.0
    spend(budget, 10.4e-3, 4)
    assert budget.energy == pytest.approx(-10e-3)
    assert budget.share == pytest.approx(0.5)


def test_what_the_hand_gives_is_kept_up_to_the_energy_of_the_softest_spring():
    budget = EnergyBudget()
    spend(budget, -1.0, 10, (0.0, 0.12, 0.16))
    assert budget.energy == pytest.approx(ADVANCE + 0.2**2 / 0.4)
    spend(budget, 0.0, 1)
    assert budget.energy == ADVANCE


@pytest.mark.parametrize('given', [4e-3, 0.4e-3])
def test_the_damping_comes_within_4_ms_and_goes_within_20(given):
    """Fast motion gives and takes more in a period than is between no damping and all of it."""
    budget = EnergyBudget()
    spend(budget, 2e-3, 1)
    found = [budget.damping]
    for number in range(200):
        budget.count(given if number % 2 else -given, (0.0, 0.0, 0.0), DT)
        found.append(budget.damping)
    assert max(found) == 1.0
    assert np.diff(found).min() >= -0.05 - 1e-9
    assert np.diff(found).max() <= 0.25 + 1e-9
    spend(budget, -1.0, 1, (0.0, 0.0, 0.3))
    assert budget.damping > 0.0
    assert budget.share == 1.0
    spend(budget, 0.0, 20, (0.0, 0.0, 0.3))
    assert budget.damping == 0.0


WEIGHTS = (1.0, 10.0, 100.0)


def test_the_work_of_motors_whose_joints_cross_half_a_turn():
    """Raw angles jump by a turn there; the joint does not. A missing angle ends the motion."""
    motion = JointMotion(3)
    for step in range(12):
        angle = np.pi - 0.005 + 1e-3 * step
        wrapped = float(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)
        work = motion.follow(
            step * 1_000_000,
            (wrapped, 0.5 - 2e-3 * step, -0.5, 9.0),
            WEIGHTS,
            DT,
        )
        if step:
            assert work == pytest.approx(1e-3 - 20e-3)
    assert motion.velocity == pytest.approx((1.0, -2.0, 0.0))
    assert motion.follow(12_000_000, (0.0, float('nan'), 0.0, 9.0), WEIGHTS, DT) is None
    assert motion.is_missing
    assert motion.velocity is None
    assert motion.follow(13_000_000, (0.0, 0.0, 0.0, 9.0), WEIGHTS, DT) is None
    assert not motion.is_missing


@pytest.mark.parametrize(('motors', 'work'), [(3, 0.321), (4, 4.321)])
def test_the_work_is_that_of_the_motors_alone(motors, work):
    motion = JointMotion(motors)
    torques = (*WEIGHTS, 1000.0)[:motors]
    motion.follow(0, (0.1, 0.2, 0.3, 0.4, 0.5), torques, DT)
    moved = (0.101, 0.202, 0.303, 0.404, 9.0)
    assert motion.follow(1_000_000, moved, torques, DT) == pytest.approx(work)


def test_an_encoder_that_jumps_is_no_motion():
    """5 deg in a millisecond: no work is counted, and no velocity damps it."""
    motion = JointMotion(3)
    for step in range(12):
        motion.follow(
            step * 1_000_000,
            (1e-3 * step, 0.0, 0.0),
            WEIGHTS,
            DT,
        )
    assert motion.follow(12_000_000, (0.012, 0.087, 0.0), WEIGHTS, DT) is None
    assert motion.velocity is None
    assert not motion.is_missing
    assert motion.follow(13_000_000, (0.013, 0.087, 0.0), WEIGHTS, DT) == pytest.approx(1e-3)


def test_a_wrench_without_use_for_a_second_is_a_fault():
    budget = EnergyBudget()
    spend(budget, 20e-3, 1)
    assert budget.share < 0.1
    found = spend(budget, 0.0, 1100)
    assert 990 <= found.index(True) <= 1000
    spend(budget, -10e-3, 1)
    assert spend(budget, 0.0, 1) == [False]


def yielding(bench, **changed):
    """Yield outputs of a bench whose angles turn with the torque by themselves, as by no hand."""
    angles = ANGLES
    while True:
        output = bench.step(angles=angles, **changed)
        yield output, angles
        torques = (*output.motor_torque, 0.0)
        moved = np.array(angles) + 1e-2 * np.array(torques)
        angles = tuple(moved.tolist())


def spent_by(bench):
    """Return angles and energy of a bench that yields until its budget is 5 mJ in debt."""
    for output, angles in yielding(bench):
        if output.energy <= -5e-3:
            return angles, output.energy
    raise AssertionError


def test_energy_that_is_generated_ends_in_a_latched_fault():
    bench = Bench()
    bench.engage()
    for output, _ in islice(yielding(bench), 5000):
        if output.state.condition is ForceCondition.FAULT:
            break
    assert output.state.text == 'fault: energy generated'
    assert bench.now > 1000 * MS


@pytest.mark.parametrize('pause', [{'clutched': True}, {'present': False}])
def test_one_budget_for_as_long_as_force_is_on(pause):
    """A8: neither the clutch nor a reason that does not latch renews it."""
    bench = Bench()
    bench.engage()
    angles, energy = spent_by(bench)
    bench.torque = STILL
    paused = bench.run(30, angles=angles, **pause)
    assert paused.state.text in ('holding', 'ready')
    output = bench.run(30, angles=angles)
    assert output.state.text == 'engaged'
    assert output.energy == pytest.approx(energy, abs=1e-4)


def test_the_budget_comes_back_by_time_at_rest():
    """A8: 3 mJ in a minute, and no more than the advance."""
    budget = EnergyBudget()
    spend(budget, 5e-3, 1)
    for _ in range(60_000):
        budget.recover(DT)
    assert budget.energy == pytest.approx(ADVANCE - 2e-3)
    for _ in range(60_000):
        budget.recover(DT)
    assert budget.energy == ADVANCE


def test_a_handle_that_moves_gets_nothing_back():
    bench = Bench()
    bench.engage()
    angles, _ = spent_by(bench)
    velocity = (0.3, 0.0, 0.0)
    bench.torque = STILL
    moving = bench.run(1000, angles=angles, velocity=velocity).energy
    later = bench.run(1000, angles=angles, velocity=velocity).energy
    at_rest = bench.run(1000, angles=angles).energy
    assert later <= moving + 1e-9
    assert at_rest == pytest.approx(moving + 5e-5, abs=1e-6)


def test_the_damping_goes_slowly_where_the_hand_gives_energy_back():
    """0.06 N m s/rad at 1 rad/s, in 20 ms or more."""
    bench = Bench()
    bench.engage()
    angles, _ = spent_by(bench)
    spins = {'angles': angles, 'velocity': (0.0, 0.0, 1.0)}
    bench.torque = STILL
    damped = bench.run(60, **spins).motor_torque
    assert np.abs(damped).max() > 0.02
    bench.controller._energy.restart()
    torques = [bench.step(**spins).motor_torque for _ in range(30)]
    largest_step = np.abs(np.diff(torques, axis=0)).max()
    assert largest_step < 0.02 / 5.0


def test_a_lock_that_generates_energy_falls_with_its_share():
    bench = Bench()
    bench.engage(STILL)
    bench.run(600, lock=turned(0.2))
    for output, _ in islice(yielding(bench, lock=turned(0.2)), 400):
        assert math.hypot(*output.asked) <= 0.2 * output.share + 0.02
    assert output.state.text == 'engaged'
    assert output.share < 0.9


@pytest.mark.parametrize('rate', [250, 500, 1000])
def test_the_work_is_that_of_the_torque_in_force(rate):
    """A11: at 250 Hz the command of a sample is in force 1 ms later, not a period later."""
    bench = Bench(limits=ForceLimits(slew=1000.0))
    bench.engage(STILL)
    period = 1000.0 / rate
    direction = np.array([0.0, 0.0, 1.0])
    given = 0.0
    before = bench.controller.output.energy
    # Torques asked for by the latest two samples, and the turn at the latest.
    older = np.zeros(3)
    newer = np.zeros(3)
    turned_before = np.zeros(3)
    for number in range(1, 160 * rate // 1000):
        phase = 0.1 * number * period
        turned_by = 0.004 * math.sin(phase) * direction
        R = matrix_from_quaternion(quaternion_from_vector(*turned_by)) @ POSE
        bench.torque = (0.0, 0.0, 0.015 * math.cos(phase))
        output = bench.step(period, **at(R))
        if number > 2:
            share = 1.0 / period
            in_force = share * older + (1.0 - share) * newer
            given += in_force @ (turned_by - turned_before)
        older = newer
        newer = np.array(output.asked)
        turned_before = turned_by
    assert before - output.energy == pytest.approx(given, rel=0.05)


@pytest.mark.parametrize(
    ('speed', 'sense'),
    [
        pytest.param(0.2, 1, marks=pytest.mark.slow),
        pytest.param(0.2, -1, marks=[pytest.mark.slow, pytest.mark.evidence]),
        (1.0, 1),
        (1.0, -1),
        (3.0, 1),
        (3.0, -1),
    ],
)
def test_twelve_loops_in_the_fade_zone(speed, sense):
    """A faded spring is not conservative, and no damping helps in slow motion: 20 mJ in all."""
    R = pose(FADE_ZONE)
    motion, environment, seconds = loops(R, speed, 12, sense)
    found = run(R, Slave(environment), seconds, motion=motion, hand=None)
    assert set(found.states[found.start :]) == {'engaged'}
    assert found.generated <= 20e-3


def test_fast_loops_move_no_motor_by_jerks():
    """At 5 rad/s the budget is used up and filled again in each period."""
    R = pose(FADE_ZONE)
    motion, environment, seconds = loops(R, 5.0, 12, 1)
    found = run(R, Slave(environment), seconds, motion=motion, hand=None)
    assert found.generated <= 20e-3
    assert found.energy[found.start :].min() < 0.0
    steps = np.diff(found.torque[found.start :], axis=0)
    assert np.abs(steps).max() <= 0.2


def test_loops_generate_without_the_law_and_with_four_motors_do_not():
    """What a turn of slow loops leaves of itself: three motors without the law, and four."""
    R = pose(FADE_ZONE)
    left = {}
    for motors in (3, 4):
        motion, environment, seconds = loops(R, 1.0, 4, 1)
        found = run(
            R,
            Slave(environment),
            seconds,
            motion=motion,
            hand=None,
            motors=motors,
            noise=0.0,
            controller=without_energy_law(motors),
        )
        turn = (len(found.given) - found.start) // 4
        of_two_turns = found.given[-1] - found.given[-1 - 2 * turn]
        left[motors] = of_two_turns / 2.0
    assert left[3] > 2e-3
    assert left[4] <= 0.5e-3


def test_the_work_against_the_weight_is_not_counted():
    """The motors lift the handle for the hand: more than the budget, and none of it counts."""
    R = pose(20.0)
    gravity = Gravity(
        handle=(0.0, 0.0, 0.02),
        proximal=(0.005, 0.0, 0.005, 0.0, 0.005, 0.0),
    )
    controller = ForceController(limits=ForceLimits(ramp=0.05), gravity=gravity)
    found = run(
        R,
        Slave(constant((0.0, 0.0, 0.0))),
        1.0,
        hand=None,
        controller=controller,
        motion=push(axis(R, 'tilt'), -0.3, rise=0.5, hold=0.5),
    )
    assert found.generated > 10e-3
    assert found.energy[found.start :].min() >= 1.5e-3
    assert set(found.states[found.start :]) == {'engaged'}


def test_twelve_loops_of_a_handle_that_weighs_in_the_fade_zone():
    """What the motors make of its weight is not conservative there: 20 mJ in all."""
    bench = Bench(gravity=Gravity((-0.0113, 0.0081, -0.0057)))
    tilt = 0.227
    azimuth = 0.782
    phi = 0.931
    radius = 0.08
    turn = 500
    samples = []
    for number in range(turn):
        angle = -math.tau * number / turn
        R = workspace_pose(
            tilt + radius * math.sin(angle),
            azimuth,
            phi + radius * (math.cos(angle) - 1.0),
        )
        samples.append(at(R))
    work = 0.0
    torques = np.zeros(3)
    before = samples[0]['angles']
    for number in range(700 + 12 * turn):
        sample = samples[max(0, number - 700) % turn]
        output = bench.step(**sample)
        moved = np.subtract(sample['angles'], before)
        work += torques @ moved[:3]
        torques = np.array(output.motor_torque)
        before = sample['angles']
    assert output.state.text == 'engaged'
    assert work <= 20e-3


def test_noise_at_rest_is_one_millinewtonmetre():
    """0.04 deg on each encoder, 14 bit, damping 0.005 N m s/rad."""
    found = run(
        pose(20.0),
        Slave(constant((0.0, 0.0, 0.0))),
        3.0,
        hand=None,
    )
    felt = found.rendered[found.start :]
    mean_square = np.mean(np.sum(felt**2, axis=1))
    assert 0.0 < np.sqrt(mean_square) <= 1e-3


@pytest.mark.slow
@pytest.mark.parametrize('seconds', [15.0, pytest.param(60.0, marks=pytest.mark.evidence)])
@pytest.mark.parametrize(('phi_deg', 'torque'), [(20.0, 0.1), (FADE_ZONE, 0.0)])
def test_a_time_at_rest_leaves_the_budget(phi_deg, torque, seconds):
    """Noise alone takes at most 0.5 mJ, and nothing of the wrench."""
    slave = Slave(constant((torque, 0.0, 0.0)))
    found = run(pose(phi_deg), slave, seconds, hand=None)
    assert found.energy[found.start :].min() >= 1.5e-3
    assert (found.share == 1.0).all()
