# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node `teleop` with a test in the place of the master, the slave and the surgeon."""

from contextlib import contextmanager
import signal
import time
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray
from disturbance import BESIDE_OTHERS, Disturbance
from geometry_msgs.msg import PoseStamped, QuaternionStamped, TwistStamped, WrenchStamped
from harness import Observer, stamp, start_program, status
from in_process import ros, spinning
from mechanism import turn, zxz
import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Joy
from spm_haptic_master.kinematics import matrix_from_quaternion, quaternion_from_matrix
from spm_haptic_master.nodes.teleop import STATE_PERIOD, Teleop
from spm_haptic_master.parameters.nodes import TELEOP_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros.duplicate_publishers import CURE
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.supervision.orientation_state import received_state
from spm_haptic_master.teleoperation.engaging import Teleoperation
from std_msgs.msg import Bool, String, UInt64
from std_srvs.srv import Trigger

pytestmark = pytest.mark.process

# A busy machine may not pause the test for longer (s); its jitter is no acceleration, and no burst
# (two periods of the rate).
PATIENT = {'teleop.orientation_timeout': 1.0, 'teleop.slave_timeout': 1.0, 'rate': 20.0,
           'teleop.presence_timeout': 0.0, 'teleop.command_rate': 0.0,
           'teleop.acceleration_limit': 1e6}
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
# So often it is engaged, because a pause of the machine uses up an enable.
ATTEMPTS = 5
POSITION = (0.01, -0.02, 0.11)


class Rig:
    """Publishes what a master and a slave do, and keeps what teleop publishes."""

    def __init__(self, observer, arm, now=time.time_ns, pedals=10):
        self.observer, self.now = observer, now
        node = observer.node
        self.commands = observer.collect(PoseStamped, f'{arm}/servo_cp')
        self.twists = observer.collect(TwistStamped, f'{arm}/delta_twist_cmds')
        self.states = observer.collect(String, f'{arm}/teleop_state', STATE)
        self.outs = {topic: node.create_publisher(
            kind, f'{arm}/{topic}', qos) for topic, kind, qos in (
            ('orientation', QuaternionStamped, 10), ('slave/measured_cp', PoseStamped, pedals),
            ('presence', Joy, pedals), ('clutch', Joy, pedals), ('state', String, STATE),
            ('enabled_at', UInt64, STATE))}
        self.clients = {name: node.create_client(Trigger, f'{arm}/teleop/{name}')
                        for name in ('enable', 'disable')}
        self.master, self.slave = zxz(0.3, 0.5, -0.2), zxz(-1.0, 0.8, 0.4)
        self.sent = []
        # Frame and stamp (s) of the slave's pose, and by how much that goes on.
        self.frame, self.slave_stamp, self.slave_ticks = 'psm_base', 1, 1
        assert observer.spin_until(
            lambda: all(out.get_subscription_count() for out in self.outs.values())
            and self.states, 60.0)
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
        now = self.now()
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

    def expect(self, words):
        """Go on until the state has these words."""
        assert self.observer.spin_until(lambda: self.send() or words in self.state, 30.0), \
            self.state

    def call(self, name):
        future = self.clients[name].call_async(Trigger.Request())
        assert self.observer.spin_until(future.done, 60.0)
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


@contextmanager
def running(arm, rig=Rig, **parameters):
    """Yield a rig and a node of this process, in a namespace."""
    with ros(arm):
        node = Teleop(Parameters(arguments=[
            f'{name}:={value}' for name, value in {**PATIENT, **parameters}.items()]))
        node.subscribe()
        observer = Observer()
        try:
            with spinning(node):
                yield rig(observer, arm)
        finally:
            observer.close()


@pytest.fixture(scope='module')
def rigs():
    """Give the rig of a teleop of its own process for all tests that need no other settings."""
    observer = Observer()
    with start_program('teleop', '-r', '__ns:=/first', parameters=PATIENT) as program:
        yield Rig(observer, '/first')
        observer.close()
        assert program.stop() == 0
        assert 'Traceback' not in program.stderr


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
    with Disturbance(BESIDE_OTHERS) as machine:
        rig.run(30, turning=(0.004, -0.002, 0.001))
    machine.expect(len(rig.commands) == before + 30, len(rig.commands) - before)
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


@pytest.mark.parametrize('state', ['silent: inconsistent angles', 'starting', 'healthy again'])
def test_a_state_without_orientations_ends_it_for_good(rig, state):
    rig.engage()
    rig.outs['state'].publish(String(data=state))
    rig.observer.spin(0.2)
    count = len(rig.commands)
    rig.run(20)
    why = received_state(state).text
    assert rig.state == f'disengaged: {why}'
    rig.outs['state'].publish(String(data='healthy'))
    rig.run(40)
    assert len(rig.commands) == count
    assert rig.state == f'disengaged: waiting for enable, after: {why}'
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
    rig.expect('disengaged: ')


def test_another_frame_of_the_slave_ends_it(rig):
    rig.engage()
    rig.frame = 'camera'
    rig.expect('after: another frame of the slave')
    rig.frame = 'psm_base'
    rig.expect('disengaged: ')


def test_another_frame_of_the_slave_ends_it_though_the_frame_is_given():
    with running('/framed', **{'teleop.frame_id': 'psm_base'}) as rig:
        rig.engage()
        rig.frame = 'camera'
        rig.expect('after: another frame of the slave')


def test_a_pose_of_the_slave_that_is_repeated_is_none():
    """As a bridge does that has lost its slave."""
    with running('/repeated', **{'teleop.slave_timeout': 0.4}) as rig:
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
    assert rig.observer.spin_until(lambda: rig.send() or rig.state == 'engaged', 30.0), rig.state


def test_a_pedal_that_is_started_anew_is_not_pressed(rig):
    rig.engage()
    node = rig.observer.node
    node.destroy_publisher(rig.outs['presence'])
    rig.outs['presence'] = node.create_publisher(Joy, '/first/presence', 10)
    rig.expect('disengaged: no presence')


def test_pedals_and_a_slave_that_are_best_effort_are_heard():
    with running('/effort', lambda observer, arm: Rig(observer, arm, pedals=BEST_EFFORT)) as rig:
        rig.engage()
        rig.press('clutch', True)
        assert rig.observer.spin_until(lambda: rig.send() or rig.state == 'clutched', 30.0)
        # A reliable one is heard beside it.
        node = rig.observer.node
        node.destroy_publisher(rig.outs['presence'])
        rig.outs['presence'] = node.create_publisher(Joy, '/effort/presence', 10)
        assert rig.observer.spin_until(
            lambda: rig.outs['presence'].get_subscription_count() > 0, 30.0)
        rig.press('clutch', False)
        assert rig.observer.spin_until(
            lambda: rig.send() or rig.state == 'disengaged: no presence', 30.0)
        rig.engage()


def test_a_publisher_that_cannot_be_heard_is_named():
    """In the state and on /diagnostics; once it has gone, nothing is named."""
    def deaf(observer, arm):
        return observer, observer.collect(String, f'{arm}/teleop_state', STATE), \
            observer.collect(DiagnosticArray, '/diagnostics')

    with running('/deaf', deaf) as (observer, states, health):
        for topic, kind, qos, words in (
                ('orientation', QuaternionStamped, BEST_EFFORT, 'BEST_EFFORT, expected RELIABLE'),
                ('state', String, 10, 'VOLATILE, expected TRANSIENT_LOCAL'),
                ('enabled_at', UInt64, BEST_EFFORT, 'BEST_EFFORT, expected RELIABLE'),
                ('presence', Bool, 10, 'std_msgs/msg/Bool, expected sensor_msgs/msg/Joy'),
                ('clutch', Bool, BEST_EFFORT,
                 'std_msgs/msg/Bool, expected sensor_msgs/msg/Joy')):
            publisher = observer.node.create_publisher(kind, f'/deaf/{topic}', qos)
            named = f'disengaged: publisher /observer on /deaf/{topic} is {words}'
            assert observer.spin_until(
                lambda named=named: states and states[-1][1].data == named, 30.0), states[-1]
            assert observer.spin_until(
                lambda named=named: (entry := status(health, 'deaf/teleop: teleop'))
                and entry.message == named, 30.0)
            observer.node.destroy_publisher(publisher)
            assert observer.spin_until(lambda: 'publisher' not in states[-1][1].data, 30.0)


def test_it_engages_in_simulated_time():
    """The orientations are of an hour after 1970; a person enables in the present."""
    with running('/simulated', lambda observer, arm: Rig(
            observer, arm, lambda: round(3600e9) + time.monotonic_ns() % 10**9),
            **{'use_sim_time': True, 'teleop.orientation_timeout': 1.0}) as rig:
        clock = rig.observer.node.create_publisher(Clock, '/clock', 10)
        assert rig.observer.spin_until(lambda: clock.get_subscription_count() > 0, 30.0)

        def send():
            stamp = Clock()
            stamp.clock.sec, stamp.clock.nanosec = divmod(rig.now(), 10**9)
            clock.publish(stamp)
            rig.send()

        rig.press('presence', True)
        for _ in range(10):
            send()
        rig.outs['enabled_at'].publish(UInt64(data=0))
        rig.observer.spin(0.2)
        rig.outs['enabled_at'].publish(UInt64(data=time.time_ns()))
        assert rig.observer.spin_until(lambda: send() or rig.state == 'engaged', 30.0), rig.state


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP])
def test_a_pedal_process_that_is_killed_or_hangs_leads_nothing(number):
    """By the message that does not come: DDS drops the process only after 20 s."""
    default = next(setting.default for setting in TELEOP_SETTINGS
                   if setting.name == 'teleop.presence_timeout')
    with running('/killed', **{'teleop.presence_timeout': default}) as rig:
        node = rig.observer.node
        node.destroy_publisher(rig.outs.pop('presence'))
        joy = node.create_publisher(Joy, '/killed/joy', 10)
        pedal = start_program('presence', '-r', '__ns:=/killed')
        try:
            def hold():
                joy.publish(Joy(buttons=[1]))
                rig.send()

            def engaged():
                hold()
                if rig.state.startswith('disengaged: waiting for enable'):
                    rig.clients['enable'].call_async(Trigger.Request())
                    rig.observer.spin(0.05)
                return rig.state == 'engaged'

            assert rig.observer.spin_until(engaged, 30.0), rig.state
            pedal.send_signal(number)
            assert rig.observer.spin_until(
                lambda: hold() or rig.state == 'disengaged: no presence', 15.0), rig.state
            # DDS has not dropped it: the time-out has ended it.
            assert node.count_publishers('/killed/presence') == 1
            count = len(rig.commands)
            for _ in range(20):
                hold()
            assert len(rig.commands) == count
        finally:
            pedal.kill()


def test_a_clutch_that_is_gone_while_pressed_ends_it_and_is_released(rig):
    rig.engage()
    rig.press('clutch', True)
    assert rig.observer.spin_until(lambda: rig.send() or rig.state == 'clutched', 30.0)
    node = rig.observer.node
    node.destroy_publisher(rig.outs['clutch'])
    rig.outs['clutch'] = node.create_publisher(Joy, '/first/clutch', 10)
    assert rig.observer.spin_until(lambda: rig.send() or rig.state == (
        'disengaged: waiting for enable, after: clutch gone while pressed'), 30.0)
    assert rig.call('enable').success
    assert rig.observer.spin_until(lambda: rig.send() or rig.state == 'engaged', 30.0)


def test_the_state_is_repeated_and_a_process_that_was_stopped_goes_on_with_nothing():
    observer = Observer()
    with start_program('teleop', '-r', '__ns:=/stopped', parameters={
            **PATIENT, 'teleop.orientation_timeout': 0.6}) as program:
        rig = Rig(observer, '/stopped')
        rig.engage()
        before = len(rig.states)
        assert rig.observer.spin_until(
            lambda: rig.send() or len(rig.states) >= before + 5, 30.0)
        program.send_signal(signal.SIGSTOP)
        rig.observer.spin(2.0 * STATE_PERIOD)
        del rig.states[:]
        count = len(rig.commands)
        for _ in range(100):
            rig.send(turning=(0.01, 0.0, 0.0))
        rig.observer.spin(3.0 * STATE_PERIOD)
        assert rig.states == []
        program.send_signal(signal.SIGCONT)
        assert rig.observer.spin_until(lambda: rig.states, 30.0)
        rig.run(60)
        assert len(rig.commands) == count
        assert rig.state.startswith('disengaged: waiting for enable, after: ')
        observer.close()
        assert program.stop() == 0


@pytest.mark.parametrize('topic, kind, qos', [
    ('slave/measured_cp', PoseStamped, 10), ('state', String, STATE),
    ('enabled_at', UInt64, STATE), ('servo_cp', PoseStamped, 10)])
def test_a_second_publisher_ends_it(rig, topic, kind, qos):
    rig.engage()
    first = '/first/teleop' if topic == 'servo_cp' else '/observer'
    node = rig.observer.node
    other = node.create_publisher(kind, f'/first/{topic}', qos)
    try:
        assert rig.observer.spin_until(
            lambda: rig.send() or rig.state == f'disengaged: 2 publishers on /first/{topic}: '
            f'{", ".join(sorted((first, "/observer")))}; {CURE}', 30.0)
    finally:
        node.destroy_publisher(other)
    assert rig.observer.spin_until(
        lambda: rig.send() or rig.state.startswith('disengaged: waiting for enable'), 30.0)


def test_a_stale_orientation_is_none():
    with running('/stale', **{'teleop.orientation_timeout': 0.5}) as rig:
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


def test_the_slaves_torque_goes_to_the_hand_while_engaged_and_else_nothing():
    with running('/felt', **{'teleop.force_scale': 0.5,
                             'teleop.registration_zxz_deg': [90.0, 0.0, 0.0]}) as rig:
        node, felt = rig.observer.node, rig.observer.collect(
            WrenchStamped, '/felt/spatial/servo_cf')
        out = node.create_publisher(WrenchStamped, '/felt/slave/measured_cf', BEST_EFFORT)

        def send(frame='psm_base'):
            message = WrenchStamped()
            message.header.frame_id, message.header.stamp.sec = frame, 7
            message.wrench.torque.x, message.wrench.force.x = 0.2, 9.0
            out.publish(message)
            rig.send()

        rig.engage()
        assert rig.observer.spin_until(lambda: send() or felt, 60.0)
        found = felt[-1][1]
        # R_slave_master^T turns x into -y; half of it, the slave's stamp, and no force.
        t, f = found.wrench.torque, found.wrench.force
        np.testing.assert_allclose((t.x, t.y, t.z), (0.0, -0.1, 0.0), atol=1e-12)
        assert (f.x, found.header.stamp.sec) == (0.0, 7)

        def sends_nothing(frame='psm_base'):
            rig.run(20)
            del felt[:]
            for _ in range(20):
                send(frame)
            rig.observer.spin(0.2)
            return not felt

        assert rig.state == 'engaged'
        assert sends_nothing('psm_tool') and not sends_nothing('')
        rig.press('clutch', True)
        assert rig.observer.spin_until(lambda: rig.send() or rig.state == 'clutched', 60.0)
        assert sends_nothing()
        rig.press('presence', False)
        assert rig.observer.spin_until(
            lambda: rig.send() or rig.state.startswith('disengaged'), 60.0)
        assert sends_nothing()


def test_without_a_share_of_the_torque_there_is_no_topic_of_it(rig):
    names = {name for name, _ in rig.observer.node.get_topic_names_and_types()}
    assert not {'/first/slave/measured_cf', '/first/spatial/servo_cf'} & names


def test_a_process_that_is_stopped_as_it_decides_says_nothing(monkeypatch):
    """The command was right when it was made; it goes out when the process is let go on."""
    sent = []
    monkeypatch.setattr(Teleop, 'create_publisher', lambda self, kind, topic, qos: SimpleNamespace(
        publish=lambda message: sent.append(message) if topic == 'servo_cp' else None,
        get_subscription_count=lambda: 0))
    stopped = [0.0, 0.2]
    monkeypatch.setattr(Teleoperation, 'take_master', lambda *_: (
        time.sleep(stopped.pop()), (0.0, 0.0, 0.0, 1.0))[1])
    with ros():
        node = Teleop(Parameters())
        node.take(time.time_ns(), (0.0, 0.0, 0.0, 1.0))
        assert sent == []
        node.take(time.time_ns(), (0.0, 0.0, 0.0, 1.0))
        assert len(sent) == 1
        node.destroy_node()
