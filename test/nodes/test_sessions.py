# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
All that a device with a simulated slave publishes, logs and shows in ten seconds, as recorded.

To record a session anew, delete its file in test/data/sessions and run its test.
"""

from contextlib import contextmanager
import sys

from geometry_msgs.msg import PoseStamped
from harness import stamp
from in_process import hosted
import pytest
from rclpy.task import Future
from recorded_text import assert_recorded
from sensor_msgs.msg import Joy
from spm_haptic_master.nodes import master
from spm_haptic_master.nodes.presence import Presence
from spm_haptic_master.nodes.sim_slave import SimSlave
from spm_haptic_master.ros import node_log
from std_msgs.msg import Float64MultiArray, String

# Messages of a topic that are shown (at most), but for texts and diagnostics: those are all shown.
SHOWN = 8


class Console(master.Console):
    """A console without its thread."""

    def __init__(self, *nodes):
        self._coloured = True


class Device:
    """A master, its slave and its pedals in one process, and what they log and show."""

    def __init__(self, host, done, logged):
        self.host, self.done, self.logged, self.shown = host, done, logged, []
        self._console = Console()
        *_, self._console._diagnostics, self.driver, _, _ = host.nodes
        self._console._fkm, self._console._driver = host.node, self.driver

    def run(self, seconds, script):
        """Let the driver work; do what the script has for a time, s, and show a line a second."""
        begin, script = self.host.monotonic(), sorted(script.items())
        read, next_line = self.driver._source.read, begin

        def read_in_time(timeout):
            nonlocal next_line
            self.host.run(0.0)
            now = self.host.monotonic()
            while script and now - begin >= script[0][0]:
                script.pop(0)[1]()
            if now >= next_line:
                next_line += 1.0
                self.shown.append(self._console._line())
            if now - begin > seconds:
                self.driver._stop.set()
            return read(timeout)

        self.driver._source.read = read_in_time
        self.driver._run()
        assert not self.done.done()

    def text(self):
        """Return all that was published, by topic, logged and shown."""
        lines = []
        for topic, messages in sorted(self.host.sent.items()):
            if topic == '/parameter_events':
                continue
            messages = list(messages)
            lines.append(f'{topic}: {len(messages)}')
            is_text = topic == '/diagnostics' or hasattr(messages[0], 'data') and isinstance(
                messages[0].data, str)
            step = 1 if is_text else -(-len(messages) // SHOWN)
            lines += ['  ' + ' '.join(words(message)) for message in messages[::step]]
        return '\n'.join([*lines, 'log:', *self.logged, 'shown:', *self.shown])


def words(value):
    """Yield the fields of a message without stamps, which are of the machine's clock."""
    if hasattr(value, 'get_fields_and_field_types'):
        for name in value.get_fields_and_field_types():
            if name != 'stamp':
                yield from words(getattr(value, name))
    elif isinstance(value, (str, bool, int)):
        yield str(value)
    elif isinstance(value, float):
        yield f'{value:.6g}'
    else:
        for each in value:
            yield from words(each)


@contextmanager
def device(monkeypatch, *settings):
    logged, done = [], Future()
    for level in ('info', 'warning', 'error'):
        monkeypatch.setattr(node_log, level, lambda node, text, level=level: logged.append(
            f'{node.get_name()} {level}: {text}'))
    monkeypatch.setattr(master, 'Console', Console)
    # As recorded: without the messages of packages that may be installed.
    for name in ('crtk_msgs', 'tf2_msgs', 'tf2_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, None)

    def make(parameters):
        nodes = []

        def add(kind, *args):
            nodes.append(kind(parameters, *args))
            return nodes[-1]

        master.compose(done, add)
        return [*nodes, SimSlave(parameters), Presence(parameters)]

    with hosted(make, 'source:=sim', 'rate:=100.0', 'teleop.run:=true', 'crtk_rate:=20.0',
                'sim.noise_deg:=0.02', 'recovery:=0.2', 'presence.clutch_button:=1',
                'presence.joy_timeout:=0.0', 'slave.rate:=50.0', *settings) as host:
        yield Device(host, done, logged)


SETTINGS = {
    'four': ('sim.trajectory:=tour', 'gripper.axis:=0', 'alert_limit_deg:=5.0',
             'mounting.base_zxz_deg:=[30.0, 40.0, -70.0]', 'mounting.table_frame_id:=table',
             'teleop.protection_limit_deg:=4.0'),
    'six': ('sim.trajectory:=sweep', 'sensors:=6', 'gripper.position_deg:=20.0',
            'mounting.handle_zxz_deg:=[0.0, 0.0, 45.0]', 'teleop.alignment:=absolute')}


@pytest.mark.parametrize('name', SETTINGS)
def test_a_session_is_as_recorded(monkeypatch, name):
    with device(monkeypatch, *SETTINGS[name]) as rig:
        host = rig.host

        def give(topic, kind, **fields):
            return lambda: host.give(topic, kind(**fields))

        def fail(text):
            return give('simulation/fault', String, data=text)

        def publish_twice():
            host.publishers['/orientation'] = 'fkm', 'another'

        rig.run(10.0, {
            0.9: lambda: host.call('enable'), 1.0: give('joy', Joy, buttons=[1, 0]),
            1.2: lambda: host.call('~/enable'),
            1.5: give('gripper/joy', Joy, axes=[0.5]) if name == 'four' else lambda: None,
            2.0: give('joy', Joy, buttons=[1, 1]), 2.5: give('joy', Joy, buttons=[1, 0]),
            3.0: fail('offset:joint_1b=4'), 3.6: fail(''), 4.4: lambda: host.call('enable'),
            5.0: fail('dropout:joint_3a'), 5.5: fail(''),
            6.2: lambda: host.call('enable'), 6.6: lambda: host.pause(0.6),
            7.6: publish_twice, 8.0: host.publishers.clear, 8.2: fail('melt:joint_1c'),
            # What cannot be done is logged, and changes nothing.
            8.3: give('simulation/steer', Float64MultiArray, data=[1.0, 0.0, 0.0]),
            8.4: give('simulation/steer', Float64MultiArray, data=[1.0]),
            8.5: give('servo_cp', PoseStamped), 8.55: give('joy', Joy, buttons=[2]),
            8.6: give('simulation/steer', Float64MultiArray, data=[0.1, 0.2, 0.3]),
            9.2: lambda: host.call('disable'), 9.4: give('simulation/steer', Float64MultiArray)})
        assert_recorded(f'sessions/{name}.txt', rig.text())
        # A client ignores what is not newer.
        for topic in ('slave/measured_cp', 'presence', 'orientation', 'ground_truth/orientation'):
            stamps = list(map(stamp, host.sent[topic]))
            assert stamps == sorted(set(stamps))
