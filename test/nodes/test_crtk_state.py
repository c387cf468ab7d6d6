# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The CRTK face of the device.

Its tests run with the messages of crtk_msgs where that is installed, and with classes of their
fields everywhere.
"""

from dataclasses import dataclass, field, fields
import sys
import types

import crtk_package
import pytest
import rclpy
from rclpy.node import Node
from spm_haptic_master.nodes.crtk_state import ABSENT, crtk_messages, CrtkState
from spm_haptic_master.supervision.orientation_state import received_state
from std_msgs.msg import Header
from std_srvs.srv import Trigger


@dataclass
class OperatingState:
    header: Header = field(default_factory=Header)
    state: str = ''
    is_homed: bool = False
    is_busy: bool = False


@dataclass
class StringStamped:
    header: Header = field(default_factory=Header)
    string: str = ''


class Recorded:
    """A publisher that keeps what it is given; of a message the fields at that time."""

    def __init__(self):
        self.messages = []

    def publish(self, message):
        self.messages.append(
            (message.state, message.is_homed, message.header.frame_id,
             message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            if hasattr(message, 'is_homed') else message.data)

    def get_subscription_count(self):
        return 0


class RecordingNode(Node):
    """A node that publishes into lists, and takes messages that have no type support."""

    def __init__(self):
        super().__init__('device', context=self.own_context())
        self.out, self.taken, self.served = {}, {}, {}

    @staticmethod
    def own_context():
        context = rclpy.Context()
        rclpy.init(context=context)
        return context

    def create_publisher(self, kind, topic, qos, **more):
        if topic.startswith('/') or 'parameter' in topic:
            return super().create_publisher(kind, topic, qos, **more)
        self.out[topic] = Recorded()
        return self.out[topic]

    def create_subscription(self, kind, topic, callback, qos, **more):
        if topic != 'state_command':
            return super().create_subscription(kind, topic, callback, qos, **more)
        self.taken[topic] = callback
        return None

    def create_service(self, kind, name, callback, **more):
        if kind is Trigger:
            self.served[name] = callback
        return super().create_service(kind, name, callback, **more)


@pytest.fixture
def node():
    node = RecordingNode()
    yield node
    context = node.context
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture(params=['classes of the same fields', 'crtk_msgs'])
def messages(request, monkeypatch):
    """Give OperatingState and StringStamped: the real ones, or classes in their place."""
    if request.param == crtk_package.PACKAGE:
        msg = pytest.importorskip('crtk_msgs.msg')
        return msg.OperatingState, msg.StringStamped
    package, module = types.ModuleType('crtk_msgs'), types.ModuleType('crtk_msgs.msg')
    module.OperatingState, module.StringStamped = OperatingState, StringStamped
    monkeypatch.setitem(sys.modules, 'crtk_msgs', package)
    monkeypatch.setitem(sys.modules, 'crtk_msgs.msg', module)
    return OperatingState, StringStamped


def test_the_messages_have_the_fields_that_are_tested_here(messages):
    for message, stand_in in zip(messages, (OperatingState, StringStamped), strict=True):
        expected = crtk_package.MESSAGES[stand_in.__name__]
        assert [each.name for each in fields(stand_in)] == [name for _, name in expected]
        if message is not stand_in:
            found = message.get_fields_and_field_types()
            assert [(kind, name) for name, kind in found.items()] == list(expected)


def states(node):
    return [message[:2] for message in node.out['operating_state'].messages]


def test_states_and_commands_by_crtk_msgs(node, messages):
    _, command_type = messages
    state = CrtkState(node, 'spm_base')
    command = node.taken['state_command']
    state.take(received_state('healthy'))
    command(command_type(string='enable'))
    state.take(received_state('silent: no joint samples'))
    command(command_type(string='enable'))
    state.take(received_state('healthy'))
    command(command_type(string='enable'))
    assert states(node) == [
        ('DISABLED', False), ('ENABLED', True), ('FAULT', False), ('DISABLED', False),
        ('ENABLED', True)]
    published = node.out['operating_state'].messages
    assert {frame for _, _, frame, _ in published} == {'spm_base'}
    # A client ignores a state that is not newer than the last.
    stamps = [stamp for *_, stamp in published]
    assert stamps == sorted(set(stamps))
    assert node.out['error'].messages == ['silent: no joint samples']
    (refused,) = node.out['warning'].messages
    assert refused == "state_command 'enable': the orientation is silent: no joint samples"
    assert node.out['status'].messages == [
        'healthy', 'ENABLED', 'FAULT', 'healthy', 'DISABLED', 'ENABLED']


def test_the_same_by_standard_types(node, messages):
    state = CrtkState(node, 'spm_base')
    state.take(received_state('healthy'))
    assert state.command('enable') == (True, 'ENABLED')
    first = node.out['enabled_at'].messages[-1]
    assert state.command('enable') == (True, 'ENABLED')
    # An enable of an enabled device is a fresh one.
    assert node.out['enabled_at'].messages[-1] > first > 0
    state.take(received_state('silent: x'))
    assert node.out['enabled_at'].messages[-1] == 0
    assert node.out['operating_state_text'].messages == ['DISABLED', 'ENABLED', 'FAULT']
    accepted, why = state.command('enable')
    assert not accepted and 'the orientation is silent: x' in why


def test_words_that_are_no_state_are_a_fault(node, messages):
    """Whatever they begin with: nobody knows what they say of the orientation."""
    state = CrtkState(node, 'spm_base')
    state.take(received_state('healthy'))
    state.command('enable')
    state.take(received_state('healthy again'))
    assert states(node)[-1] == ('FAULT', False)
    assert node.out['error'].messages == ["silent: unknown state 'healthy again'"]


def test_its_end_is_a_fault(node, messages):
    state = CrtkState(node, 'spm_base')
    state.take(received_state('healthy'))
    state.command('enable')
    state.end()
    assert states(node)[-1] == ('FAULT', False)
    assert node.out['enabled_at'].messages[-1] == 0
    assert node.out['error'].messages == ['silent: fkm has ended']


def test_without_crtk_msgs_one_line_says_so(node, monkeypatch):
    for name in ('crtk_msgs', 'crtk_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, None)
    logged = []
    monkeypatch.setattr(
        'spm_haptic_master.ros.node_log.info', lambda _, text: logged.append(text))
    assert crtk_messages() is None
    state = CrtkState(node, 'spm_base')
    state.take(received_state('healthy'))
    assert logged == []
    for _ in range(2):
        node.served['enable'](Trigger.Request(), Trigger.Response())
    assert logged == [ABSENT]
    assert 'operating_state' not in node.out and 'state_command' not in node.taken
    assert state.command('enable') == (True, 'ENABLED')
