# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Topics, parameters and services by `ros`, where no `ros2` command line is installed."""

import signal

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from harness import SIM, start_program
import pytest
from sensor_msgs.msg import Joy
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes import ros

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0


def test_a_message_is_shown_as_by_ros2_topic_echo():
    message = DiagnosticArray(status=[DiagnosticStatus(
        level=b'\x01', name='a', values=[KeyValue(key='k', value='v'), KeyValue(key='l')])])
    message.header.stamp.sec = 7
    assert list(ros._lines(message)) == [
        'header:', '  stamp:', '    sec: 7', '    nanosec: 0', '  frame_id: ', 'status:',
        '- level: 1', '  name: a', '  message: ', '  hardware_id: ', '  values:',
        '  - key: k', '    value: v', '  - key: l', '    value: ']
    assert list(ros._lines(Joy(axes=[0.5], buttons=[1, 0])))[5:] == [
        'axes:', '- 0.5', 'buttons:', '- 1', '- 0']


def test_a_field_is_set_by_its_path_or_named():
    message = Joy()
    ros._set_field(message, ['header', 'frame_id'], 'pedal')
    ros._set_field(message, ['buttons'], [1])
    assert (message.header.frame_id, list(message.buttons)) == ('pedal', [1])
    for path, value in ((['header', 'frame'], 'x'), ([], 1), (['buttons'], 'x')):
        with pytest.raises(InputError, match=r'expected a field of \w+, such as data: true'):
            ros._set_field(message, path, value)


@pytest.fixture(scope='module')
def master():
    """Run a simulated master."""
    program = start_program('master', parameters=SIM)
    # A command waits for it no longer than for any node.
    assert wait_until(lambda: 'psi' in program.stdout, PATIENCE), program.stderr
    yield
    program.stop()


@pytest.fixture
def run(capfd):
    """Run a command in this process; return exit code, standard output and error."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def run(command):
        try:
            code = ros.main(['ros', *command.split()])
        except SystemExit as end:
            code = end.code
        return code, *capfd.readouterr()

    yield run
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.process
@pytest.mark.parametrize(('command', 'words'), [
    ('topic echo orientation --once', ['quaternion:', '  w: ', 'frame_id: spm_base', '---']),
    ('topic echo /diagnostics --once', ['status:', '- level: ', '  values:', '  - key: ']),
    ('topic list', ['/state: std_msgs/msg/String', '/measured_js: sensor_msgs/msg/JointState']),
    ('param get fkm alert_limit_deg', ['alert_limit_deg: 1.0']),
    ('param set /diagnostics dexterity_hysteresis 1', ['dexterity_hysteresis: 1']),
    ('service call fkm/acknowledge std_srvs/srv/Trigger',
     ['success: False', 'message: no fault waits']),
])
def test_a_command_prints_what_ros_says(master, run, command, words):
    code, out, err = run(command)
    assert code == 0, err
    for word in words:
        assert word in out


@pytest.mark.process
def test_a_message_is_published_until_a_signal(start, observer):
    arrived = observer.collect(Joy, 'presence')
    program = start('ros', 'topic', 'pub', '/presence', 'sensor_msgs/msg/Joy',
                    '{header: {frame_id: pedal}, buttons: [1]}', '--rate', '20')
    assert observer.spin_until(lambda: len(arrived) >= 3, PATIENCE)
    assert list(arrived[-1][1].buttons) == [1] and arrived[-1][1].header.frame_id == 'pedal'
    assert program.stop() == 0
    assert program.stderr == ''


@pytest.mark.process
@pytest.mark.parametrize(('command', 'reason'), [
    ('topic echo nothing', '/nothing: nobody publishes it'),
    ('param get fkm alert', "fkm has no parameter 'alert'"),
    ('param set fkm alert_limit_deg 99.0', 'alert_limit_deg out of range'),
    ('param get nobody rate', '/nobody/get_parameters: no such node or service'),
    ('param set fkm alert_limit 1.0', 'such as alert_limit_deg'),
    ('param set fkm alert_limit_deg {}', 'alert_limit_deg is {}; expected a single value'),
    ('param set fkm x {"a":1,"b":2}', 'expected a single value or a list'),
    ('param set fkm alert_limit_deg 99999999999999999999', 'at most 64 bits'),
    ('service call nothing', '/nothing: no such service'),
    ('topic', 'required: list | echo | pub'),
    ('topic pub presence sensor_msgs/msg/Joi {}', 'sensor_msgs/msg/Joi: its package is not'),
    ('topic pub presence sensor_msgs/msg/Joy {button:[1]}',
     'button is [1]; expected a field of Joy')])
def test_what_is_not_there_is_named_in_one_line(master, run, monkeypatch, command, reason):
    if reason.startswith('/no'):
        monkeypatch.setattr(ros, 'PATIENCE', 1.0)
    code, _, err = run(command)
    assert code == 1
    assert reason in err and err.count('\n') == 1
