# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A wrong parameter ends the node at its start, in one line that says what is allowed."""

import json

from harness import Observer, SIM, start_command, start_program
import pytest
from rcl_interfaces.srv import DescribeParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter
from spm_haptic_master.benchmark.child_process import executable
from spm_haptic_master.executables import PIPELINE
from spm_haptic_master.parameters.files import simulated_rig

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
REPLAY = {'source': 'replay', **simulated_rig()}
CAN = {'source': 'can', 'can.interface': 'udp_multicast', 'can.channel': '239.74.0.0',
       **simulated_rig()}


# Values of the wrong kind or out of range; all else that is refused is in refusals.py.
REFUSED = [
    ('encoder_driver', {'source': 'serial'}, ["'source'", "'serial'", 'can, replay, sim']),
    ('encoder_driver', {'source': 7}, ["'source'", '7', 'can, replay, sim']),
    ('encoder_driver', {**SIM, 'rate': 0}, ["'rate'", '0', 'from 1 to 10000']),
    ('encoder_driver', {**SIM, 'rate': '.nan'}, ["'rate'", 'nan', 'a number']),
    ('encoder_driver', {**SIM, 'rate': 'fast'}, ["'rate'", "'fast'", 'a number']),
    ('encoder_driver', {**SIM, 'sim.trajectory': 'figure8'},
     ["'sim.trajectory'", 'fig9, perturbed, sweep, hand, tour, fixed']),
    ('encoder_driver', {**SIM, 'sim.pose_deg': [0.0, 1.0]}, ["'sim.pose_deg'", 'a list of 3']),
    ('encoder_driver', {**REPLAY, 'replay.rate': 0}, ["'replay.rate'", '0', 'from 0.01']),
    ('encoder_driver', {**CAN, 'encoders.counts_per_turn': [16384, 0, 16384, 16384]},
     ["'encoders.counts_per_turn'", '0', 'of 4']),
    ('encoder_driver', {**CAN, 'encoders.id': [385, 386, 387]},
     ["'encoders.id'", 'a list of 4']),
    ('fkm', {'solver': 'newton'}, ["'solver'", 'newton', 'estimate, theta3a, classic']),
    ('fkm', {'geometry.alpha_deg': 0.0}, ["'geometry.alpha_deg'", '0.0']),
    ('fkm', {'max_age': 0.0}, ["'max_age'", '0.0']),
    ('fkm', {'sigma_deg': [0.04, 0.04, 0.0, 0.04]}, ["'sigma_deg'", '0.0']),
    ('diagnostics', {'dexterity_rate': 0.0}, ["'dexterity_rate'", '0.0']),
    ('diagnostics', {'working_mode': [1, 1, 2]}, ["'working_mode'", '2', '1, -1']),
    ('master', {'source': 'serial'}, ["'source'", "'serial'"]),
]
# Runs one executable after the other and prints the exit code and stderr of each.
ONE_AFTER_THE_OTHER = """
import importlib, json, os, sys, tempfile
from spm_haptic_master.executables import EXECUTABLES
kept = os.dup(2)
for name, *arguments in json.loads(sys.argv[1]):
    main = importlib.import_module(f'spm_haptic_master.{EXECUTABLES[name][0]}').main
    with tempfile.TemporaryFile('w+') as stderr:
        os.dup2(stderr.fileno(), 2)
        code = main([name, *arguments])
        sys.stderr.flush()
        os.dup2(kept, 2)
        stderr.seek(0)
        print(json.dumps([code, stderr.read()]), flush=True)
"""


@pytest.fixture(scope='module')
def refusals():
    """Exit code and stderr of every node of REFUSED; one process, because rclpy loads slowly."""
    interpreter, module = executable('')[0], 3
    commands = [executable(node, parameters=parameters)[module:]
                for node, parameters, _ in REFUSED]
    program = start_command([interpreter, '-c', ONE_AFTER_THE_OTHER, json.dumps(commands)])
    assert program.wait(2.0 * PATIENCE) == 0, program.stderr
    assert program.stderr == ''
    return [json.loads(line) for line in program.stdout.splitlines()]


@pytest.mark.parametrize('index', range(len(REFUSED)), ids=[
    f'{node}-{list(parameters)[-1]}' for node, parameters, _ in REFUSED])
def test_wrong_value_ends_the_node(refusals, index):
    node, _, words = REFUSED[index]
    code, stderr = refusals[index]
    assert code == 1
    lines = stderr.splitlines()
    assert len(lines) == 1, stderr
    assert lines[0].startswith(f'{node}: parameter ')
    for word in words:
        assert word in lines[0]


class Caller:
    """Asks a node's parameter services."""

    def __init__(self, node):
        self.node = node
        self.observer = Observer()

    def call(self, kind, service, **fields):
        client = self.observer.node.create_client(kind, f'/{self.node}/{service}')
        assert self.observer.spin_until(client.service_is_ready, PATIENCE)
        answer = client.call_async(kind.Request(**fields))
        assert self.observer.spin_until(answer.done, PATIENCE)
        return answer.result()

    def set_value(self, name, value):
        (result,) = self.call(SetParameters, 'set_parameters', parameters=[
            Parameter(name, value=value).to_parameter_msg()]).results
        return result


@pytest.fixture(scope='module', params=PIPELINE)
def caller(request):
    """Return a running node and a client of its parameter services."""
    parameters = SIM if request.param == 'encoder_driver' else None
    program, caller = start_program(request.param, parameters=parameters), Caller(request.param)
    yield caller
    caller.observer.close()
    assert program.stop() == 0


def test_every_parameter_is_described(caller):
    names = [name for name in caller.call(ListParameters, 'list_parameters').result.names
             if name not in ('use_sim_time', 'start_type_description_service')]
    assert len(names) > 5
    for descriptor in caller.call(
            DescribeParameters, 'describe_parameters', names=names).descriptors:
        assert len(descriptor.description) > 5, descriptor.name
        assert (descriptor.floating_point_range or descriptor.integer_range
                or descriptor.additional_constraints), descriptor.name
        assert descriptor.read_only == (descriptor.name not in (
            'dexterity_warn', 'dexterity_error', 'dexterity_hysteresis',
            'alert_limit_deg')), descriptor.name


def test_what_may_change_live_and_what_may_not(caller):
    if caller.node != 'diagnostics':
        name, value = {
            'encoder_driver': ('source', 'can'), 'fkm': ('solver', 'classic')}[caller.node]
        result = caller.set_value(name, value)
        assert not result.successful
        assert 'read-only' in result.reason
        return
    assert caller.set_value('dexterity_warn', 0.2).successful
    result = caller.set_value('dexterity_error', 0.3)
    assert not result.successful
    assert "'dexterity_error' is 0.3" in result.reason
    assert not caller.set_value('dexterity_warn', -1.0).successful
