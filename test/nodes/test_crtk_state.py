# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The CRTK face of the device.

Its tests run with classes of the fields of crtk_msgs, that of a client with the installed messages
or those that test/crtk_package.py builds.
"""

import os
import sys
import types

import crtk_package
from fkm_rig import CLEAR, fkm_rig
from harness import SIM, stamp
from in_process import hosted
import pytest
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from spm_haptic_master.nodes.crtk_state import ABSENT, CrtkState
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.supervision.orientation_state import received_state
from std_msgs.msg import Header, String

# Time that a busy machine may need (s); a pause of it is no silence.
PATIENCE = 60.0
PATIENT = {**SIM, 'sample_timeout': 2.0, 'max_age': 2.0, 'rate': 200}
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def stand_in(name):
    """Return a class with the fields of a message of crtk_msgs."""
    def make(**given):
        return types.SimpleNamespace(**{
            field: Header() if kind == 'std_msgs/Header' else '' if kind == 'string' else False
            for kind, field in crtk_package.MESSAGES[name]} | given)
    return make


def make(_):
    """Return a node with nothing but the CRTK face."""
    node = Node('device')
    node.state = CrtkState(node, 'spm_base')
    return node


@pytest.fixture
def device(monkeypatch):
    monkeypatch.setitem(sys.modules, 'crtk_msgs', types.ModuleType('crtk_msgs'))
    monkeypatch.setitem(sys.modules, 'crtk_msgs.msg', types.SimpleNamespace(**{
        name: stand_in(name) for name in crtk_package.MESSAGES}))
    with hosted(make) as host:
        yield host


@pytest.fixture
def without_messages(monkeypatch):
    """Hide crtk_msgs."""
    for name in ('crtk_msgs', 'crtk_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, None)


def texts(device, topic):
    return [message.data for message in device.sent[topic]]


def states(device):
    return [(each.state, each.is_homed) for each in device.sent['operating_state']]


def test_states_and_commands_by_crtk_msgs(device):
    command, state = device.callbacks['state_command'], device.node.state
    assert states(device) == [('DISABLED', False)]
    assert texts(device, 'operating_state_text') == ['DISABLED']
    assert texts(device, 'enabled_at') == [0]
    for words in 'healthy', 'silent: no joint samples', 'healthy':
        state.take(received_state(words))
        device.run(0.01)
        command(types.SimpleNamespace(string='enable'))
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


def test_without_crtk_msgs_one_line_says_so(without_messages, monkeypatch):
    logged = []
    monkeypatch.setattr(
        'spm_haptic_master.ros.node_log.info', lambda _, text: logged.append(text))
    with hosted(make) as device:
        device.node.state.take(received_state('healthy'))
        assert logged == []
        for _ in range(2):
            assert device.call('enable').message == 'ENABLED'
        assert logged == [ABSENT]
        assert 'operating_state' not in device.sent and not device.callbacks


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


@pytest.fixture
def crtk_path(tmp_path):
    """Give the folder for PYTHONPATH from which crtk_msgs comes, and have it here, too."""
    if crtk_package.is_installed():
        yield ''
        return
    if not crtk_package.can_be_built():
        pytest.skip('neither crtk_msgs nor what builds messages of its fields is installed')
    folder = str(crtk_package.build(tmp_path))
    sys.path.insert(0, folder)
    yield folder
    sys.path.remove(folder)
    for name in [name for name in sys.modules if name.split('.')[0] == crtk_package.PACKAGE]:
        del sys.modules[name]


@pytest.mark.process
def test_a_client_lets_go_by_is_homed_alone_and_comes_back(crtk_path, observer, start):
    """By topics, waits and conditions of crtk_python_client and dvrk_teleoperation; its end."""
    from crtk_msgs.msg import OperatingState, StringStamped

    found = [OperatingState()]
    observer.node.create_subscription(
        OperatingState, 'operating_state',
        lambda message: found.append(message) if stamp(message) > stamp(found[-1]) else None, 10)
    out = observer.node.create_publisher(StringStamped, 'state_command', LATCHED)

    def send(command, condition):
        out.publish(StringStamped(string=command))
        return observer.spin_until(lambda: condition(found[-1]), PATIENCE)

    def is_homed(state):
        return state.is_homed

    states = observer.collect(String, 'state', STATE)
    texts = observer.collect(String, 'operating_state_text', STATE)
    master = start(
        'master', parameters=PATIENT,
        PYTHONPATH=os.pathsep.join(filter(None, [crtk_path, os.environ.get('PYTHONPATH')])))
    assert observer.spin_until(lambda: found[-1].state == 'DISABLED', PATIENCE)
    assert observer.spin_until(lambda: states and states[-1][1].data == 'healthy', PATIENCE)
    # Home before enable is no hindrance.
    send('home', lambda _: True)
    observer.spin(0.5)
    assert not found[-1].is_homed
    for command in ('disable', 'pause', 'unhome'):
        assert send('enable', lambda state: state.state == 'ENABLED'), command
        assert send('home', is_homed), command
        # All that dvrk_teleoperation.py 2.4.0 looks at before each of its commands.
        assert send(command, lambda state: not state.is_homed), command
        observer.spin(0.5)
        assert not found[-1].is_homed, command
    assert master.stop() == 0
    assert observer.spin_until(lambda: texts[-1][1].data == 'FAULT', 5.0)
