# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated surgeon at work, who engages, clutches and loses a sensor, and what it showed."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import degrees, sqrt
import os
import re
import time

from spm_haptic_master.benchmark.child_process import (
    bus_channel,
    executable,
    private_environment,
    Program,
)
from spm_haptic_master.benchmark.pipeline import PipelineError
from spm_haptic_master.benchmark.surgeon import Arrived, Surgeon
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.timing import SECOND

# Time-outs that a desktop's pauses do not reach (s). Whatever they are, no command goes out
# without a sample.
PATIENT = {'sample_timeout': 0.5, 'max_age': 0.5, 'teleop.orientation_timeout': 0.5,
           'teleop.slave_timeout': 1.0, 'teleop.presence_timeout': 1.0}
# Time of each part in which the slave follows (s), and of the clutch.
FOLLOW, CLUTCH = 4.0, 2.0
# Sensor that is lost, and for how long (s).
SENSOR, LOST = 'joint_3a', 2.0
# Times at which it is lost, from the first sample: the surgeon has to be engaged at one of them.
LOSSES = range(20, 600, 10)
# Line of `sim_bus` on the loss, with its time (s).
BEGINS = re.compile(r'^([\d.]+) dropout:\S+ begins$', re.MULTILINE)
# Longest wait for a change of state (s).
PATIENCE = 30.0
# Time after which the surgeon looks whether the slave still follows (s), and how often it is tried
# again where the machine had a pause.
STEP, ATTEMPTS = 0.1, 20
# Interval without a command that separates two stretches (ns): the shortest time-out of teleop.
PAUSE = 500_000_000
# Time after the last orientation in which a command may be on its way (ns).
ON_ITS_WAY = 50_000_000
# Longest time between a command and the pose of the slave that it is compared with (ns).
PAIRED = 20_000_000
# Nanoseconds in a millisecond.
MILLISECOND = 1e6


@dataclass(frozen=True, slots=True)
class Summary:
    """
    What a run of the tele-operation showed.

    Attributes
    ----------
    commands : int
        Number of commands.
    starts : int
        How often the slave began to follow.
    largest_start : float
        Largest angle from the slave's pose to the first command of a stretch, deg.
    largest_step : float
        Largest angle from one command of a stretch to the next, deg.
    largest_speed : float
        Largest angular speed of the command, by its stamps, rad/s.
    tracking_rms, tracking_largest : float
        Angle from the command to the slave, deg.
    stop : float
        Time from the last orientation before the sensor was lost to the last command, ms.
    while_lost : int
        Commands from the loss to the next enable.

    """

    commands: int
    starts: int
    largest_start: float
    largest_step: float
    largest_speed: float
    tracking_rms: float
    tracking_largest: float
    stop: float
    while_lost: int


def fixed() -> dict[str, object]:
    """Return the parameters that make the rig a simulated one, which nobody else gives."""
    return {'source': 'can', 'sensors': 4, 'can.interface': 'udp_multicast',
            'can.channel': bus_channel(), 'can.sync': 'produce', 'teleop.run': True,
            **simulated_rig()}


@contextmanager
def _chain(parameters: Sequence[str], given: Collection[str]) -> Iterator[dict[str, Program]]:
    """Run simulated encoders on a bus, the slave, and master with teleop; yield them."""
    faults = [word for start in LOSSES
              for word in ('--fault', f'dropout:{SENSOR}@{start}+{LOST:g}')]
    bus = {name: fixed()[name] for name in ('can.interface', 'can.channel')}
    patient = {name: value for name, value in PATIENT.items() if name not in given}
    commands = {
        'sim_bus': executable('sim_bus', *faults, parameters={**bus, 'sim.trajectory': 'sweep'}),
        'sim_slave': executable('sim_slave'),
        'master': executable('master', *parameters, parameters={**patient, **fixed()})}
    with ExitStack() as stack:
        yield {name: stack.enter_context(Program(command)) for name, command in commands.items()}


def _check_alive(programs: Mapping[str, Program]) -> None:
    """Raise PipelineError with the last line of a program that has ended."""
    for name, program in programs.items():
        code = program.poll()
        if code is not None:
            lines = program.stderr.split('\n')
            last = next((line for line in reversed(lines) if line.strip()), 'without a word')
            raise PipelineError(f'{name} has ended with {code}: {last}')


def run(parameters: Sequence[str], given: Collection[str], say: Callable[[str], None]) -> Summary:
    """
    Run the demonstration.

    Parameters
    ----------
    parameters : sequence of str
        Further arguments of `master`.
    given : collection of str
        Names of the parameters that they give: the demonstration has no defaults for these.
    say : callable
        Called with a line on each thing that happens.

    Raises
    ------
    PipelineError
        The slave could not be engaged, no sensor was lost, or a process has ended.

    """
    os.environ.update(private_environment())
    with _chain(parameters, given) as programs, \
            Surgeon(orientations=True, watch=partial(_check_alive, programs)) as surgeon:
        began = time.monotonic()

        def report(text: str) -> None:
            say(f'{time.monotonic() - began:6.1f} s  {text:44} {surgeon.state}')

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
        lost = _await_loss(surgeon, programs['sim_bus'])
        report(f'{SENSOR} lost: the slave holds')
        surgeon.sleep(LOST)
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
        return summary(surgeon.commands, surgeon.poses, surgeon.orientations, lost, enabled)


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


def _await_loss(surgeon: Surgeon, encoders: Program) -> int:
    """Return the time of the last orientation before the sensor is lost while it follows, ns."""
    for _ in range(ATTEMPTS):
        known = _losses(encoders)
        if known:
            # In the second before the next loss the surgeon only waits.
            _follow(surgeon, known[-1] / SECOND + LOSSES.step - 1.0 - time.time())
            known = _losses(encoders)
        at = _next_loss(surgeon, encoders, len(known))
        state = next((text for when, text in reversed(surgeon.states) if when < at), '')
        if state == 'engaged' and surgeon.await_state('disengaged', 0.5 * LOST):
            return max(each.at for each in surgeon.orientations
                       if each.at < at + 0.25 * LOST * SECOND)
        surgeon.sleep(LOST)
    raise PipelineError(f'{SENSOR} was not lost while the slave followed')


def _next_loss(surgeon: Surgeon, encoders: Program, known: int) -> int:
    """Return the time of the loss behind the known ones, ns."""
    if not surgeon.wait_until(lambda: len(_losses(encoders)) > known, 2.0 * LOSSES.step):
        raise PipelineError(f'{SENSOR} was not lost')
    return _losses(encoders)[-1]


def _losses(encoders: Program) -> list[int]:
    """Return the times at which the sensor was lost until now, ns."""
    return [round(float(time_text) * SECOND) for time_text in BEGINS.findall(encoders.stdout)]


def stretches(commands: Sequence[Arrived]) -> list[list[Arrived]]:
    """Return the commands in stretches without a pause."""
    found: list[list[Arrived]] = []
    for command in commands:
        if not found or command.stamp - found[-1][-1].stamp > PAUSE:
            found.append([])
        found[-1].append(command)
    return found


def summary(commands: Sequence[Arrived], poses: Sequence[Arrived],
            orientations: Sequence[Arrived], lost: int, enabled: int) -> Summary:
    """
    Return what a run showed.

    Parameters
    ----------
    commands, poses, orientations : sequence of Arrived
        All of the run.
    lost, enabled : int
        Times of the loss of a sensor and of the next enable, ns.

    """
    steps, speeds, starts = [0.0], [0.0], [0.0]
    for stretch in stretches(commands):
        starts.append(_angle(stretch[0], _before(poses, stretch[0].at)))
        for one, other in pairwise(stretch):
            steps.append(_angle(one, other))
            speeds.append(steps[-1] / ((other.stamp - one.stamp) * 1e-9))
    errors = list(_tracking(commands, poses)) or [0.0]
    last = max((each.at for each in commands if each.at < enabled), default=lost)
    return Summary(
        commands=len(commands), starts=len(stretches(commands)),
        largest_start=degrees(max(starts)), largest_step=degrees(max(steps)),
        largest_speed=max(speeds),
        tracking_rms=degrees(sqrt(sum(error * error for error in errors) / len(errors))),
        tracking_largest=degrees(max(errors)), stop=max(0.0, (last - lost) / MILLISECOND),
        while_lost=sum(lost + ON_ITS_WAY < each.at < enabled for each in commands))


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


def table(found: Summary) -> str:
    """Return a summary as a Markdown table."""
    rows = (
        ('commands on `servo_cp`', f'{found.commands}'),
        ('times that the slave began to follow', f'{found.starts}'),
        ('first command beside the slave, largest', f'{found.largest_start:.3f} deg'),
        ('step from one command to the next, largest', f'{found.largest_step:.3f} deg'),
        ('angular speed of the command, largest', f'{found.largest_speed:.2f} rad/s'),
        ('tracking error of the slave, rms', f'{found.tracking_rms:.3f} deg'),
        ('tracking error of the slave, largest', f'{found.tracking_largest:.3f} deg'),
        ('last orientation to last command, sensor lost', f'{found.stop:.1f} ms'),
        ('commands from then to the next enable', f'{found.while_lost}'))
    return '\n'.join(('| figure | value |', '|---|---|',
                      *(f'| {name} | {value} |' for name, value in rows)))
