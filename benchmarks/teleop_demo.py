# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lead a simulated laparoscopic slave by master, teleop and a simulated surgeon; print figures."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from contextlib import ExitStack
from functools import partial
import json
from math import radians
import os
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import time

from benchmarks.pipeline.child_process import executable, private_environment, Program
from benchmarks.pipeline.run import PipelineError
from benchmarks.surgeon import Surgeon
from benchmarks.teleop_figures import Loss, table
from spm_haptic_master.tools import command_line

NAME = 'teleop_demo'
DESCRIPTION = """\
A simulated surgeon leads a laparoscopic slave through insertion, tilt, clutch and withdrawal, and
loses the encoder of the insertion and one of the orientation; no ROS and no hardware is needed.
Other arguments are those of master: -p teleop.speed_limit:=1.0"""
# The handle upright, away from the singular surface: psi, theta, phi (ZXZ), deg.
POSE = [135.0, 54.735610317, 20.0]
# Parameters of master unless it is given others: a simulated rig that is steered, and time-outs
# (s) that a desktop's pauses do not reach; no command goes out without a sample anyway.
DEFAULTS = {
    'source': 'sim',
    'teleop.run': True,
    'sim.trajectory': 'fixed',
    'sim.pose_deg': POSE,
    'rate': 100.0,
    'sample_timeout': 0.5,
    'max_age': 0.5,
    'teleop.orientation_timeout': 0.5,
    'teleop.slave_timeout': 1.0,
    'teleop.presence_timeout': 1.0,
    'teleop.requires_trocar': True,
    # The axis of the upright handle is the shaft's, which points downwards.
    'teleop.registration_zxz_deg': [0.0, 125.264389683, -135.0],
}
# The slave: its trocar in its base frame (m), depth of its tip (m), its shaft points downwards.
TROCAR = (0.1, 0.0, 0.25)
SLAVE = {
    'slave.trocar': list(TROCAR),
    'slave.depth': 0.1,
    'slave.pose_zxz_deg': [0.0, 180.0, 0.0],
}
# The hand slides at this speed (m/s), and tilts the handle by this angle (rad).
SPEED, TILT = 0.03, radians(15.0)
# Time of a tilt, and for which something is lost (s).
TILTING, LOST = 2.0, 2.0
# Sensor of the orientation that is lost.
SENSOR = 'joint_3a'
# Longest wait for a change of state (s).
PATIENCE = 30.0
# Time after which the surgeon looks whether the slave still follows (s), and how often it presses
# the clutch again where the machine had a pause.
STEP, ATTEMPTS = 0.1, 20


class Demonstration:
    """The acts of the surgeon, in their order; each prints a line."""

    def __init__(self, surgeon: Surgeon) -> None:
        self._surgeon = surgeon
        self._began = time.monotonic()
        self.losses: list[Loss] = []
        # Times of the acts, ns, and what they are, for a picture.
        self.acts: list[tuple[int, str]] = []

    def run(self) -> None:
        """Lead the slave; PipelineError where it cannot be led."""
        surgeon = self._surgeon
        if not surgeon.await_ready(PATIENCE):
            raise PipelineError('the nodes have not found each other')
        surgeon.hand.begin()
        self._report('master, teleop and slave are running')
        self._follow(1.0)
        self._report('presence pressed, enable given')
        self._slide(0.04)
        self._report('insertion by 40 mm')
        self._tilt()
        self._report('tilted to four sides')
        self._clutch(-0.04)
        self._report('clutch: the hand went back by 40 mm, the slave held')
        self._slide(0.04)
        self._report('insertion by 40 mm more')
        self._lose_insertion()
        self._slide(-0.06)
        self._report('withdrawal by 60 mm')
        self._lose_sensor()
        self._follow(1.0)
        self._report('enable given again')
        surgeon.press('presence', False)
        surgeon.await_state('disengaged', PATIENCE)
        self._report('presence released')
        surgeon.sleep(0.5)

    def _report(self, text: str) -> None:
        self.acts.append((time.time_ns(), text))
        passed = time.monotonic() - self._began
        print(f'{passed:6.1f} s  {text:52} {self._surgeon.state}', flush=True)

    def _follow(self, seconds: float) -> None:
        """Have the slave follow for a time, s; again where a pause of the machine has ended it."""
        surgeon = self._surgeon
        left, deadline = seconds, time.monotonic() + PATIENCE
        while left > 0.0:
            if surgeon.state != 'engaged' and not surgeon.engage(PATIENCE):
                raise PipelineError(f'the slave could not be engaged: {surgeon.state}')
            surgeon.sleep(min(left, STEP))
            if surgeon.state == 'engaged' or time.monotonic() > deadline:
                left -= STEP

    def _slide(self, by: float) -> None:
        """Slide the handle by a distance, m, while the slave follows."""
        self._follow(STEP)
        hand = self._surgeon.hand
        hand.slide_to(hand.goal + by, SPEED)
        while not hand.is_there:
            self._follow(STEP)

    def _tilt(self) -> None:
        """Tilt the handle to four sides and back."""
        for quarter in range(4):
            self._surgeon.steer(TILT, radians(90.0 * quarter), radians(20.0))
            self._follow(TILTING)
        self._surgeon.steer(0.0, 0.0, radians(20.0))
        self._follow(TILTING)

    def _clutch(self, by: float) -> None:
        """Press the clutch while the slave follows, and slide the hand by a distance, m."""
        surgeon, hand = self._surgeon, self._surgeon.hand
        goal = hand.goal + by
        for _ in range(ATTEMPTS):
            surgeon.press('clutch', True)
            if surgeon.await_state('clutched', 1.0):
                hand.slide_to(goal, SPEED)
                # A pause of the machine may end it.
                surgeon.wait_until(lambda: hand.is_there or surgeon.state != 'clutched', PATIENCE)
            surgeon.press('clutch', False)
            if hand.goal == goal and hand.is_there:
                return
            self._follow(STEP)
        raise PipelineError(f'the clutch had no effect: {surgeon.state}')

    def _lose_insertion(self) -> None:
        """Lose the encoder of the insertion for a while; the orientations go on."""
        surgeon = self._surgeon
        surgeon.hand.lose(True)
        surgeon.await_state('disengaged', PATIENCE)
        last, _ = surgeon.hand.insertions[-1]
        before = len(surgeon.orientations)
        self._report('encoder of the insertion lost: the slave holds')
        surgeon.sleep(LOST)
        if len(surgeon.orientations) == before:
            raise PipelineError('the orientations have stopped')
        surgeon.hand.lose(False)
        surgeon.sleep(0.5)
        self._report('encoder is back: nothing moves')
        self.losses.append(Loss('insertion', last, time.time_ns()))

    def _lose_sensor(self) -> None:
        """Lose a sensor of the orientation for a while."""
        surgeon = self._surgeon
        surgeon.inject(f'dropout:{SENSOR}')
        surgeon.await_state('disengaged', PATIENCE)
        last = surgeon.orientations[-1].at
        self._report(f'{SENSOR} lost: the slave holds')
        surgeon.sleep(LOST)
        surgeon.inject('')
        if not surgeon.await_state('disengaged: master not enabled', PATIENCE):
            raise PipelineError(f'{SENSOR} did not come back')
        self._report(f'{SENSOR} is back: nothing moves')
        surgeon.sleep(1.0)
        self.losses.append(Loss('orientation', last, time.time_ns()))


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

    PipelineError: the slave could not be engaged, a sensor did not come back, or a process has
    ended.
    """
    parser = argparse.ArgumentParser(
        prog=NAME, description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--picture', type=Path, metavar='FILE', help='draw it (PNG, SVG)')
    given, words = parser.parse_known_args(args)
    os.environ.update(private_environment())
    print('a session of about 45 s', flush=True)
    with ExitStack() as stack:
        # A file before those that are given: they override it, as `-p` does.
        defaults = Path(stack.enter_context(TemporaryDirectory(prefix=NAME)), 'defaults.yaml')
        defaults.write_text(json.dumps({'/**': {'ros__parameters': DEFAULTS}}))
        commands = {
            'sim_slave': executable('sim_slave', parameters=SLAVE),
            'master': executable('master', '--params-file', str(defaults), *words),
        }
        programs = {
            name: stack.enter_context(Program(command)) for name, command in commands.items()
        }
        watch = partial(_check_alive, programs)
        surgeon = stack.enter_context(Surgeon(orientations=True, watch=watch))
        demonstration = Demonstration(surgeon)
        demonstration.run()
        print(f'\n{table(surgeon.commands, surgeon.poses, TROCAR, demonstration.losses)}')
        if given.picture is not None:
            from benchmarks import teleop_picture

            teleop_picture.draw(given.picture, surgeon, TROCAR, demonstration.acts)
    return 0


if __name__ == '__main__':
    sys.exit(main())
