# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node `teleop` with a test in the place of the master, the slave and the surgeon."""

from contextlib import contextmanager
import signal
import time
from types import SimpleNamespace

from geometry_msgs.msg import PoseStamped, QuaternionStamped, TwistStamped
from harness import Observer, stamp, start_program
from mechanism import turn, zxz
import numpy as np
import pytest
import rclpy
from sensor_msgs.msg import Joy
from spm_haptic_master.benchmark.child_process import private_environment
from spm_haptic_master.kinematics import matrix_from_quaternion, quaternion_from_matrix
from spm_haptic_master.nodes.qos import STATE
from spm_haptic_master.nodes.rivals import CURE
from spm_haptic_master.nodes.teleop import Teleop
from spm_haptic_master.resolver import Parameters
from spm_haptic_master.teleoperation.engaging import Teleoperation
from std_msgs.msg import String, UInt64
from std_srvs.srv import Trigger

pytestmark = pytest.mark.process

# A busy machine may not pause the test for longer (s); its jitter is no acceleration, and no burst
# (two periods of the rate).
PATIENT = {'teleop.orientation_timeout': 1.0, 'teleop.slave_timeout': 1.0, 'rate': 20.0,
           'teleop.command_rate': 0.0, 'teleop.acceleration_limit': 1e6}
# So often it is engaged, because a pause of the machine uses up an enable.
ATTEMPTS = 5
POSITION = (0.01, -0.02, 0.11)


class Rig:
    """Publishes what a master and a slave do, and keeps what teleop publishes."""

    def __init__(self, observer, arm):
        self.observer = observer
        node = observer.node
        self.commands = observer.collect(PoseStamped, f'{arm}/servo_cp')
        self.twists = observer.collect(TwistStamped, f'{arm}/delta_twist_cmds')
        self.states = observer.collect(String, f'{arm}/teleop_state', STATE)
        self.outs = {topic: node.create_publisher(
            kind, f'{arm}/{topic}', qos) for topic, kind, qos in (
            ('orientation', QuaternionStamped, 10), ('slave/measured_cp', PoseStamped, 10),
            ('presence', Joy, 10), ('clutch', Joy, 10), ('state', String, STATE),
            ('enabled_at', UInt64, STATE))}
        self.clients = {name: node.create_client(Trigger, f'{arm}/teleop/{name}')
                        for name in ('enable', 'disable')}
        self.master, self.slave = zxz(0.3, 0.5, -0.2), zxz(-1.0, 0.8, 0.4)
        self.sent = []
        # Frame and stamp (s) of the slave's pose, and by how much that goes on.
        self.frame, self.slave_stamp, self.slave_ticks = 'psm_base', 1, 1
        assert observer.spin_until(
            lambda: all(out.get_subscription_count() for out in self.outs.values())
            and self.states, 20.0)
        self.outs['state'].publish(String(data='healthy'))
        self.press('presence', False)
        self.press('clutch', False)

    def press(self, pedal, pressed):
        self.outs[pedal].publish(Joy(buttons=[int(pressed)]))

    def send(self, turning=(0.0, 0.0, 0.0), slave=True):
        """Publish an orientation, turned since the last, and the slave's pose."""
        self.master = turn(turning) @ self.master
        if slave:
            pose = PoseStamped()
            pose.header.frame_id = self.frame
            pose.header.stamp.sec = self.slave_stamp
            self.slave_stamp += self.slave_ticks
            pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = POSITION
            o = pose.pose.orientation
            o.x, o.y, o.z, o.w = quaternion_from_matrix(self.slave).tolist()
            self.outs['slave/measured_cp'].publish(pose)
        message = QuaternionStamped()
        now = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
        q = message.quaternion
        q.x, q.y, q.z, q.w = quaternion_from_matrix(self.master).tolist()
        self.sent.append((now, self.master))
        self.outs['orientation'].publish(message)
        self.observer.spin(0.005)

    def run(self, count=20, **more):
        for _ in range(count):
            self.send(**more)
        self.observer.spin(0.1)

    def call(self, name):
        future = self.clients[name].call_async(Trigger.Request())
        assert self.observer.spin_until(future.done, 20.0)
        return future.result()

    def engage(self):
        self.press('presence', True)
        for _ in range(ATTEMPTS):
            self.run(5)
            answer = self.call('enable')
            self.run(20)
            if self.state == 'engaged':
                return
        pytest.fail(f'{answer.message}; {self.state}')

    @property
    def state(self):
        return self.states[-1][1].data

    @property
    def matrices(self):
        return [matrix_from_quaternion([q.x, q.y, q.z, q.w])
                for q in (message.pose.orientation for _, message in self.commands)]


def start_teleop(arm, **parameters):
    return start_program('teleop', '-r', f'__ns:={arm}', parameters={**PATIENT, **parameters})


@contextmanager
def running(arm, **parameters):
    """Yield a rig and the node, in a namespace."""
    program = start_teleop(arm, **parameters)
    observer = Observer()
    try:
        yield Rig(observer, arm), program
    finally:
        observer.close()
        assert program.stop() == 0
        assert 'Traceback' not in program.stderr


@pytest.fixture(scope='module')
def rigs():
    with running('/first') as found:
        yield found[0]


@pytest.fixture
def rig(rigs):
    rigs.call('disable')
    rigs.press('presence', False)
    rigs.press('clutch', False)
    rigs.outs['state'].publish(String(data='healthy'))
    rigs.run(5)
    rigs.commands.clear()
    rigs.twists.clear()
    yield rigs


def test_it_follows_by_the_law_in_the_frame_and_at_the_position_of_the_slave(rig):
    rig.engage()
    master, slave, before = rig.master, rig.slave, len(rig.commands)
    rig.run(30, turning=(0.004, -0.002, 0.001))
    assert len(rig.commands) == before + 30
    sent = dict(rig.sent)
    for (_, message), got in zip(rig.commands, rig.matrices, strict=True):
        # Each by its own orientation, of which it has the stamp.
        np.testing.assert_allclose(
            got, sent[stamp(message)] @ master.T @ slave, atol=1e-12)
        assert message.header.frame_id == 'psm_base'
        p = message.pose.position
        assert (p.x, p.y, p.z) == POSITION


def test_nothing_goes_out_before_it_is_engaged(rig):
    rig.run(20)
    assert rig.state == 'disengaged: no presence'
    rig.press('presence', True)
    rig.run(20)
    assert rig.state.startswith('disengaged: waiting for enable')
    assert rig.commands == [] and rig.twists == []


@pytest.mark.parametrize('state', ['silent: inconsistent angles', 'starting'])
def test_a_state_without_orientations_ends_it_for_good(rig, state):
    rig.engage()
    rig.outs['state'].publish(String(data=state))
    rig.observer.spin(0.2)
    count = len(rig.commands)
    rig.run(20)
    assert rig.state == f'disengaged: {state}'
    rig.outs['state'].publish(String(data='healthy'))
    rig.run(40)
    assert len(rig.commands) == count
    assert rig.state == f'disengaged: waiting for enable, after: {state}'
    assert rig.call('enable').success
    rig.run(20)
    assert rig.state == 'engaged'


def test_the_clutch_and_the_presence(rig):
    rig.engage()
    rig.press('clutch', True)
    rig.observer.spin(0.2)
    count = len(rig.commands)
    rig.run(30, turning=(0.0, 0.0, 0.02))
    assert (rig.state, len(rig.commands)) == ('clutched', count)
    rig.press('clutch', False)
    rig.observer.spin(0.2)
    rig.run(10)
    np.testing.assert_allclose(rig.matrices[count], rig.slave, atol=1e-12)
    rig.press('presence', False)
    rig.observer.spin(0.2)
    count = len(rig.commands)
    rig.press('presence', True)
    rig.run(30)
    assert len(rig.commands) == count
    assert rig.state == 'disengaged: waiting for enable, after: no presence'


def test_the_twist_continues_to_zero_and_stops(rig):
    rig.engage()
    for _ in range(60):
        rig.send(turning=(0.0, 0.003, 0.0))
    rig.press('presence', False)
    rig.observer.spin(0.5)
    rates = [message.twist.angular.y for _, message in rig.twists]
    assert max(rates) > 0.1
    assert rates[-4:] == [0.0] * 4
    assert all(message.header.frame_id == 'psm_base' for _, message in rig.twists)
    count = len(rig.twists)
    rig.run(40)
    assert len(rig.twists) == count


@pytest.mark.parametrize('joy', [Joy(), Joy(buttons=[2]), Joy(buttons=[-1, 1])])
def test_a_pedal_that_is_not_pressed(rig, joy):
    rig.engage()
    rig.outs['presence'].publish(joy)
    rig.run(10)
    assert rig.state.startswith('disengaged: ')


@pytest.mark.parametrize('given', [{}, {'teleop.frame_id': 'psm_base'}])
def test_another_frame_of_the_slave_ends_it(given):
    with running('/framed', **given) as (rig, _):
        rig.engage()
        rig.frame = 'camera'
        rig.run(10)
        assert rig.state.endswith('after: another frame of the slave')


def test_a_pose_of_the_slave_that_is_repeated_is_none():
    """As a bridge does that has lost its slave."""
    with running('/repeated', **{'teleop.slave_timeout': 0.4}) as (rig, _):
        rig.engage()
        rig.slave_ticks = 0
        assert rig.observer.spin_until(
            lambda: rig.send() or rig.state == 'disengaged: no pose of the slave', 30.0)
        # Without a stamp, each is a new one.
        rig.slave_stamp = 0
        rig.run(20)
        assert rig.call('enable').success


def test_an_old_enable_that_arrives_now_engages_nothing(rig):
    rig.press('presence', True)
    rig.outs['enabled_at'].publish(UInt64(data=time.time_ns()))
    rig.run(20)
    rig.outs['enabled_at'].publish(UInt64(data=time.time_ns() - 3600 * 10**9))
    rig.run(40)
    assert rig.state.startswith('disengaged: waiting for enable')
    rig.outs['enabled_at'].publish(UInt64(data=time.time_ns()))
    rig.run(40)
    assert rig.state == 'engaged'


def test_a_pedal_that_is_started_anew_is_not_pressed(rig):
    rig.engage()
    node = rig.observer.node
    node.destroy_publisher(rig.outs['presence'])
    rig.outs['presence'] = node.create_publisher(Joy, '/first/presence', 10)
    rig.run(60)
    assert rig.state == 'disengaged: no presence'


@pytest.mark.parametrize('topic, kind, qos', [
    ('slave/measured_cp', PoseStamped, 10), ('state', String, STATE),
    ('enabled_at', UInt64, STATE)])
def test_a_second_publisher_of_an_input_ends_it(rig, topic, kind, qos):
    rig.engage()
    node = rig.observer.node
    other = node.create_publisher(kind, f'/first/{topic}', qos)
    try:
        assert rig.observer.spin_until(
            lambda: rig.send() or rig.state == f'disengaged: 2 publishers on /first/{topic}: '
            f'/observer, /observer; {CURE}', 30.0)
    finally:
        node.destroy_publisher(other)
    assert rig.observer.spin_until(
        lambda: rig.send() or rig.state.startswith('disengaged: waiting for enable'), 30.0)


def test_a_stale_orientation_is_none():
    with running('/stale', **{'teleop.orientation_timeout': 0.5}) as (rig, _):
        rig.engage()
        count = len(rig.commands)
        message = QuaternionStamped()
        q = message.quaternion
        q.x, q.y, q.z, q.w = quaternion_from_matrix(rig.master).tolist()
        for offset in (-2.0, 2.0):
            for _ in range(5):
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(
                    time.time_ns() + round(offset * 1e9), 10**9)
                rig.outs['orientation'].publish(message)
        rig.observer.spin(0.2)
        assert len(rig.commands) == count
        # They keep nothing alive either.
        rig.observer.spin(0.6)
        assert rig.state == 'disengaged: no orientation'


def test_a_second_teleop_ends_both():
    with running('/twice') as (rig, _):
        rig.engage()
        other = start_teleop('/twice')
        try:
            assert rig.observer.spin_until(
                lambda: rig.send() or '2 publishers on /twice/servo_cp: /twice/teleop, '
                f'/twice/teleop; {CURE}' in rig.state, 30.0)
        finally:
            assert other.stop() == 0


def test_a_process_that_was_stopped_goes_on_with_nothing():
    with running('/stopped', **{'teleop.orientation_timeout': 0.6}) as (rig, program):
        rig.engage()
        program.send_signal(signal.SIGSTOP)
        rig.observer.spin(0.3)
        count = len(rig.commands)
        for _ in range(100):
            rig.send(turning=(0.01, 0.0, 0.0))
        program.send_signal(signal.SIGCONT)
        rig.run(60)
        assert len(rig.commands) == count
        assert rig.state.startswith('disengaged: waiting for enable, after: ')


def test_a_process_that_is_stopped_as_it_decides_says_nothing(monkeypatch):
    """The command was right when it was made; it goes out when the process is let go on."""
    sent = []
    monkeypatch.setattr(Teleop, 'create_publisher', lambda self, kind, topic, qos: SimpleNamespace(
        publish=lambda message: sent.append(message) if topic == 'servo_cp' else None,
        get_subscription_count=lambda: 0))
    rclpy.init(args=[], domain_id=int(private_environment()['ROS_DOMAIN_ID']))
    node = Teleop(Parameters())
    stopped = [0.0, 0.2]
    monkeypatch.setattr(Teleoperation, 'take_master', lambda *_: (
        time.sleep(stopped.pop()), (0.0, 0.0, 0.0, 1.0))[1])
    try:
        node.take(time.time_ns(), (0.0, 0.0, 0.0, 1.0))
        assert sent == []
        node.take(time.time_ns(), (0.0, 0.0, 0.0, 1.0))
        assert len(sent) == 1
    finally:
        node.destroy_node()
        rclpy.shutdown()
