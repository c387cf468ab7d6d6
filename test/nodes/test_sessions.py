# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A device with its slave and its pedals in one process: what it publishes, logs and shows.

The recordings in test/data/sessions have each change of a state, each line of the log and all
topics. To record a session anew, delete its file and run its test.
"""

from contextlib import contextmanager
from runpy import run_path
import sys
from unittest import mock

from geometry_msgs.msg import PoseStamped, WrenchStamped
from harness import ROOT, stamp
from in_process import hosted
import numpy as np
import pytest
import rclpy
from rclpy.task import Future
from recorded_text import assert_recorded
from sensor_msgs.msg import Joy
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.nodes import master
from spm_haptic_master.nodes.console import Console
from spm_haptic_master.nodes.presence import Presence
from spm_haptic_master.nodes.sim_slave import SimSlave
from spm_haptic_master.ros import node_log
from std_msgs.msg import Float64MultiArray, String

# Topics of which each message is an event: a text, and its time.
EVENTS = ('state', 'teleop_state', 'operating_state_text', 'error', 'warning', 'source')


class Device:
    """A master, its slave and its pedals in one process, and what they publish and log."""

    def __init__(self, host, done, logged):
        self.host = host
        self.done = done
        self.begin = host.monotonic()
        self._logged = logged
        self.driver = next(node for node in host.nodes if node.get_name() == 'encoder_driver')

    def run(self, seconds, script):
        """Let the driver work, and do what the script has for a time, s."""
        script = sorted(script.items())
        read = self.driver._source.read

        def read_in_time(timeout):
            self.host.run(0.0)
            now = self.host.monotonic() - self.begin
            while script and now >= script[0][0]:
                script.pop(0)[1]()
            if now > seconds:
                self.driver._stop.set()
            return read(timeout)

        self.driver._source.read = read_in_time
        self.driver._run()
        assert not self.done.done()

    def times(self, topic):
        """Return when the messages of a topic were published, s since the begin."""
        return np.array(self.host.times[topic]) - self.begin

    def events(self):
        """Return the changes of all states and all lines of the log in their order, one a line."""
        found = [(time - self.begin, 'log', text) for time, text in self._logged]
        for topic in EVENTS:
            before = None
            for time, message in zip(self.times(topic), self.host.sent[topic], strict=True):
                if message.data != before:
                    found.append((time, topic, message.data))
                before = message.data
        found.sort(key=lambda event: event[0])
        return [f'{time:.1f} {topic}: {text}' for time, topic, text in found]

    def last(self, topic, at):
        """Return the last message of a topic before a time, s."""
        count = np.searchsorted(self.times(topic), at)
        return self.host.sent[topic][int(count) - 1]

    def topics(self):
        """Return the topics with a message, one a line."""
        sent = self.host.sent
        return [f'topic {name}' for name in sorted(sent) if name != '/parameter_events']

    def entries(self, at):
        """Return the entries on /diagnostics before a time, s, by name, as text by key."""
        latest = {}
        for time, array in zip(
            self.times('/diagnostics'), self.host.sent['/diagnostics'], strict=True
        ):
            for status in array.status:
                if time < at:
                    latest[status.name] = {
                        'level': int.from_bytes(status.level, 'little'),
                        'message': status.message,
                        **{entry.key: entry.value for entry in status.values},
                    }
        return latest


def example(name):
    """Return what makes the node of an example."""

    def make(_):
        with mock.patch.object(rclpy, 'init'), mock.patch.object(rclpy, 'spin') as spin:
            run_path(str(ROOT / 'examples' / name))
        return spin.call_args.args[0]

    return make


@contextmanager
def device(monkeypatch, *settings, beside=(SimSlave, Presence), remaps=()):
    logged = []
    done = Future()
    for level in ('info', 'warning', 'error'):
        monkeypatch.setattr(
            node_log,
            level,
            lambda node, text, level=level: logged.append(
                (node_log.time.monotonic(), f'{node.get_name()} {level}: {text}')
            ),
        )
    monkeypatch.setattr(Console, 'start', lambda _: None)
    # As recorded: without the messages of packages that may be installed.
    for name in ('crtk_msgs', 'tf2_msgs', 'tf2_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, None)

    def make(parameters):
        nodes = []

        def add(kind, *args):
            nodes.append(kind(parameters, *args))
            return nodes[-1]

        master.compose(done, add)
        return [*nodes, *(kind(parameters) for kind in beside)]

    with hosted(
        make,
        'source:=sim',
        'teleop.run:=true',
        'presence.clutch_button:=1',
        'presence.joy_timeout:=0.0',
        *settings,
        remaps=remaps,
    ) as host:
        yield Device(host, done, logged)


RECORDED = (
    'rate:=100.0',
    'crtk_rate:=20.0',
    'sim.noise_deg:=0.02',
    'recovery:=0.2',
    'slave.rate:=50.0',
)
SETTINGS = {
    'four': (
        'sim.trajectory:=tour',
        'gripper.axis:=0',
        'alert_limit_deg:=5.0',
        'mounting.base_zxz_deg:=[30.0, 40.0, -70.0]',
        'mounting.table_frame_id:=table',
        'teleop.protection_limit_deg:=4.0',
    ),
    'six': (
        'sim.trajectory:=sweep',
        'sensors:=6',
        'gripper.position_deg:=20.0',
        'mounting.handle_zxz_deg:=[0.0, 0.0, 45.0]',
        'teleop.alignment:=absolute',
    ),
}


# A time at which the slave follows (s).
MIDDLE = 2.8
# Rates of topics while the device is healthy and the slave follows (Hz).
HEALTHY = (2.6, 3.0)
RATES = {
    'orientation': 100.0,
    'protection_level': 100.0,
    'pose_with_covariance': 100.0,
    'measured_js': 100.0,
    'measured_cp': 20.0,
    'measured_cv': 20.0,
    'crtk/measured_js': 20.0,
    'slave/measured_cp': 50.0,
}


def quaternion(message):
    """Return the quaternion of a message x, y, z, w, whatever it is in."""
    inner = getattr(message, 'pose', message)
    inner = getattr(inner, 'pose', inner)
    q = inner.quaternion if hasattr(inner, 'quaternion') else inner.orientation
    return np.array([q.x, q.y, q.z, q.w])


def matrix(message):
    """Return the rotation matrix of a message with an orientation."""
    return matrix_from_quaternion(quaternion(message))


def turn(axis, degrees):
    """Return the rotation matrix of a turn about x or z, deg."""
    c = np.cos(np.radians(degrees))
    s = np.sin(np.radians(degrees))
    if axis == 'z':
        return np.array(
            [
                [c, -s, 0.0],
                [s, c, 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
    return np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, c, -s],
            [0.0, s, c],
        ]
    )


def angle_deg(first, second):
    """Return the angle between the orientations of two messages, deg."""
    return np.degrees(rotation_distance(quaternion(first), quaternion(second)))


UNTURNED = np.array([0.0, 0.0, 0.0, 1.0])
FRAMES = {
    'table': (
        *('orientation', 'measured_cp', 'measured_cv', 'pose_with_covariance', 'setpoint_cp'),
        *('crtk/measured_js', 'gripper/measured_js'),
    ),
    'spm_base': ('measured_js', 'readings'),
    'slave_base': ('servo_cp', 'slave/measured_cp', 'delta_twist_cmds'),
    'rig_base': ('ground_truth/orientation',),
}
NINE = [f'joint_{number}{leg}' for leg in 'abc' for number in '123']
FOUR = ['joint_1a', 'joint_1b', 'joint_1c', 'joint_3a']


def check_orientations(rig, last):
    """Check the orientations on all topics, and that the slave follows."""
    # The mounting of SETTINGS: base on table.
    mounting = turn('z', 30.0) @ turn('x', 40.0) @ turn('z', -70.0)
    true = mounting @ matrix(last('ground_truth/orientation'))
    found = last('orientation')
    np.testing.assert_allclose(matrix(found), true, atol=np.radians(0.1))
    assert angle_deg(found, last('pose_with_covariance')) == 0.0
    # A rate of 20 Hz: as old as 50 ms.
    assert angle_deg(found, last('measured_cp')) < 0.5
    assert angle_deg(last('measured_cp'), last('setpoint_cp')) == 0.0
    assert angle_deg(last('servo_cp'), last('slave/measured_cp')) < 0.5
    # The slave lags: it is never beyond its command.
    for at in np.arange(2.70, 2.90, 0.02):
        command = quaternion(rig.last('servo_cp', at))
        reached = quaternion(rig.last('slave/measured_cp', at))
        assert rotation_distance(UNTURNED, reached) < rotation_distance(UNTURNED, command), at


def check_covariance(last):
    """Check the covariance of the pose: of the orientation alone, of some hundredths of a deg."""
    covariance = np.reshape(last('pose_with_covariance').pose.covariance, (6, 6))
    assert not covariance[:3].any()
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-12)
    sigmas = np.degrees(np.sqrt(np.diag(covariance)[3:]))
    assert (sigmas > 0.01).all()
    assert (sigmas < 0.05).all()


def check_velocity(rig, last):
    """Check the angular velocity in the frame of the pose, of one tenth of a second."""
    before = matrix(rig.last('orientation', MIDDLE - 0.05))
    after = matrix(rig.last('orientation', MIDDLE + 0.05))
    rate = (after @ before.T - before @ after.T) / (2.0 * 0.1)
    speed = np.array([rate[2, 1], rate[0, 2], rate[1, 0]])
    twist = last('measured_cv').twist
    np.testing.assert_allclose(components(twist.angular), speed, atol=0.05)
    assert components(twist.linear) == (0.0, 0.0, 0.0)
    given = np.linalg.norm(components(last('delta_twist_cmds').twist.angular))
    assert given == pytest.approx(np.linalg.norm(speed), rel=0.3)


def check_joints(last):
    """Check names and angles of the joints."""
    for topic in ('measured_js', 'readings', 'crtk/measured_js'):
        assert last(topic).name == FOUR
    assert last('joint_states').name == NINE
    positions = dict(zip(NINE, last('joint_states').position, strict=True))
    measured = [positions[name] for name in FOUR]
    for topic in ('measured_js', 'readings', 'crtk/measured_js'):
        np.testing.assert_allclose(last(topic).position, measured, atol=np.radians(0.3))


def check_messages_of_four(rig):
    """Check what each topic has while the slave follows."""

    def last(topic):
        return rig.last(topic, MIDDLE)

    for frame, topics in FRAMES.items():
        for topic in topics:
            assert last(topic).header.frame_id == frame, topic
    check_orientations(rig, last)
    check_covariance(last)
    check_velocity(rig, last)
    check_joints(last)
    # Half of the way from 0 to 90 deg.
    assert last('gripper/measured_js').name == ['gripper']
    assert last('gripper/measured_js').position[0] == pytest.approx(np.pi / 4)
    assert list(last('presence').buttons) == [1]
    assert list(last('clutch').buttons) == [0]
    assert last('enabled_at').data == pytest.approx(ENABLED_AT, abs=50_000_000)


# The command `enable` of the session, ns.
ENABLED_AT = 1_800_000_000_900_000_000


def check_levels(rig, names):
    """Check protection level and dexterity, with sensors that are all checked."""
    level = rig.last('protection_level', MIDDLE)
    joints = len(names)
    labels = [
        'protection_level_deg',
        *(f'unchecked_{name}_s' for name in names),
        *(f'bound_{name}_deg' for name in names),
    ]
    dimension = level.layout.dim[0]
    assert dimension.label == ', '.join(labels)
    assert dimension.size == len(labels)
    assert dimension.stride == len(labels)
    assert len(level.data) == len(labels)
    protection, *of_joints = level.data
    assert of_joints[:joints] == [0.0] * joints
    assert protection == max(of_joints[joints:])
    assert 0.2 < protection < 2.0
    three, every = rig.last('dexterity', MIDDLE).data
    assert 0.0 < three < every < 1.0
    further = ' '.join(f'th{name[-2:].upper()}' for name in names[3:])
    assert rig.last('dexterity', MIDDLE).layout.dim[0].label == (
        f'dexterity of 3 sensors (th1A th1B th1C), of {joints} sensors (+ {further})'
    )


MESSAGES = {
    'diagnostics: singularity': 'clear of singularities',
    'encoder_driver: encoders': 'publishing [sim]',
    'fkm: orientation': 'healthy',
    'fkm: timing': 'in time',
    'presence: pedals': 'pressed',
    'sim_slave: tracking': 'following',
    'teleop: teleop': 'engaged',
}


def check_entries(rig, names, mounting):
    """Check the entries on /diagnostics: all is well, and their values."""
    entries = rig.entries(MIDDLE)
    assert {name: entry['message'] for name, entry in entries.items()} == MESSAGES
    assert {entry['level'] for entry in entries.values()} == {0}
    mechanisms = [entry['mechanism'] for entry in entries.values() if 'mechanism' in entry]
    assert len(mechanisms) == 3
    assert len(set(mechanisms)) == 1
    assert entries['encoder_driver: encoders']['joints missing'] == 'none'
    assert entries['encoder_driver: encoders']['directions not verified'] == 'none'
    assert entries['diagnostics: singularity']['sensors left out'] == 'none'
    check_orientation_entry(entries['fkm: orientation'], names, mounting)
    check_timing_entry(entries['fkm: timing'])
    check_teleop_entry(entries['teleop: teleop'])
    assert float(entries['sim_slave: tracking']['tracking error (deg)']) < 0.5


def check_teleop_entry(teleop):
    """Check the entry of the tele-operation: engaged twice, and never ended by a fault."""
    assert teleop['engaged or clutched off (times)'] == '2'
    assert teleop['disengaged last by'] == 'nothing'
    assert teleop['stale orientations'] == '0'


def check_orientation_entry(orientation, names, mounting):
    """Check the entry of the orientation."""
    expected = {
        'mounting': mounting,
        'sample rate (Hz)': '100',
        'samples rejected': '4',
        'rejected: starting': '4',
        'last rejected': 'starting: 4 consistent samples of 5',
        'calibration: samples not accepted': '0',
        **{f'{name} unchecked (s)': '0' for name in names},
    }
    assert expected.items() <= orientation.items()
    # Noise of 0.02 deg, of an encoder with 0.022 deg a count.
    for name in names:
        assert 0.02 < float(orientation[f'{name} noise (deg)']) < 0.05


def check_timing_entry(timing):
    """Check the entry of the timing, which has the parity's distribution."""
    assert timing['orientation rate (Hz)'] == '100'
    assert timing['missed deadlines'] == '0'
    assert abs(float(timing['parity mean (sigma)'])) < 1.0
    assert 0.2 < float(timing['parity deviation (sigma)']) < 1.5


def check_four(rig):
    """Check the session of four sensors where the slave follows."""
    check_messages_of_four(rig)
    check_levels(rig, FOUR)
    check_entries(rig, FOUR, 'spm_base on table (not on /tf_static: no tf2_msgs)')


def check_six(rig):
    """Check the session of six sensors where the slave follows."""
    names = [*FOUR, 'joint_3b', 'joint_3c']
    assert rig.last('measured_js', MIDDLE).name == names
    check_levels(rig, names)
    check_entries(rig, names, 'spm_handle on spm_platform (not on /tf_static: no tf2_msgs)')


CHECKS = {'four': check_four, 'six': check_six}


@pytest.mark.parametrize('name', SETTINGS)
def test_a_session_is_as_recorded(monkeypatch, name):
    with device(monkeypatch, *RECORDED, *SETTINGS[name]) as rig:
        host = rig.host

        def give(topic, kind, **fields):
            return lambda: host.give(topic, kind(**fields))

        def fail(text):
            return give('simulation/fault', String, data=text)

        rig.run(
            10.0,
            {
                0.9: lambda: host.call('enable'),
                1.0: give('joy', Joy, buttons=[1, 0]),
                1.2: lambda: host.call('~/enable'),
                1.5: give('gripper/joy', Joy, axes=[0.5]) if name == 'four' else lambda: None,
                2.0: give('joy', Joy, buttons=[1, 1]),
                2.5: give('joy', Joy, buttons=[1, 0]),
                3.0: fail('offset:joint_1b=4'),
                3.6: fail(''),
                4.4: lambda: host.call('enable'),
                5.0: fail('dropout:joint_3a'),
                5.5: fail(''),
                6.2: lambda: host.call('enable'),
                6.6: lambda: host.pause(0.6),
                7.6: lambda: host.publishers.update({'/orientation': ('fkm', 'another')}),
                8.0: host.publishers.clear,
                8.2: fail('melt:joint_1c'),
                # What cannot be done is logged, and changes nothing.
                8.3: give('simulation/steer', Float64MultiArray, data=[1.0, 0.0, 0.0]),
                8.4: give('simulation/steer', Float64MultiArray, data=[1.0]),
                8.5: give('servo_cp', PoseStamped),
                8.55: give('joy', Joy, buttons=[2]),
                8.6: give('simulation/steer', Float64MultiArray, data=[0.1, 0.2, 0.3]),
                9.2: lambda: host.call('disable'),
                9.4: give('simulation/steer', Float64MultiArray),
            },
        )
        assert_recorded(f'sessions/{name}.txt', '\n'.join([*rig.events(), *rig.topics(), '']))
        CHECKS[name](rig)
        for topic, rate in RATES.items():
            times = rig.times(topic)
            count = np.count_nonzero((times >= HEALTHY[0]) & (times < HEALTHY[1]))
            assert count == pytest.approx(rate * (HEALTHY[1] - HEALTHY[0]), abs=1), topic
        # A client ignores what is not newer.
        for topic in ('slave/measured_cp', 'presence', 'orientation', 'ground_truth/orientation'):
            stamps = list(map(stamp, host.sent[topic]))
            assert stamps == sorted(set(stamps))


POWERED = (
    'rate:=500.0',
    'alert_limit_deg:=5.0',
    'crtk_rate:=0.0',
    'force.enabled:=true',
    'force.without_drives:=true',
    'force.protection_limit_deg:=5.0',
    'force.damping:=0.0',
)
AT_REST = 'sim.trajectory:=fixed', 'sim.pose_deg:=[130.0, 50.0, 20.0]'


def components(vector):
    return vector.x, vector.y, vector.z


def test_the_hand_feels_the_slave_while_it_leads_it(monkeypatch):
    with device(
        monkeypatch,
        *POWERED,
        *AT_REST,
        'teleop.force_scale:=0.5',
    ) as rig:
        host = rig.host
        felt = []

        def send(torque):
            message = WrenchStamped()
            message.wrench.torque.x, message.wrench.torque.y = torque
            given = message.header.stamp
            given.sec, given.nanosec = divmod(host.time_ns(), 10**9)
            host.give('slave/measured_cf', message)

        def press(*buttons):
            felt.append(components(host.last('spatial/measured_cf').wrench.torque))
            host.give('joy', Joy(buttons=buttons))

        rig.run(
            2.0,
            {
                0.6: lambda: press(1, 0),
                0.7: lambda: host.call('~/enable'),
                **{0.01 * number: lambda: send((0.0, 0.0)) for number in range(80, 100)},
                **{0.01 * number: lambda: send((0.1, -0.2)) for number in range(100, 200)},
                1.4: lambda: press(1, 1),
                1.7: lambda: press(0, 0),
            },
        )
        # Half of it, before the clutch.
        np.testing.assert_allclose(
            felt, [(0.0, 0.0, 0.0), (0.05, -0.1, 0.0), (0.0, 0.0, 0.0)], atol=1e-3
        )
        assert [each.data for each in host.sent['force_state']] == [
            'off',
            'ready',
            'engaged',
            'holding',
            'fading: no hand on the handle',
            'ready',
        ]


def test_the_slave_in_the_examples_follows_from_where_it_is(monkeypatch):
    with device(
        monkeypatch, 'rate:=200.0', 'sim.trajectory:=sweep', beside=[example('slave.py'), Presence]
    ) as rig:
        host = rig.host
        rig.run(
            3.0,
            {
                0.9: lambda: host.give('joy', Joy(buttons=[1])),
                1.0: lambda: host.call('~/enable'),
                2.5: lambda: host.give('joy', Joy(buttons=[0])),
            },
        )
        commands = [quaternion(each) for each in host.sent['servo_cp']]
        poses = [quaternion(each) for each in host.sent['slave/measured_cp']]
        assert rotation_distance(commands[0], poses[0]) < 1e-9
        assert rotation_distance(commands[0], commands[-1]) > 0.05
        assert rotation_distance(commands[-1], poses[-1]) < 1e-9
        assert host.last('teleop_state').data.startswith('disengaged: ')


def test_a_filter_between_driver_and_fkm_is_not_passed_by(monkeypatch):
    """With the topic remapped for one of them, in a namespace."""
    with device(
        monkeypatch,
        'rate:=100.0',
        'recovery:=0.2',
        'alert_limit_deg:=5.0',
        remaps=('__ns:=/left', 'fkm:measured_js:=filtered_js'),
    ) as rig:
        host = rig.host
        passed = set()
        before = []

        def pass_on():
            sample = host.last('measured_js')
            passed.add(stamp(sample))
            host.give('filtered_js', sample)

        rig.run(
            1.5,
            {
                0.5: lambda: before.extend(host.sent['orientation']),
                **{0.01 * number: pass_on for number in range(60, 150)},
            },
        )
        assert before == []
        assert set() < {stamp(each) for each in host.sent['orientation']} <= passed
