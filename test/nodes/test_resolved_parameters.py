# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What was given is what the running node has, by its own services, however it is started."""

from contextlib import suppress
import os
from pathlib import Path
import random
import signal

from harness import Observer, start_program
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
import rclpy
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future
from spm_haptic_master.benchmark.child_process import private_environment, wait_until
from spm_haptic_master.executables import PIPELINE
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.nodes.teleop import Teleop
from spm_haptic_master.parameters.arguments import node_command_line

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# Values of parameters of each type, as they are written, and as the node has them.
VALUES = {
    'fkm': {
        'alert_limit_deg': {'5': 5.0, '1.5': 1.5, '2e0': 2.0}, 'start_checked': {
            'true': True, 'no': False}, 'frozen_samples': {'7': 7, '0x10': 16},
        'solver': {'classic': 'classic', "'theta3a'": 'theta3a'},
        'frame_id': {"'2'": '2', 'spm': 'spm'}, 'geometry.alpha_deg': {'39': 39.0, '39.1': 39.1},
        'sigma_deg': {'[1, 2, 3, 4]': [1.0, 2.0, 3.0, 4.0], '[0.1, 0.2, 0.3, 0.4]': [
            0.1, 0.2, 0.3, 0.4]}, 'working_mode': {'[1, 1, 1]': [1, 1, 1]},
        'gripper.range_deg': {'[0.0, 5.0]': [0.0, 5.0], '[1, 2]': [1.0, 2.0]}},
    'encoder_driver': {
        'sim.trajectory': {'sweep': 'sweep', 'hand': 'hand'}, 'sim.seed': {'1': 1, '99': 99},
        'sim.noise_deg': {'0': 0.0, '0.1': 0.1}, 'measured_js.frame_id': {'a': 'a', 'b': 'b'},
        'sim.tolerance_deg': {'[0.1, 0.2]': [0.1, 0.2], '[1, 2]': [1.0, 2.0]}},
    'diagnostics': {
        'dexterity_rate': {'10': 10.0, '20.0': 20.0}, 'dexterity_warn': {'0.1': 0.1, '1': 1.0},
        'mounting.base_zxz_deg': {'[1, 2, 3]': [1.0, 2.0, 3.0], '[0.0, 0.5, 0.0]': [
            0.0, 0.5, 0.0]}},
    'teleop': {
        'teleop.alignment': {'absolute': 'absolute', 'relative': 'relative'},
        'teleop.command_rate': {'0': 0.0, '100.0': 100.0},
        'teleop.frame_id': {"''": '', 'x': 'x'}},
}
MAKE = {'fkm': Fkm, 'encoder_driver': lambda given: EncoderDriver(given, Future()),
        'diagnostics': Diagnostics, 'teleop': Teleop}


def file_text(rng, node, values):
    """Return a parameter file with the values, dotted or nested, in one section or two."""
    lines = {'/**': [], f'/**/{node}': []}
    for name, text in values.items():
        section = rng.choice(list(lines))
        group, dot, last = name.partition('.')
        # A group stands once in a section: the second name of it is dotted.
        nested = dot and not any(line.startswith(f'    {group}') for line in lines[section])
        lines[section].append(f'    {group}:\n      {last}: {text}' if nested and rng.random() < .5
                              else f'    {name}: {text}')
    return '\n'.join(line for name, section in lines.items() if section
                     for line in (f'{name}:', '  ros__parameters:', *section)) + '\n'


@pytest.mark.parametrize('node', list(VALUES))
def test_fifty_random_combinations_of_two_files_and_arguments(tmp_path, node):
    rng = random.Random(node)
    rclpy.init(args=[], domain_id=int(private_environment()['ROS_DOMAIN_ID']))
    try:
        for _ in range(50):
            required = ['-p', 'source:=sim'] if node == 'encoder_driver' else []
            args, expected = list(required), {}
            for number in range(3):
                chosen = {name: rng.choice(list(values)) for name, values
                          in VALUES[node].items() if rng.random() < 0.6}
                if number < 2 and chosen:
                    path = tmp_path / f'{number}.yaml'
                    path.write_text(file_text(rng, node, chosen))
                    args += ['--params-file', str(path)]
                elif number == 2:
                    # Their place on the command line does not matter.
                    args = [*(word for name, text in chosen.items()
                              for word in ('-p', f'{name}:={text}')), *args]
                expected |= {name: VALUES[node][name][text] for name, text in chosen.items()}
            _, given = node_command_line(node, '', [node], ['program', *args])
            made = MAKE[node](given)
            got = {name: made.get_parameter(name).value for name in expected}
            made.destroy_node()
            assert {name: list(value) if isinstance(expected[name], list) else value
                    for name, value in got.items()} == expected, args
    finally:
        rclpy.try_shutdown()


class Client:
    """Asks the parameter services of a node."""

    def __init__(self, name):
        self.name = name
        self.observer = Observer()

    def call(self, kind, service, **fields):
        client = self.observer.node.create_client(kind, f'{self.name}/{service}')
        assert self.observer.spin_until(client.service_is_ready, PATIENCE)
        answer = client.call_async(kind.Request(**fields))
        assert self.observer.spin_until(answer.done, PATIENCE)
        return answer.result()

    def get(self, *names):
        values = self.call(GetParameters, 'get_parameters', names=names).values
        return [parameter_value_to_python(value) for value in values]

    def set_value(self, name, value):
        (result,) = self.send(Parameter(name, value=value).to_parameter_msg())
        return result

    def send(self, *messages):
        return self.call(SetParameters, 'set_parameters', parameters=messages).results

    def send_atomically(self, *messages):
        return self.call(SetParametersAtomically, 'set_parameters_atomically',
                         parameters=messages).result


def test_an_argument_wins_over_rig_and_calibration_files(start, tmp_path):
    """With the files that rcl gave the second file's value, whatever the argument."""
    rig, calibration = tmp_path / 'rig.yaml', tmp_path / 'calibration.yaml'
    rig.write_text('/**/encoder_driver:\n  ros__parameters:\n    source: can\n    can:\n'
                   '      interface: udp_multicast\n      channel: 239.74.0.1\n')
    calibration.write_text(
        '/**:\n  ros__parameters:\n    can: {channel: 239.74.0.1}\n    encoders:\n'
        '      zero_count: [1, 2, 3, 4]\n      direction_verified: [true, true, true, true]\n')
    start('encoder_driver', '--ros-args', '--params-file', str(rig), '--params-file',
          str(calibration), '-p', 'can.channel:=239.74.0.0', '-p',
          'encoders.zero_count:=[5, 6, 7, 8]')
    client = Client('/encoder_driver')
    assert client.get('can.channel', 'can.interface') == ['239.74.0.0', 'udp_multicast']
    assert list(client.get('encoders.zero_count')[0]) == [5, 6, 7, 8]
    client.observer.close()


def test_as_ros2_launch_starts_it_in_a_namespace_under_another_name(start, tmp_path):
    """Launch remaps the name first, and writes parameters into files of its own, in order."""
    first, second = tmp_path / 'launch_params_a', tmp_path / 'launch_params_b'
    first.write_text('/**:\n  ros__parameters:\n    alert_limit_deg: 5\n'
                     '    geometry.alpha_deg: 39.1\n    use_sim_time: true\n')
    second.write_text('/left/forward:\n  ros__parameters:\n    geometry.alpha_deg: 39.2\n')
    start('fkm', '--ros-args', '-r', '__node:=forward', '-r', '__ns:=/left', '--params-file',
          str(first), '--params-file', str(second), '-p', 'alert_limit_deg:=1.5')
    client = Client('/left/forward')
    assert client.get('alert_limit_deg', 'geometry.alpha_deg', 'use_sim_time') == [
        1.5, 39.2, True]
    # Live: a value in range changes, all else is refused by name.
    assert client.set_value('alert_limit_deg', 2.0).successful
    assert client.get('alert_limit_deg') == [2.0]
    assert client.set_value('alert_limit_deg', 3).successful
    assert client.get('alert_limit_deg') == [3.0]
    assert 'alert_limit_deg out of range' in client.set_value('alert_limit_deg', 99.0).reason
    reason = client.set_value('alert_limit', 2.0).reason
    assert "'alert_limit' is 2.0; expected a parameter of this node, such as alert_limit_deg" \
        in reason
    assert '\n' not in client.set_value('alert\nlimit', 2.0).reason
    assert 'read-only' in client.set_value('window', 0.1).reason
    client.observer.close()


@pytest.fixture(scope='module')
def master():
    program = start_program('master', parameters={'source': 'sim'})
    yield program
    assert program.stop() == 0


@pytest.fixture
def client(master):
    """Make clients of the nodes of a running master."""
    made = []

    def client(node):
        made.append(Client(f'/{node}'))
        return made[-1]

    yield client
    for each in made:
        each.observer.close()
    assert master.poll() is None, master.stderr


@pytest.mark.parametrize('node', PIPELINE)
def test_every_parameter_is_described_and_only_some_may_change(client, node):
    asked = client(node)
    names = [name for name in asked.call(ListParameters, 'list_parameters').result.names
             if name not in ('use_sim_time', 'start_type_description_service')]
    assert len(names) > 5
    for descriptor in asked.call(
            DescribeParameters, 'describe_parameters', names=names).descriptors:
        assert len(descriptor.description) > 5, descriptor.name
        assert (descriptor.floating_point_range or descriptor.integer_range
                or descriptor.additional_constraints), descriptor.name
        assert descriptor.read_only == (descriptor.name not in (
            'dexterity_warn', 'dexterity_error', 'dexterity_hysteresis',
            'alert_limit_deg')), descriptor.name
    name, value = {'encoder_driver': ('source', 'can'), 'fkm': ('solver', 'classic'),
                   'diagnostics': ('working_mode', [1, 1, -1])}[node]
    assert 'read-only' in asked.set_value(name, value).reason


def test_a_live_value_that_contradicts_another_one_is_refused(client):
    diagnostics = client('diagnostics')
    assert diagnostics.set_value('dexterity_warn', 0.2).successful
    assert "'dexterity_error' is 0.3" in diagnostics.set_value('dexterity_error', 0.3).reason
    assert not diagnostics.set_value('dexterity_warn', -1.0).successful


def of_type(number, name):
    """Return a message that sets a parameter to a value of a type, by its number."""
    return ParameterMessage(name=name, value=ParameterValue(type=number))


def test_a_message_without_a_valid_type_is_refused_and_master_runs_on(client):
    """Such a message ended the process with a traceback, whoever on the graph sent it."""
    driver = client('encoder_driver')
    before = driver.get('rate', 'use_sim_time')
    for name in ('rate', 'use_sim_time', 'no_such_name', ''):
        unset = of_type(ParameterType.PARAMETER_NOT_SET, name)
        assert not driver.send(unset)[0].successful
        assert not driver.send_atomically(unset).successful
        for number in (10, 42, 255):
            wrong = of_type(number, name)
            (result,) = driver.send(wrong)
            assert not result.successful, (number, result)
            assert repr(name) in result.reason and len(result.reason.splitlines()) == 1, result
            assert not driver.send_atomically(wrong).successful
    assert driver.get('rate', 'use_sim_time') == before


def test_a_message_without_a_valid_type_spoils_only_what_it_has_to(client):
    """`set_parameters` sets one after the other, `set_parameters_atomically` all or none."""
    fkm = client('fkm')
    wrong, right = of_type(42, 'frozen_samples'), Parameter(
        'alert_limit_deg', value=2.0).to_parameter_msg()
    before = fkm.get('alert_limit_deg')
    result = fkm.send_atomically(right, wrong)
    assert not result.successful
    assert "'frozen_samples' is of type 42; expected" in result.reason
    assert fkm.get('alert_limit_deg') == before
    assert [each.successful for each in fkm.send(wrong, right, wrong)] == [False, True, False]
    assert fkm.get('alert_limit_deg') == [2.0]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_reading_of_a_file(tmp_path, number):
    """A pipe that nobody writes to: the process ended by a time-out, with a dump."""
    path = tmp_path / 'pipe'
    os.mkfifo(path)
    program = start_program('fkm', '--params-file', str(path))
    writing = []

    def opened():
        with suppress(OSError):  # until the program reads
            writing.append(os.open(path, os.O_WRONLY | os.O_NONBLOCK))
        return writing

    assert wait_until(opened, PATIENCE)
    # Where the kernel does not report it, the file has been opened for some time.
    waits = Path(f'/proc/{program.pid}/wchan')
    wait_until(lambda: 'pipe' in waits.read_text(), 2.0)
    program.send_signal(number)
    assert program.wait(PATIENCE) == 0
    os.close(writing[0])
    assert program.stderr == ''
