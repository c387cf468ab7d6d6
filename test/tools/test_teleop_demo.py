# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `teleop_demo` is given is what its master has, or one line says why it does not run."""

import os
from pathlib import Path
import signal

from harness import start_program
import pytest
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.benchmark.surgeon import Surgeon
from spm_haptic_master.benchmark.teleop_demo import PATIENT

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
SECTION = '/**:\n  ros__parameters: '


def refusal(*args):
    """Return the only line of a demonstration that is refused."""
    program = start_program('teleop_demo', *map(str, args))
    assert program.wait(PATIENCE) == 1
    assert program.stdout == ''
    (line,) = program.stderr.splitlines()
    return line


@pytest.mark.process
@pytest.mark.parametrize(('args', 'words'), [
    (('-p', 'rte:=5.0'), "parameter 'rte' is 5.0; expected a parameter of this program, such as"),
    (('--params-file', 'missing.yaml'), 'missing.yaml: cannot be read'),
    # Of a child: it ended, and nobody noticed.
    (('-p', 'rate:=-5.0'), "master has ended with 1: master: parameter 'rate' is -5.0"),
    *(pytest.param(*case, marks=pytest.mark.evidence) for case in (
        (('-p', 'view.port:=9000'), '-p view.port:=9000: no parameter of this program'),
        (('-p', 'source:=sim'), "parameter 'source' is 'sim'; expected none: teleop_demo sets it"),
        (('-p', 'fkm:sensors:=6'), "parameter 'sensors' is 6; expected none: teleop_demo sets it"),
        (('-p', 'fkm:teleop.run:=false'), "parameter 'teleop.run' is False; expected none"),
        (('-r', '__ns:=/left'), "-r '__ns:=/left'; expected none"),
        (('--params-file', '/dev/null'), '--params-file /dev/null; expected a regular file')))
])
def test_what_cannot_run_is_one_line(args, words):
    assert refusal(*args).startswith(f'teleop_demo: {words}')


@pytest.mark.process
def test_the_bus_of_a_rig_in_a_file_is_refused(tmp_path):
    path = tmp_path / 'rig.yaml'
    path.write_text(f'{SECTION}{{can.channel: can0}}\n')
    assert refusal('--params-file', path).startswith(
        "teleop_demo: parameter 'can.channel' is 'can0'; expected none")


def child(demo, name):
    """Return the number of the demonstration's process of a name, None before it has begun."""
    found = Path(f'/proc/{demo.pid}/task/{demo.pid}/children').read_text().split()
    return next((int(pid) for pid in found if name in Path(
        f'/proc/{pid}/cmdline').read_text().split('\0')), None)


@pytest.mark.process
def test_a_child_that_is_killed_is_named(start):
    demo = start('teleop_demo')
    assert wait_until(lambda: 'are running' in demo.stdout, PATIENCE), demo.stderr
    os.kill(child(demo, 'sim_slave'), signal.SIGKILL)
    assert demo.wait(PATIENCE) == 1
    assert demo.stderr.startswith(f'teleop_demo: sim_slave has ended with {-signal.SIGKILL}: ')
    assert demo.stderr.count('\n') == 1


@pytest.mark.process
def test_a_default_of_the_demonstration_overrides_nothing_that_is_given(start, tmp_path):
    """By the services of the running nodes: the last argument was the demonstration's own."""
    path = tmp_path / 'limits.yaml'
    path.write_text(f'{SECTION}{{teleop.slave_timeout: 2.0}}\n')
    demo = start('teleop_demo', '-p', 'fkm:max_age:=0.3', '--params-file', str(path))
    assert wait_until(lambda: 'are running' in demo.stdout, PATIENCE), demo.stderr
    environment = dict(text.split('=', 1) for text in Path(
        f'/proc/{child(demo, "master")}/environ').read_text().split('\0') if text)

    def value(node, name):
        asked = start_program('ros', 'param', 'get', node, name,
                              ROS_DOMAIN_ID=environment['ROS_DOMAIN_ID'])
        assert asked.wait(PATIENCE) == 0, asked.stderr
        return float(asked.stdout.removeprefix(f'{name}: '))

    assert value('/fkm', 'max_age') == 0.3
    assert value('/teleop', 'teleop.slave_timeout') == 2.0
    # Of those that are not given, one is the demonstration's.
    assert value('/teleop', 'teleop.presence_timeout') == PATIENT['teleop.presence_timeout']
    assert demo.stop(signal.SIGINT) == 130


@pytest.mark.process
def test_the_surgeon_takes_no_arguments_of_the_program(monkeypatch, capfd):
    """Those without --ros-args, too: rcl warned of a deprecated remapping."""
    monkeypatch.setattr('sys.argv', ['teleop_demo', '-p', 'source:=sim'])
    with Surgeon():
        pass
    assert capfd.readouterr().err == ''
