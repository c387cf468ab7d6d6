# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The closed loop in MuJoCo: a hand, the device, and a slave's wall behind delays."""

import numpy as np
import pytest
from spm_haptic_master.kinematics.rotations import multiply_quaternions, quaternion_from_vector

pytest.importorskip('mujoco', reason='needs mujoco')

from study.force.bare import Bare, without_energy_law  # noqa: E402, I100
from study.force.loop import constant, run, Slave, spring, wall  # noqa: E402
from study.force.motions import axis, loops, pose, push, quaternion  # noqa: E402

SOFT = (0.3, 0.01)
USUAL = (1.0, 0.01)
FREE = (0.0, 0.0)


def against_a_wall(
    phi_deg, about, stiffness, seconds, hand=USUAL, depth=0.2, slow=False, **kwargs
):
    """Push into a slave's wall: 200 Hz with 10 + 20 ms, or slow 100 Hz with 50 + 20 ms."""
    R = pose(phi_deg)
    direction = axis(R, about)
    delays = (10, 50, 20) if slow else (5, 10, 20)
    slave = Slave(wall(quaternion(R), direction, stiffness), *delays)
    motion = push(direction, depth, **kwargs)
    return run(R, slave, seconds, hand=hand, motion=motion), direction


def swing(found, direction, at, window=0.5):
    """Half of the way that the handle goes within a window, rad."""
    first = found.start + round(at * 1000)
    last = first + round(window * 1000)
    along = found.turned[first:last] @ direction
    return 0.5 * np.ptp(along)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('phi_deg', 'about', 'hand', 'depth', 'most'),
    [
        (20.0, 'roll', USUAL, 0.06, 5e-3),
        (60.0, 'roll', USUAL, 0.2, 6e-3),
        (60.0, 'roll', SOFT, 0.2, 6e-3),
        (20.0, 'tilt', USUAL, 0.2, 6e-3),
    ],
)
def test_a_slaves_wall_of_2_at_200_hz_and_30_ms(phi_deg, about, hand, depth, most):
    found, direction = against_a_wall(phi_deg, about, 2.0, 3.5, hand, depth)
    assert found.generated <= most
    assert found.share.min() >= 0.9
    assert swing(found, direction, 3.0) <= 12e-3
    assert found.states[-1] == 'engaged'


@pytest.mark.slow
def test_at_that_wall_the_handle_comes_to_rest():
    found, direction = against_a_wall(20.0, 'roll', 2.0, 12.5)
    assert swing(found, direction, 12.0) <= 3e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ('about', 'stiffness', 'hand'),
    [
        ('roll', 2.0, USUAL),
        ('roll', 8.0, USUAL),
        ('tilt', 8.0, USUAL),
        ('roll', 8.0, SOFT),
    ],
)
def test_a_wall_at_100_hz_and_70_ms_generates_at_most_20_mj(about, stiffness, hand):
    found, _ = against_a_wall(20.0, about, stiffness, 3.0, hand, slow=True)
    assert found.generated <= 20e-3
    assert found.states[-1] == 'engaged'


def test_without_the_energy_law_that_wall_generates_more():
    """So the test above can fail."""
    R = pose(20.0)
    direction = axis(R, 'roll')
    found = run(
        R,
        Slave(wall(quaternion(R), direction, 2.0), 10, 50, 20),
        1.0,
        motion=push(direction, 0.2),
        controller=without_energy_law(),
    )
    assert found.generated > 50e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ('depth', 'stiffness', 'most'),
    [
        (0.1, 1.0, 0.01),
        (0.3, 1.0, 0.01),
        (0.3, 2.0, 0.08),
    ],
)
def test_a_spring_that_is_pressed_and_released_keeps_its_torque(depth, stiffness, most):
    found, direction = against_a_wall(
        20.0, 'roll', stiffness, 1.6, depth=depth, rise=0.5, hold=0.5
    )
    asked = np.linalg.norm(found.asked, axis=1)
    pressed = asked > 0.02
    of_slave = asked[pressed] / found.share[pressed]
    assert pressed.sum() > 500
    assert 1.0 - asked[pressed].sum() / of_slave.sum() <= most


@pytest.mark.slow
@pytest.mark.parametrize('stiffness', [1.0, 10.0])
def test_twelve_loops_in_the_fade_zone_by_a_hand(stiffness):
    R = pose(44.0)
    motion, environment, seconds = loops(R, 1.0, 12, 1)
    found = run(
        R,
        Slave(environment),
        seconds,
        motion=motion,
        hand=(stiffness, 0.01),
    )
    assert found.generated <= 20e-3
    assert found.states[-1] == 'engaged'


def test_a_local_wall_of_2_is_stable_with_a_latency_of_one_sample():
    """By damping of 0.005 N m s/rad alone, without a hand and without the energy law."""
    R = pose(0.0)
    for about in ('roll', 'tilt'):
        direction = axis(R, about)
        ahead = quaternion_from_vector(*(0.02 * direction).tolist())
        centre = multiply_quaternions(ahead, quaternion(R))
        found = run(
            R,
            Slave(spring(centre, 2.0)),
            0.8,
            hand=FREE,
            controller=Bare(0.005),
        )
        at_first = swing(found, direction, 0.0, 0.2)
        assert swing(found, direction, 0.6, 0.2) < 0.5 * at_first


def test_across_the_singular_surface_under_a_torque_there_is_no_step():
    """0.3 N m of roll and a hand of 10 N m/rad through phi = 49.4 deg: 0.15 N m a ms at most."""
    R = pose(40.0)
    roll = axis(R, 'roll')
    found = run(
        R,
        Slave(constant(tuple((0.3 * roll).tolist()))),
        1.5,
        hand=(10.0, 0.03),
        motion=push(roll, 0.35, rise=1.2),
    )
    steps = np.diff(found.rendered[found.start :], axis=0)
    assert found.states[-1] == 'engaged'
    assert found.turned[-1] @ roll > 0.25
    assert np.linalg.norm(steps, axis=1).max() <= 0.15
