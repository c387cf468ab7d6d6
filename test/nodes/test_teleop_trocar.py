# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A slave that pivots about its trocar, by the messages of `teleop`; and its jaw."""

from math import nan

from harness import stamp
from mechanism import turn
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import matrix_from_quaternion
from teleop_rig import running

TROCAR = np.array([0.3, -0.1, 0.05])
# Shaft in the tool's frame.
SHAFT = np.array([0.0, 0.6, 0.8])
DEPTH = 0.12


def place(rig, depth=DEPTH):
    rig.tip = tuple(map(float, TROCAR + depth * rig.slave @ SHAFT))


def pivoting(rig, by_topic=True):
    """Give the rig's slave a trocar, a tip and a master with an insertion."""
    place(rig)
    rig.insertion = 0.03
    if by_topic:
        rig.give_trocar(TROCAR, 'psm_base')
    return rig


@pytest.mark.parametrize('by_topic', [True, False])
def test_each_command_pivots_about_the_trocar(by_topic):
    given = {} if by_topic else {'teleop__trocar': TROCAR.tolist()}
    with running(teleop__insertion_scale=0.5, **given) as rig:
        pivoting(rig, by_topic).engage()
        np.testing.assert_allclose(rig.tips[0], rig.tip, atol=1e-12)
        insertions = {}
        for _ in range(40):
            rig.insertion += 0.0005
            insertions[rig.now()] = rig.insertion
            rig.run(1, (0.004, -0.002, 0.003))
        for message, tip, rotation in zip(rig.commands, rig.tips, rig.matrices, strict=True):
            insertion = insertions.get(stamp(message), 0.03)
            depth = DEPTH + 0.5 * (insertion - 0.03)
            np.testing.assert_allclose(tip, TROCAR + depth * rotation @ SHAFT, atol=1e-12)
            off = np.linalg.norm(np.cross(TROCAR - tip, rotation @ SHAFT))
            assert off <= 1e-12
        rig.host.run(1.0)
        figure = rig.host.figures('teleop')['depth of the tip below the trocar (mm)']
        assert float(figure) == pytest.approx(1000.0 * DEPTH)


def test_the_twist_is_that_of_the_tip():
    with running(teleop__acceleration_limit=1e6) as rig:
        pivoting(rig).engage()
        for _ in range(20):
            rig.insertion += 0.0005
            rig.run(1, (0.004, -0.002, 0.003))
        tip = rig.tips[-1]
        rotation = rig.matrices[-1]
        twist = rig.twists[-1].twist
        turning = np.array([0.4, -0.2, 0.3])
        expected = np.cross(turning, tip - TROCAR) + 0.05 * rotation @ SHAFT
        np.testing.assert_allclose(
            (twist.angular.x, twist.angular.y, twist.angular.z), turning, atol=1e-9
        )
        np.testing.assert_allclose(
            (twist.linear.x, twist.linear.y, twist.linear.z), expected, atol=1e-9
        )


def test_a_lost_insertion_ends_it_and_names_it():
    """At 100 Hz: after 3 periods and 10 ms; the orientations go on."""
    with running() as rig:
        pivoting(rig).engage()
        rig.insertion = None
        count = len(rig.commands)
        rig.run(10)
        # Each of the 10 samples is an orientation; 40 ms have a command.
        assert 3 <= len(rig.commands) - count <= 4
        assert rig.state == 'disengaged: insertion missing'


@pytest.mark.parametrize(
    'message',
    [
        JointState(name=['gripper'], position=[0.1]),
        JointState(name=['insertion'], position=[nan]),
        JointState(name=['insertion'], position=[]),
        JointState(name=['insertion'], position=[0.1]),  # its stamp is of 1970
    ],
)
def test_what_is_no_insertion_does_not_count_as_one(message):
    with running() as rig:
        pivoting(rig).engage()
        rig.insertion = None
        for _ in range(10):
            rig.host.give('insertion/measured_js', message)
            rig.run(1)
        assert rig.state == 'disengaged: insertion missing'


def test_an_insertion_that_is_repeated_is_none():
    with running() as rig:
        pivoting(rig).engage()
        repeated = JointState(name=['insertion'], position=[0.03])
        seconds, nanoseconds = divmod(rig.now(), 10**9)
        repeated.header.stamp.sec = seconds
        repeated.header.stamp.nanosec = nanoseconds
        rig.insertion = None
        for _ in range(10):
            rig.host.give('insertion/measured_js', repeated)
            rig.run(1)
        assert rig.state == 'disengaged: insertion missing'


@pytest.mark.parametrize(
    ('position', 'frame', 'why'),
    [
        (TROCAR + [0.0, 0.003, 0.0], 'psm_base', 'trocar moved by 3 mm'),
        ([nan, 0.0, 0.0], 'psm_base', 'slave/trocar is not finite'),
        (
            TROCAR,
            'camera',
            "slave/trocar is in frame 'camera'; expected 'psm_base' as slave/measured_cp, or none",
        ),
    ],
)
def test_a_trocar_that_moves_or_is_none_ends_it(position, frame, why):
    with running() as rig:
        pivoting(rig).engage()
        rig.give_trocar(position, frame)
        rig.run(30)
        assert rig.sends_nothing()
        assert why in rig.state


def test_the_jaw_meets_the_gripper_at_its_speed_and_stops_alone():
    with running(gripper__align_speed=0.5) as rig:
        jaws = rig.host.sent['slave/jaw/servo_jp']
        rig.gripper = 0.6
        rig.jaw = 0.2
        rig.run(20)
        assert len(jaws) == 0
        rig.engage()
        rig.run(100)
        angles = [message.position[0] for message in jaws]
        assert angles[0] == pytest.approx(0.2)
        assert np.max(np.abs(np.diff(angles))) <= 0.5 * 0.01 + 1e-9
        assert angles[-1] == pytest.approx(0.6)
        assert len(jaws) == len(rig.commands)
        assert stamp(jaws[-1]) == stamp(rig.commands[-1])
        # A lost gripper stops the jaw, and nothing else.
        rig.gripper = None
        rig.run(20)
        count = len(jaws)
        commands = len(rig.commands)
        rig.run(20)
        assert len(jaws) == count
        assert len(rig.commands) == commands + 20
        # It comes back elsewhere: the jaw begins where it is.
        rig.gripper = 0.1
        rig.jaw = 0.6
        rig.run(2)
        assert jaws[-1].position[0] == pytest.approx(0.6, abs=0.011)


@pytest.mark.parametrize(('gripper', 'jaw'), [(None, 0.2), (0.2, None)])
def test_no_jaw_is_commanded_without_a_gripper_or_where_the_jaw_is_not_known(gripper, jaw):
    with running() as rig:
        rig.gripper = gripper
        rig.jaw = jaw
        rig.engage()
        rig.run(20)
        assert len(rig.host.sent['slave/jaw/servo_jp']) == 0


def test_the_clutch_takes_the_depth_anew_at_the_measured_pose():
    with running() as rig:
        pivoting(rig).engage()
        rig.press('clutch', True)
        rig.run(5)
        rig.slave = turn([0.01, 0.0, 0.0]) @ rig.slave
        place(rig, DEPTH + 0.02)
        rig.insertion = -0.05
        rig.run(20)
        rig.press('clutch', False)
        count = len(rig.commands)
        rig.run(1)
        np.testing.assert_allclose(rig.tips[count], rig.tip, atol=1e-12)
        q = rig.commands[count].pose.orientation
        np.testing.assert_allclose(
            matrix_from_quaternion([q.x, q.y, q.z, q.w]), rig.slave, atol=1e-12
        )
