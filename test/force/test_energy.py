# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The energy that the motors give: budget, loops in the fade zone, noise at rest."""

from itertools import islice
import math

from bench import ANGLES, Bench, MS
import numpy as np
import pytest
from spm_haptic_master.force import Condition, ForceController, ForceLimits, Gravity
from spm_haptic_master.force.energy import ADVANCE, EnergyBudget
from spm_haptic_master.force.joint_motion import JointMotion
from spm_haptic_master.kinematics import inverse, quaternion_from_matrix, workspace_pose

pytest.importorskip('mujoco', reason='needs mujoco')

from study.force.bare import without_energy_law  # noqa: E402, I100
from study.force.loop import constant, run, Slave  # noqa: E402
from study.force.motions import axis, loops, pose, push  # noqa: E402

# Self-rotation in the fade zone, s_3 = 0.11 (deg).
FADE_ZONE = 44.0
DT = 1e-3


def spend(budget, energy, steps, asked=(0.0, 0.0, 0.0)):
    """Let the motors give an energy, J, in some steps."""
    return [budget.count(energy / steps, asked, DT) for _ in range(steps)]


def test_what_the_motors_give_is_taken_from_the_budget():
    budget = EnergyBudget()
    spend(budget, 0.4e-3, 4)
    assert budget.energy == pytest.approx(ADVANCE - 0.4e-3)
    assert (budget.damping, budget.share) == (0.0, 1.0)
    spend(budget, 1.2e-3, 5)
    assert budget.damping == 1.0 and budget.share == 1.0
    spend(budget, 10.4e-3, 4)
    assert budget.energy == pytest.approx(-10e-3) and budget.share == pytest.approx(0.5)


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
    assert np.diff(found).min() >= -0.05 - 1e-9 and np.diff(found).max() <= 0.25 + 1e-9
    spend(budget, -1.0, 1, (0.0, 0.0, 0.3))
    assert budget.damping > 0.0 and budget.share == 1.0
    spend(budget, 0.0, 20, (0.0, 0.0, 0.3))
    assert budget.damping == 0.0


WEIGHTS = (1.0, 10.0, 100.0)


def test_the_work_of_motors_whose_joints_cross_half_a_turn():
    """Raw angles jump by a turn there; the joint does not. A missing angle ends the motion."""
    motion = JointMotion(3)
    for step in range(12):
        angle = np.pi - 0.005 + 1e-3 * step
        wrapped = float(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)
        work = motion.work(step * 1_000_000, (wrapped, 0.5 - 2e-3 * step, -0.5, 9.0), WEIGHTS, DT)
        if step:
            assert work == pytest.approx(1e-3 - 20e-3)
    assert motion.velocity == pytest.approx((1.0, -2.0, 0.0))
    assert motion.work(12_000_000, (0.0, float('nan'), 0.0, 9.0), WEIGHTS, DT) is None
    assert motion.is_missing and motion.velocity is None
    assert motion.work(13_000_000, (0.0, 0.0, 0.0, 9.0), WEIGHTS, DT) is None
    assert not motion.is_missing


@pytest.mark.parametrize(('motors', 'work'), [(3, 0.321), (4, 4.321)])
def test_the_work_is_that_of_the_motors_alone(motors, work):
    motion = JointMotion(motors)
    torques = (*WEIGHTS, 1000.0)[:motors]
    motion.work(0, (0.1, 0.2, 0.3, 0.4, 0.5), torques, DT)
    assert motion.work(1_000_000, (0.101, 0.202, 0.303, 0.404, 9.0), torques, DT) == pytest.approx(
        work
    )


def test_an_encoder_that_jumps_is_no_motion():
    """5 deg in a millisecond: no work is counted, and no velocity damps it."""
    motion = JointMotion(3)
    for step in range(12):
        motion.work(step * 1_000_000, (1e-3 * step, 0.0, 0.0), WEIGHTS, DT)
    assert motion.work(12_000_000, (0.012, 0.087, 0.0), WEIGHTS, DT) is None
    assert motion.velocity is None and not motion.is_missing
    assert motion.work(13_000_000, (0.013, 0.087, 0.0), WEIGHTS, DT) == pytest.approx(1e-3)


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
        angles = tuple(
            angle + 1e-2 * torque
            for angle, torque in zip(angles, (*output.motor_torque, 0.0), strict=True)
        )


def test_energy_that_is_generated_ends_in_a_latched_fault():
    bench = Bench()
    bench.engage()
    for output, _ in islice(yielding(bench), 5000):
        if output.state.condition is Condition.FAULT:
            break
    assert output.state.text == 'fault: energy generated'
    assert bench.now > 1000 * MS


def test_the_clutch_gives_a_new_budget_and_lets_the_damping_go_slowly():
    bench = Bench()
    bench.engage()
    angles = next(angles for output, angles in yielding(bench) if output.energy <= -5e-3)
    spins = (0.0, 0.0, 1.0)
    bench.torque = (0.0, 0.0, 0.0)
    torques = [bench.run(60, angles=angles, velocity=spins).motor_torque]
    for _ in range(30):
        output = bench.step(angles=angles, velocity=spins, clutched=True)
        torques.append(output.motor_torque)
    assert output.state.text == 'holding' and output.energy == pytest.approx(ADVANCE, abs=1e-4)
    # 0.06 N m s/rad at 1 rad/s, in 20 ms.
    assert np.abs(torques[0]).max() > 0.02 > 5.0 * np.abs(np.diff(torques, axis=0)).max()


def test_a_lock_that_generates_energy_falls_with_its_share():
    bench = Bench()
    bench.engage((0.0, 0.0, 0.0))
    for output, _ in islice(yielding(bench, lock=(0.0, 0.2, 0.0)), 400):
        assert math.hypot(*output.asked) <= 0.2 * output.share + 0.02
    assert output.state.text == 'engaged' and output.share < 0.9


@pytest.mark.parametrize('sense', [1, -1])
@pytest.mark.parametrize(
    'speed',
    [pytest.param(0.2, marks=pytest.mark.slow), pytest.param(1.0, marks=pytest.mark.slow), 3.0],
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
    assert found.generated <= 20e-3 and found.energy[found.start :].min() < 0.0
    assert np.abs(np.diff(found.torque[found.start :], axis=0)).max() <= 0.2


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
        left[motors] = (found.given[-1] - found.given[-1 - 2 * turn]) / 2.0
    assert left[3] > 2e-3
    assert left[4] <= 0.5e-3


def test_the_work_against_the_weight_is_not_counted():
    """The motors lift the handle for the hand: more than the budget, and none of it counts."""
    R = pose(20.0)
    controller = ForceController(
        limits=ForceLimits(ramp=0.05),
        gravity=Gravity(handle=(0.0, 0.0, 0.02), proximal=(0.005, 0.0, 0.005, 0.0, 0.005, 0.0)),
    )
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
    tilt, azimuth, phi, radius, turn = 0.227, 0.782, 0.931, 0.08, 500
    samples = []
    for number in range(turn):
        angle = -math.tau * number / turn
        R = workspace_pose(
            tilt + radius * math.sin(angle), azimuth, phi + radius * (math.cos(angle) - 1.0)
        )
        joints = inverse(R)
        samples.append(
            (
                (*joints.theta1.tolist(), float(joints.theta3a)),
                tuple(quaternion_from_matrix(R).tolist()),
            )
        )
    work, torques, before = 0.0, (0.0,) * 3, samples[0][0]
    for number in range(700 + 12 * turn):
        angles, quaternion = samples[max(0, number - 700) % turn]
        output = bench.step(angles=angles, quaternion=quaternion)
        work += sum(
            torque * (new - old) for torque, new, old in zip(torques, angles, before, strict=False)
        )
        torques, before = output.motor_torque, angles
    assert output.state.text == 'engaged'
    assert work <= 20e-3


def test_noise_at_rest_is_one_millinewtonmetre():
    """0.04 deg on each encoder, 14 bit, damping 0.005 N m s/rad."""
    found = run(pose(20.0), Slave(constant((0.0, 0.0, 0.0))), 3.0, hand=None)
    felt = found.rendered[found.start :]
    assert 0.0 < np.sqrt(np.mean(np.sum(felt**2, axis=1))) <= 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(('phi_deg', 'torque'), [(20.0, 0.1), (FADE_ZONE, 0.0)])
def test_a_minute_at_rest_leaves_the_budget(phi_deg, torque):
    """Noise alone takes at most 0.5 mJ, and nothing of the wrench."""
    slave = Slave(constant((torque, 0.0, 0.0)))
    found = run(pose(phi_deg), slave, 60.0, hand=None)
    assert found.energy[found.start :].min() >= 1.5e-3
    assert (found.share == 1.0).all()
