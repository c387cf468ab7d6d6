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
from benchmarks.teleop_demo import DEFAULTS
from benchmarks.teleop_figures import Loss, table
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


@pytest.mark.process
def test_a_laparoscopic_slave_is_led_and_held_by_real_processes():
    """Insertion, tilt, clutch, withdrawal and two losses, over DDS."""
    with start_command([sys.executable, '-m', 'benchmarks.teleop_demo']) as demo:
        assert demo.wait(4.0 * PATIENCE) == 0, demo.stderr
    figures = dict(
        line.strip('| ').split(' | ') for line in demo.stdout.splitlines() if line.startswith('| ')
    )
    assert float(figures['distance of the shaft from the trocar, largest'].split()[0]) <= 1e-12
    smallest, largest = re.findall(
        r'([\d.]+) mm', figures['depth of the tip, smallest and largest']
    )
    # 100 mm at first; the hand inserts by 80 mm in all, less what pauses of the machine take.
    assert float(smallest) >= 90.0
    assert 140.0 <= float(largest) <= 180.1
    assert float(figures['first command beside the slave, largest'].split()[0]) < 0.1
    for lost in ('insertion', 'orientation'):
        assert figures[f'{lost} lost: commands from then to the next enable'] == '0'


def arrived(ms, angle, depth=0.1):
    """Return a pose turned about the shaft, z, with its tip at a depth below the origin."""
    return Arrived(
        ms * MS,
        ms * MS,
        quaternion_from_vector(0.0, 0.0, angle),
        (0.0, 0.0, depth),
    )


def test_the_table_of_a_demonstration():
    # Two stretches: 0.01 rad in 5 ms, then a fresh start from the slave's pose, 0.002 rad and 1 mm
    # off; the insertion was lost after the first.
    commands = [
        arrived(1000, 0.0),
        arrived(1005, 0.01),
        arrived(1010, 0.012, 0.102),
        arrived(2000, 0.112, 0.12),
        arrived(2005, 0.113, 0.12),
    ]
    poses = [
        arrived(999, 0.0),
        arrived(1007, 0.0),
        arrived(1500, 0.11, 0.119),
        arrived(2006, 0.112, 0.12),
    ]
    loss = Loss('insertion', last=1008 * MS, enabled=1900 * MS)
    found = dict(
        line.strip('| ').split(' | ')
        for line in table(commands, poses, (0.0, 0.0, 0.0), [loss]).splitlines()[2:]
    )
    assert found == {
        'commands on `servo_cp`': '5',
        'times that the slave began to follow': '2',
        'first command beside the slave, largest': '0.115 deg, 1.000 mm',
        'step from one command to the next, largest': '0.573 deg, 2.000 mm',
        'angular speed of the command, largest': '2.00 rad/s',
        'distance of the shaft from the trocar, largest': '0.0e+00 m',
        'depth of the tip, smallest and largest': '100.0 mm, 120.0 mm',
        'tracking error of the slave, rms': '0.288 deg',
        'tracking error of the slave, largest': '0.573 deg',
        'insertion lost: from its last value to the last command': '2.0 ms',
        'insertion lost: commands from then to the next enable': '0',
    }
