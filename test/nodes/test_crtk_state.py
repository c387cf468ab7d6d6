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

from fkm_rig import CLEAR, fkm_rig
from harness import SIM, stamp
from in_process import hosted
import pytest
from rclpy.node import Node
from spm_haptic_master.nodes.crtk_state import ABSENT, crtk_messages, CrtkState
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.supervision.orientation_state import received_state
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

# Time that a busy machine may need (s); a pause of it is no silence.
PATIENCE = 60.0
PATIENT = {**SIM, 'sample_timeout': 2.0, 'max_age': 2.0, 'rate': 200}


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


def make(_):
    """Return a node with nothing but the CRTK face."""
    node = Node('device')
    node.state = CrtkState(node, 'spm_base')
    return node


@pytest.fixture
def device(messages):
    with hosted(make) as host:
        yield host


def texts(device, topic):
    return [message.data for message in device.sent[topic]]


@pytest.fixture(params=['classes of the same fields', 'crtk_msgs'])
def messages(request, monkeypatch):
    """Give OperatingState and StringStamped: the real ones, or classes in their place."""
    if request.param == 'crtk_msgs':
        msg = pytest.importorskip('crtk_msgs.msg')
        return msg.OperatingState, msg.StringStamped
    package, module = types.ModuleType('crtk_msgs'), types.ModuleType('crtk_msgs.msg')
    module.OperatingState, module.StringStamped = OperatingState, StringStamped
    monkeypatch.setitem(sys.modules, 'crtk_msgs', package)
    monkeypatch.setitem(sys.modules, 'crtk_msgs.msg', module)
    return OperatingState, StringStamped


def test_the_messages_have_the_fields_that_are_tested_here(messages):
    for message, stand_in in zip(messages, (OperatingState, StringStamped), strict=True):
        if message is not stand_in:
            assert [*message.get_fields_and_field_types()] == [
                each.name for each in fields(stand_in)]


def states(device):
    return [(each.state, each.is_homed) for each in device.sent['operating_state']]


def test_states_and_commands_by_crtk_msgs(device, messages):
    _, command_type = messages
    command, state = device.callbacks['state_command'], device.node.state
    assert states(device) == [('DISABLED', False)]
    assert texts(device, 'operating_state_text') == ['DISABLED']
    assert texts(device, 'enabled_at') == [0]
    for words in 'healthy', 'silent: no joint samples', 'healthy':
        state.take(received_state(words))
        device.run(0.01)
        command(command_type(string='enable'))
        device.run(0.01)
    assert states(device) == [
        ('DISABLED', False), ('ENABLED', True), ('FAULT', False), ('DISABLED', False),
        ('ENABLED', True)]
    published = device.sent['operating_state']
    assert {each.header.frame_id for each in published} == {'spm_base'}
    # A client ignores a state that is not newer than the last.
    stamps = [stamp(each) for each in published]
    assert stamps == sorted(set(stamps))
    assert texts(device, 'error') == ['silent: no joint samples']
    assert texts(device, 'warning') == [
        "state_command 'enable': the orientation is silent: no joint samples"]
    assert texts(device, 'status') == [
        'healthy', 'ENABLED', 'FAULT', 'healthy', 'DISABLED', 'ENABLED']
    # It is repeated for subscribers that come later.
    device.run(1.0)
    assert states(device)[5:] == [('ENABLED', True)] * 10


def test_a_client_lets_go_by_is_homed_alone_and_comes_back(device, messages):
    """All that dvrk_teleoperation.py 2.4.0 looks at before each of its commands."""
    def send(text):
        device.callbacks['state_command'](messages[1](string=text))
        device.run(0.01)
        return states(device)[-1]

    device.node.state.take(received_state('healthy'))
    # Home before enable is no hindrance.
    assert not send('home')[1]
    for command in ('disable', 'pause', 'unhome'):
        assert send('enable')[0] == 'ENABLED', command
        assert send('home')[1], command
        assert not send(command)[1], command


def test_words_that_are_no_state_are_a_fault(device):
    """Whatever they begin with: nobody knows what they say of the orientation."""
    state = device.node.state
    state.take(received_state('healthy'))
    state.command('enable')
    state.take(received_state('healthy again'))
    assert states(device)[-1] == ('FAULT', False)
    assert texts(device, 'error') == ["silent: unknown state 'healthy again'"]


def test_its_end_is_a_fault(device):
    state = device.node.state
    state.take(received_state('healthy'))
    state.command('enable')
    device.subscribed = lambda topic: False
    state.end()
    assert states(device)[-1] == ('FAULT', False)
    assert texts(device, 'enabled_at')[-1] == 0
    assert texts(device, 'error') == ['silent: fkm has ended']


def test_without_crtk_msgs_one_line_says_so(monkeypatch):
    for name in ('crtk_msgs', 'crtk_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, None)
    logged = []
    monkeypatch.setattr(
        'spm_haptic_master.ros.node_log.info', lambda _, text: logged.append(text))
    assert crtk_messages() is None
    with hosted(make) as device:
        device.node.state.take(received_state('healthy'))
        assert logged == []
        for _ in range(2):
            assert device.call('enable').message == 'ENABLED'
        assert logged == [ABSENT]
        assert 'operating_state' not in device.sent and not device.callbacks


def test_silence_is_a_fault_until_enable_without_crtk_msgs(monkeypatch):
    for name in ('crtk_msgs', 'crtk_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, None)
    with fkm_rig('recovery:=0.2') as rig:
        def called(name):
            answer = rig.host.call(name)
            return answer.success, answer.message

        def state():
            return rig.host.last('operating_state_text').data, rig.host.last('enabled_at').data

        rig.send_many(100, CLEAR)
        assert called('enable') == (True, 'ENABLED')
        name, first = state()
        assert name == 'ENABLED' and first > 0
        rig.host.run(0.5)
        assert state() == ('FAULT', 0)
        assert rig.host.last('error').data == 'silent: no joint samples'
        success, message = called('enable')
        assert not success and 'silent: no joint samples' in message
        rig.send_many(100, CLEAR)
        assert state() == ('DISABLED', 0)
        assert called('enable') == (True, 'ENABLED') and state()[1] > first
        assert called('disable') == (True, 'DISABLED')


@pytest.mark.process
def test_a_controller_hears_of_an_orderly_end(start, observer):
    texts = observer.collect(String, 'operating_state_text', STATE)
    states = observer.collect(String, 'state', STATE)
    master = start('master', parameters=PATIENT)
    assert observer.spin_until(lambda: states and states[-1][1].data == 'healthy', PATIENCE)
    enable = observer.node.create_client(Trigger, 'enable')
    assert enable.wait_for_service(PATIENCE)
    enable.call_async(Trigger.Request())
    assert observer.spin_until(lambda: texts and texts[-1][1].data == 'ENABLED', PATIENCE)
    assert master.stop() == 0
    assert observer.spin_until(lambda: texts[-1][1].data == 'FAULT', 5.0)
