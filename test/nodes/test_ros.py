# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Topics, parameters and services by `ros`, where no `ros2` command line is installed."""

import subprocess
import threading

from benchmarks.pipeline.child_process import executable
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import QuaternionStamped
from harness import Observer
from in_process import exit_code
import pytest
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from sensor_msgs.msg import Joy
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes import ros
from spm_haptic_master.ros.qos import SAMPLES
from std_srvs.srv import Trigger


def test_a_message_is_shown_as_by_ros2_topic_echo():
    message = DiagnosticArray(
        status=[
            DiagnosticStatus(
                level=b'\x01', name='a', values=[KeyValue(key='k', value='v'), KeyValue(key='l')]
            )
        ]
    )
    message.header.stamp.sec = 7
    assert list(ros._lines(message)) == [
        'header:',
        '  stamp:',
        '    sec: 7',
        '    nanosec: 0',
        '  frame_id: ',
        'status:',
        '- level: 1',
        '  name: a',
        '  message: ',
        '  hardware_id: ',
        '  values:',
        '  - key: k',
        '    value: v',
        '  - key: l',
        '    value: ',
    ]
    assert list(ros._lines(Joy(axes=[0.5], buttons=[1, 0])))[5:] == [
        'axes:',
        '- 0.5',
        'buttons:',
        '- 1',
        '- 0',
    ]


def test_a_field_is_set_by_its_path_or_named():
    message = Joy()
    ros._set_field(message, ['header', 'frame_id'], 'pedal')
    ros._set_field(message, ['buttons'], [1])
    assert (message.header.frame_id, list(message.buttons)) == ('pedal', [1])
    for path, value in ((['header', 'frame'], 'x'), ([], 1), (['buttons'], 'x')):
        with pytest.raises(InputError, match=r'expected a field of \w+, such as data: true'):
            ros._set_field(message, path, value)


@pytest.fixture(scope='module')
def device():
    """Give an observer whose node `fkm` has a topic, a parameter and a service."""
    device = Observer('fkm')
    ended = threading.Event()
    node = device.node
    message = QuaternionStamped()
    message.header.frame_id = 'spm_base'
    out = node.create_publisher(QuaternionStamped, 'orientation', SAMPLES)
    node.create_timer(0.02, lambda: out.publish(message))
    node.declare_parameter(
        'limit',
        1.0,
        ParameterDescriptor(
            floating_point_range=[FloatingPointRange(from_value=0.5, to_value=9.0)]
        ),
    )
    node.declare_parameter('list', [1, 2])

    def acknowledge(_, answer):
        answer.message = 'no fault waits'
        return answer

    node.create_service(Trigger, 'fkm/acknowledge', acknowledge)
    thread = threading.Thread(target=device.spin_until, args=(ended.is_set, 600.0))
    thread.start()
    yield device
    ended.set()
    thread.join()
    device.close()


@pytest.fixture
def run(capfd):
    """Run a command in this process; return exit code, standard output and error."""
    return lambda command: (exit_code(ros.main, 'ros', *command.split()), *capfd.readouterr())


@pytest.mark.parametrize(
    ('command', 'expected'),
    [
        (
            'topic echo orientation --once',
            """header:
  stamp:
    sec: 0
    nanosec: 0
  frame_id: spm_base
quaternion:
  x: 0.0
  y: 0.0
  z: 0.0
  w: 1.0
---
""",
        ),
        ('topic list', '/orientation: geometry_msgs/msg/QuaternionStamped\n'),
        ('param get fkm limit', 'limit: 1.0\n'),
        ('param set /fkm list [3,4]', 'list: [3, 4]\n'),
        (
            'service call fkm/acknowledge std_srvs/srv/Trigger',
            'success: False\nmessage: no fault waits\n',
        ),
    ],
)
def test_a_command_prints_what_ros_says(device, run, monkeypatch, command, expected):
    if command == 'topic list':
        wait = ros.Commands.wait
        monkeypatch.setattr(
            ros.Commands,
            'wait',
            lambda commands, *_: wait(
                commands, lambda: commands.node.count_publishers('/orientation'), 20.0
            ),
        )
    code, out, err = run(command)
    assert (code, err) == (0, '')
    assert out == expected or (command == 'topic list' and expected in out)


def test_a_message_is_published_until_ctrl_c(device, run, monkeypatch):
    arrived = device.collect(Joy, 'presence')
    wait = ros.Commands.wait

    def wait_or_end(commands, condition, seconds):
        if len(arrived) >= 3:
            raise KeyboardInterrupt
        assert (condition(), seconds) == (False, 1.0 / 20.0)
        return wait(commands, condition, seconds)

    monkeypatch.setattr(ros.Commands, 'wait', wait_or_end)
    assert run(
        'topic pub /presence sensor_msgs/msg/Joy --rate 20 '
        '{"header":{"frame_id":"pedal"},"buttons":[1]}'
    ) == (0, '', '')
    assert list(arrived[-1][1].buttons) == [1]
    assert arrived[-1][1].header.frame_id == 'pedal'


@pytest.mark.parametrize(
    ('command', 'reason'),
    [
        ('topic echo nothing', '/nothing: nobody publishes it'),
        ('param get fkm alert', "fkm has no parameter 'alert'"),
        ('param set fkm limit 99.0', 'limit out of range'),
        ('param get nobody rate', '/nobody/get_parameters: no such node or service within 0.05 s'),
        ('param set fkm limit {}', 'limit is {}; expected a single value'),
        ('param set fkm x {"a":1,"b":2}', 'expected a single value or a list'),
        ('param set fkm limit 99999999999999999999', 'at most 64 bits'),
        ('service call nothing', '/nothing: no such service'),
        ('topic', 'required: list | echo | pub'),
        ('topic pub presence sensor_msgs/msg/Joi {}', 'sensor_msgs/msg/Joi: its package is not'),
        (
            'topic pub presence sensor_msgs/msg/Joy {button:[1]}',
            'button is [1]; expected a field of Joy',
        ),
    ],
)
def test_what_is_not_there_is_named_in_one_line(device, run, monkeypatch, command, reason):
    if ' no' in command:
        monkeypatch.setattr(ros.Commands, 'PATIENCE', 0.05)
    code, _, err = run(command)
    assert code == 1
    assert reason in err
    assert err.count('\n') == 1


@pytest.mark.process
def test_a_reader_that_ends_early_leaves_no_traceback(device):
    """As `ros topic echo orientation | head -1`."""
    command = executable('ros', 'topic', 'echo', 'orientation')
    echo = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert echo.stdout.readline() == 'header:\n'
    echo.stdout.close()
    assert (echo.wait(60.0), echo.stderr.read()) == (0, '')
    echo.stderr.close()
