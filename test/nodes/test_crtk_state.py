# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The CRTK face of the device, with classes of the fields of crtk_msgs, and without."""

from dataclasses import dataclass, field
import sys
import time
import types

from fkm_rig import CLEAR, fkm_rig
from harness import stamp
from in_process import hosted, ros
import pytest
from rclpy.node import Node
from spm_haptic_master.nodes.crtk_state import CrtkState
from spm_haptic_master.nodes.state_commands import StateCommands
from spm_haptic_master.ros.qos import EVENTS, STATE
from spm_haptic_master.supervision.orientation_state import received_state
from std_msgs.msg import Header, String


@dataclass(slots=True)
class OperatingState:
    header: Header = field(default_factory=Header)
    state: str = ''
    is_homed: bool = False
    is_busy: bool = True


@dataclass(slots=True)
class StringStamped:
    header: Header = field(default_factory=Header)
    string: str = ''


def make(_):
    """Return a node with nothing but the CRTK face."""
    node = Node('device')
    node.state = CrtkState(node, 'spm_base')
    return node


@pytest.fixture
def device(monkeypatch):
    monkeypatch.setitem(sys.modules, 'crtk_msgs', types.ModuleType('crtk_msgs'))
    monkeypatch.setitem(
        sys.modules,
        'crtk_msgs.msg',
        types.SimpleNamespace(OperatingState=OperatingState, StringStamped=StringStamped),
    )
    with hosted(make) as host:
        yield host


@pytest.fixture
def without_messages(monkeypatch):
    """Hide crtk_msgs."""
    for name in ('crtk_msgs', 'crtk_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, None)


def command(device, text, age=0.0, subscriptions=slice(None)):
    """Publish a command: a latched one reaches the latched subscription (1) and the other (0)."""
    published = device.time_ns() - round(1e9 * age)
    for queue in device.queues['/state_command'][subscriptions]:
        queue.append((StringStamped(string=text), published))
    device.run(0.02)


def texts(device, topic):
    return [message.data for message in device.sent[topic]]


def states(device):
    return [(each.state, each.is_homed) for each in device.sent['operating_state']]


def test_states_and_commands_by_crtk_msgs(device):
    state = device.node.state
    assert states(device) == [('DISABLED', False)]
    assert texts(device, 'operating_state_text') == ['DISABLED']
    assert texts(device, 'enabled_at') == [0]
    for words in 'healthy', 'silent: no joint samples', 'healthy':
        state.take(received_state(words))
        device.run(0.01)
        command(device, 'enable')
    assert states(device) == [
        ('DISABLED', False),
        ('ENABLED', True),
        ('FAULT', False),
        ('DISABLED', False),
        ('ENABLED', True),
    ]
    published = device.sent['operating_state']
    assert {(each.header.frame_id, each.is_busy) for each in published} == {('spm_base', False)}
    # A client ignores a state that is not newer than the last.
    stamps = [stamp(each) for each in published]
    assert stamps == sorted(set(stamps))
    assert texts(device, 'error') == ['silent: no joint samples']
    assert texts(device, 'warning') == [
        "state_command 'enable': the orientation is silent: no joint samples"
    ]
    assert texts(device, 'status') == [
        'healthy',
        'ENABLED',
        'FAULT',
        'healthy',
        'DISABLED',
        'ENABLED',
    ]
    # It is repeated for subscribers that come later.
    device.run(1.0)
    assert states(device)[5:] == [('ENABLED', True)] * 10


@pytest.mark.parametrize(
    ('end', 'error'),
    [
        (lambda state: state.end(), 'silent: fkm has ended'),
        # Whatever they begin with: nobody knows what they say of the orientation.
        (
            lambda state: state.take(received_state('healthy again')),
            "silent: unknown state 'healthy again'",
        ),
    ],
)
def test_its_end_and_words_that_are_no_state_are_a_fault(device, end, error):
    state = device.node.state
    state.take(received_state('healthy'))
    state.command('enable')
    device.subscribed = lambda topic: False
    end(state)
    assert states(device)[-1] == ('FAULT', False)
    assert texts(device, 'enabled_at')[-1] == 0
    assert texts(device, 'error') == [error]


def test_silence_is_a_fault_until_enable_without_crtk_msgs(without_messages):
    with fkm_rig('recovery:=0.2') as rig:

        def called(name):
            answer = rig.host.call(name)
            return answer.success, answer.message

        def state():
            return rig.host.last('operating_state_text').data, rig.host.last('enabled_at').data

        rig.send_many(100, CLEAR)
        assert called('enable') == (True, 'ENABLED')
        name, first = state()
        assert name == 'ENABLED'
        assert first > 0
        rig.host.run(0.5)
        assert state() == ('FAULT', 0)
        assert rig.host.last('error').data == 'silent: no joint samples'
        success, message = called('enable')
        assert not success
        assert 'silent: no joint samples' in message
        rig.send_many(100, CLEAR)
        assert state() == ('DISABLED', 0)
        assert called('enable') == (True, 'ENABLED')
        assert state()[1] > first
        assert called('disable') == (True, 'DISABLED')
    assert state() == ('FAULT', 0)
    assert rig.host.last('error').data == 'silent: fkm has ended'


def test_k10_one_latched_enable_counts_once_and_an_old_one_not(device):
    """A CRTK client latches it at its start, before its subscriber was found, or for hours."""
    device.node.state.take(received_state('healthy'))
    command(device, 'enable', age=3600.0, subscriptions=slice(1, 2))
    assert states(device)[-1] == ('DISABLED', False)
    command(device, 'enable', age=0.5, subscriptions=slice(1, 2))
    assert states(device)[-1] == ('ENABLED', True)
    command(device, 'pause')
    command(device, 'resume')
    # Twice would be a warning: the state is ENABLED already.
    assert states(device)[-1] == ('ENABLED', True)
    assert texts(device, 'warning') == []
    # From clients that do not latch.
    command(device, 'disable', subscriptions=slice(0, 1))
    assert states(device)[-1] == ('DISABLED', False)


@pytest.mark.parametrize('latches', [True, False])
def test_k10_a_client_that_was_there_first_is_heard(latches):
    """By real publishers: one that latches its only command, and one that repeats it."""
    heard = []
    with ros():
        client = Node('client')
        out = client.create_publisher(String, 'state_command', STATE if latches else EVENTS)
        out.publish(String(data='enable'))
        device = Node('device')
        commands = StateCommands(device, String, lambda message: message.data, heard.append)
        deadline = time.monotonic() + 10.0
        while not heard and time.monotonic() < deadline:
            if not latches:
                out.publish(String(data='enable'))
            time.sleep(0.05)
            commands.poll()
        commands.close()
        device.destroy_node()
        client.destroy_node()
    assert heard == ['enable']


@pytest.mark.parametrize(
    ('commands', 'is_homed'),
    [
        (('enable', 'home'), True),
        # As `home()` of a client does first: it waits for `is_homed`, and returns False.
        (('home',), False),
        (('home', 'enable'), True),
    ],
)
def test_k9_a_client_enables_and_then_homes(device, commands, is_homed):
    device.node.state.take(received_state('healthy'))
    for text in commands:
        command(device, text)
    assert states(device)[-1] == (('ENABLED', True) if is_homed else ('DISABLED', False))
    if commands == ('home',):
        assert texts(device, 'status')[-1] == 'homed once enabled: expected enable'
