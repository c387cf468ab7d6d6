# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The demonstration of a tele-operation: its master is given what it is given, and its figures."""

import os
from pathlib import Path
import re
import signal
import sys

from benchmarks.pipeline.child_process import wait_until
from benchmarks.surgeon import Arrived
from benchmarks.teleop_demo import DEFAULTS, table
from harness import start_command, start_program
import pytest
from spm_haptic_master.kinematics.rotations import quaternion_from_vector

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
MS = 1_000_000


def child(demo, name):
    """Return the number of the demonstration's process of a name."""
    found = Path(f'/proc/{demo.pid}/task/{demo.pid}/children').read_text().split()
    return next(
        int(pid) for pid in found if name in Path(f'/proc/{pid}/cmdline').read_text().split('\0')
    )


@pytest.mark.process
def test_a_default_overrides_nothing_that_is_given_and_a_killed_child_is_named(tmp_path):
    path = tmp_path / 'limits.yaml'
    path.write_text('/**:\n  ros__parameters: {teleop.slave_timeout: 2.0}\n')
    with start_command(
        [
            sys.executable,
            '-m',
            'benchmarks.teleop_demo',
            '-p',
            'fkm:max_age:=0.3',
            '--params-file',
            str(path),
        ]
    ) as demo:
        assert wait_until(lambda: 'are running' in demo.stdout, PATIENCE), demo.stderr
        environment = Path(f'/proc/{child(demo, "master")}/environ').read_text()
        (domain,) = re.findall(r'\bROS_DOMAIN_ID=(\d+)', environment)

        def value(node, name):
            asked = start_program('ros', 'param', 'get', node, name, ROS_DOMAIN_ID=domain)
            assert asked.wait(PATIENCE) == 0, asked.stderr
            return float(asked.stdout.removeprefix(f'{name}: '))

        assert value('/fkm', 'max_age') == 0.3
        assert value('/teleop', 'teleop.slave_timeout') == 2.0
        assert value('/teleop', 'teleop.presence_timeout') == DEFAULTS['teleop.presence_timeout']
        os.kill(child(demo, 'sim_slave'), signal.SIGKILL)
        assert demo.wait(PATIENCE) == 1
    # One line: rcl would warn of the program's arguments, if the surgeon had taken them.
    assert demo.stderr.startswith(f'teleop_demo: sim_slave has ended with {-signal.SIGKILL}: ')
    assert demo.stderr.count('\n') == 1


def arrived(ms, angle):
    return Arrived(ms * MS, ms * MS, quaternion_from_vector(0.0, 0.0, angle))


def test_the_table_of_a_demonstration():
    # Two stretches: 0.01 rad in 5 ms, then a fresh start from the slave's pose, 0.002 rad off.
    commands = [
        arrived(1000, 0.0),
        arrived(1005, 0.01),
        arrived(1010, 0.012),
        arrived(2000, 0.112),
        arrived(2005, 0.113),
    ]
    poses = [arrived(999, 0.0), arrived(1007, 0.0), arrived(1500, 0.11), arrived(2006, 0.112)]
    found = dict(
        line.strip('| ').split(' | ')
        for line in table(commands, poses, lost=1008 * MS, enabled=1900 * MS).splitlines()[2:]
    )
    assert list(found.values()) == [
        '5',
        '2',
        '0.115 deg',
        '0.573 deg',
        '2.00 rad/s',
        '0.288 deg',
        '0.573 deg',
        '2.0 ms',
        '0',
    ]
