# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Run master, teleop and a simulated slave with a simulated surgeon, and print what it showed."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import pairwise
import json
from math import degrees, sqrt
import os
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import time

from benchmarks.pipeline.child_process import executable, private_environment, Program
from benchmarks.pipeline.run import PipelineError
from benchmarks.surgeon import Arrived, Surgeon
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.timing import SECOND
from spm_haptic_master.tools import command_line

NAME = 'teleop_demo'
DESCRIPTION = """\
A simulated surgeon engages, clutches, loses a sensor and comes back, in half a minute; no ROS and
no hardware is needed. Other arguments are those of master: -p teleop.speed_limit:=1.0"""
# Parameters of master unless it is given others: a simulated rig and its motion, and time-outs (s)
# that a desktop's pauses do not reach. Whatever they are, no command goes out without a sample.
DEFAULTS = {
    'source': 'sim',
    'teleop.run': True,
    'sim.trajectory': 'sweep',
    'sample_timeout': 0.5,
    'max_age': 0.5,
    'teleop.orientation_timeout': 0.5,
    'teleop.slave_timeout': 1.0,
    'teleop.presence_timeout': 1.0,
}
# Time of each part in which the slave follows (s), and of the clutch.
FOLLOW, CLUTCH = 4.0, 2.0
# Sensor that is lost, and for how long (s).
SENSOR, LOST = 'joint_3a', 2.0
# Longest wait for a change of state (s).
PATIENCE = 30.0
# Time after which the surgeon looks whether the slave still follows (s), and how often it presses
# the clutch again where the machine had a pause.
STEP, ATTEMPTS = 0.1, 20
# Interval without a command that separates two stretches (ns): the shortest time-out of teleop.
PAUSE = 500_000_000
# Time after the last orientation in which a command may be on its way (ns).
ON_ITS_WAY = 50_000_000
# Longest time between a command and the pose of the slave that it is compared with (ns).
PAIRED = 20_000_000
# Nanoseconds in a millisecond.
MILLISECOND = 1e6


def main(args: list[str] | None = None) -> int:
    """Run the demonstration; return the exit code."""
    return command_line.run(NAME, _demonstrate, args)


def _check_alive(programs: Mapping[str, Program]) -> None:
    """Raise PipelineError with the last line of a program that has ended."""
    for name, program in programs.items():
        code = program.poll()
        if code is not None:
            lines = program.stderr.split('\n')
            last = next((line for line in reversed(lines) if line.strip()), 'without a word')
            raise PipelineError(f'{name} has ended with {code}: {last}')


def _demonstrate(args: list[str]) -> int:
    """
    Run the demonstration, print a line on each thing that happens, and its figures.

    PipelineError: the slave could not be engaged, the sensor did not come back, or a process has
    ended.
    """
    _, words = argparse.ArgumentParser(
        prog=NAME, description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_known_args(args)
    os.environ.update(private_environment())
    with ExitStack() as stack:
        # A file before those that are given: they override it, as `-p` does.
        defaults = Path(stack.enter_context(TemporaryDirectory(prefix=NAME)), 'defaults.yaml')
        defaults.write_text(json.dumps({'/**': {'ros__parameters': DEFAULTS}}))
        programs = {
            name: stack.enter_context(Program(command))
            for name, command in (
                ('sim_slave', executable('sim_slave')),
                ('master', executable('master', '--params-file', str(defaults), *words)),
            )
        }
        surgeon = stack.enter_context(
            Surgeon(orientations=True, watch=partial(_check_alive, programs))
        )
        began = time.monotonic()

        def report(text: str) -> None:
            print(f'{time.monotonic() - began:6.1f} s  {text:44} {surgeon.state}', flush=True)

        if not surgeon.await_ready(PATIENCE):
            raise PipelineError('the nodes have not found each other')
        report('master, teleop and slave are running')
        _follow(surgeon, FOLLOW)
        report('presence pressed, enable given')
        _clutch(surgeon)
        report('clutch pressed: the slave holds')
        surgeon.press('clutch', False)
        _follow(surgeon, FOLLOW)
        report('clutch released: a new offset')
        surgeon.inject(f'dropout:{SENSOR}')
        surgeon.await_state('disengaged', PATIENCE)
        lost = surgeon.orientations[-1].at
        report(f'{SENSOR} lost: the slave holds')
        surgeon.sleep(LOST)
        surgeon.inject('')
        if not surgeon.await_state('disengaged: master not enabled', PATIENCE):
            raise PipelineError(f'{SENSOR} did not come back')
        report(f'{SENSOR} is back: nothing moves')
        surgeon.sleep(1.0)
        enabled = time.time_ns()
        _follow(surgeon, FOLLOW)
        report('enable given again')
        surgeon.press('presence', False)
        surgeon.await_state('disengaged', PATIENCE)
        report('presence released')
        surgeon.sleep(0.5)
        print(f'\n{table(surgeon.commands, surgeon.poses, lost, enabled)}')
    return 0


def _follow(surgeon: Surgeon, seconds: float) -> None:
    """Have the slave follow for a time, s, and again where a pause of the machine has ended it."""
    left, deadline = seconds, time.monotonic() + PATIENCE
    while left > 0.0:
        if surgeon.state != 'engaged' and not surgeon.engage(PATIENCE):
            raise PipelineError(f'the slave could not be engaged: {surgeon.state}')
        surgeon.sleep(min(left, STEP))
        if surgeon.state == 'engaged' or time.monotonic() > deadline:
            left -= STEP


def _clutch(surgeon: Surgeon) -> None:
    """Press the clutch while the slave follows."""
    for _ in range(ATTEMPTS):
        surgeon.press('clutch', True)
        if surgeon.await_state('clutched', 1.0):
            surgeon.sleep(CLUTCH)
            return
        surgeon.press('clutch', False)
        _follow(surgeon, STEP)
    raise PipelineError(f'the clutch had no effect: {surgeon.state}')


def table(commands: Sequence[Arrived], poses: Sequence[Arrived], lost: int, enabled: int) -> str:
    """
    Return the figures of a run as a Markdown table, from all commands and poses of the slave.

    `lost` and `enabled` are the times of the last orientation before the loss of the sensor, and
    of the next enable, ns.
    """
    stretches = _stretches(commands)
    starts = [_angle(stretch[0], _before(poses, stretch[0].at)) for stretch in stretches] or [0.0]
    steps = [
        (_angle(one, other), (other.stamp - one.stamp) / SECOND)
        for stretch in stretches
        for one, other in pairwise(stretch)
    ] or [(0.0, 1.0)]
    errors = list(_tracking(commands, poses)) or [0.0]
    rms = sqrt(sum(error * error for error in errors) / len(errors))
    last = max((each.at for each in commands if each.at < enabled), default=lost)
    while_lost = sum(lost + ON_ITS_WAY < each.at < enabled for each in commands)
    rows = (
        ('commands on `servo_cp`', f'{len(commands)}'),
        ('times that the slave began to follow', f'{len(stretches)}'),
        ('first command beside the slave, largest', f'{degrees(max(starts)):.3f} deg'),
        ('step from one command to the next, largest', f'{degrees(max(steps)[0]):.3f} deg'),
        (
            'angular speed of the command, largest',
            f'{max(angle / seconds for angle, seconds in steps):.2f} rad/s',
        ),
        ('tracking error of the slave, rms', f'{degrees(rms):.3f} deg'),
        ('tracking error of the slave, largest', f'{degrees(max(errors)):.3f} deg'),
        (
            'last orientation to last command, sensor lost',
            f'{max(0.0, (last - lost) / MILLISECOND):.1f} ms',
        ),
        ('commands from then to the next enable', f'{while_lost}'),
    )
    return '\n'.join(
        ('| figure | value |', '|---|---|', *(f'| {name} | {value} |' for name, value in rows))
    )


def _stretches(commands: Sequence[Arrived]) -> list[list[Arrived]]:
    """Return the commands in stretches without a pause."""
    found: list[list[Arrived]] = []
    for command in commands:
        if not found or command.stamp - found[-1][-1].stamp > PAUSE:
            found.append([])
        found[-1].append(command)
    return found


def _tracking(commands: Sequence[Arrived], poses: Sequence[Arrived]) -> Iterator[float]:
    """Yield the angle from each command to the next pose of the slave, rad."""
    following = iter(poses)
    pose = next(following, None)
    for command in commands:
        while pose is not None and pose.at < command.at:
            pose = next(following, None)
        if pose is not None and pose.at - command.at < PAIRED:
            yield _angle(command, pose)


def _before(poses: Sequence[Arrived], at: int) -> Arrived | None:
    """Return the last pose that arrived before a time, ns."""
    return next((pose for pose in reversed(poses) if pose.at < at), None)


def _angle(one: Arrived, other: Arrived | None) -> float:
    return 0.0 if other is None else rotation_distance(one.quaternion, other.quaternion)


if __name__ == '__main__':
    sys.exit(main())
