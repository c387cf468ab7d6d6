# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A device with its slave and its pedals in one process: what it publishes, logs and shows.

To record a session anew, delete its file in test/data/sessions and run its test.
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

    def values(self, topic, at):
        """Return the last message of a topic before a time, one value a line, without stamps."""
        times = self.times(topic)
        count = np.searchsorted(times, at)
        message = self.host.sent[topic][int(count) - 1]
        return [
            f'{at:.1f} {topic}{name}: {value}'
            for name, value in fields(message)
            if name != '.stamp'
        ]

    def counts(self):
        """Return each topic with the number of its messages, one a line."""
        return [
            f'{topic}: {len(messages)}'
            for topic, messages in sorted(self.host.sent.items())
            if topic != '/parameter_events'
        ]

    def entries(self, at, end):
        """Return the entries before a time whose name ends so, one value a line."""
        latest = {}
        for time, array in zip(
            self.times('/diagnostics'), self.host.sent['/diagnostics'], strict=True
        ):
            for status in array.status:
                if time < at and status.name.endswith(end):
                    latest[status.name] = status
        return [
            f'{at:.1f} {name}, {key}: {value}'
            for name, status in sorted(latest.items())
            for key, value in (
                ('level', int.from_bytes(status.level, 'little')),
                ('message', status.message),
                *((entry.key, entry.value) for entry in status.values),
            )
        ]


def fields(value, name=''):
    """Yield name and value of each field of a message that is no message itself."""
    if hasattr(value, 'get_fields_and_field_types'):
        for field in value.get_fields_and_field_types():
            if field != 'stamp':
                yield from fields(getattr(value, field), f'{name}.{field}')
    elif isinstance(value, (str, bool, int)):
        if value != '':
            yield name, value
    elif isinstance(value, float):
        yield name, f'{value:.5g}'
    else:
        numbers = list(value)
        is_flat = all(isinstance(each, (str, float)) for each in numbers)
        if is_flat and numbers:
            yield (
                name,
                ' '.join(each if isinstance(each, str) else f'{each:.5g}' for each in numbers),
            )
        for number, each in enumerate([] if is_flat else numbers):
            yield from fields(each, f'{name}[{number}]')


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


# Topics of which one message is recorded, in the middle of the session: the slave follows.
SOME = {
    'four': (
        'orientation',
        'measured_cp',
        'measured_cv',
        'pose_with_covariance',
        'protection_level',
        'dexterity',
        'joint_states',
        'measured_js',
        'readings',
        'crtk/measured_js',
        'setpoint_cp',
        'servo_cp',
        'slave/measured_cp',
        'delta_twist_cmds',
        'gripper/measured_js',
        'ground_truth/orientation',
        'presence',
        'clutch',
        'enabled_at',
    ),
    'six': ('measured_js', 'protection_level', 'dexterity'),
}
# Entries on /diagnostics that are recorded, by the end of their name; of six what differs.
ENTRIES = {'four': '', 'six': 'fkm: orientation'}
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
        values = [line for topic in SOME[name] for line in rig.values(topic, MIDDLE)]
        lines = [*rig.events(), *values, *rig.entries(MIDDLE, ENTRIES[name]), *rig.counts()]
        assert_recorded(f'sessions/{name}.txt', '\n'.join([*lines, '']))
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
    with device(monkeypatch, *POWERED, *AT_REST, 'teleop.force_scale:=0.5') as rig:
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
        commands, poses = (
            [(*components(q), q.w) for q in (each.pose.orientation for each in host.sent[topic])]
            for topic in ('servo_cp', 'slave/measured_cp')
        )
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
