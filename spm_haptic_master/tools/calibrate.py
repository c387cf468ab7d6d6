# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds the encoders' zero counts while a static jig holds the device in a known pose."""

from __future__ import annotations

import argparse
from datetime import datetime
from math import degrees, radians
from pathlib import Path
import sys
import time

from spm_haptic_master.calibration.calibration_file import read_calibration, write_calibration
from spm_haptic_master.calibration.jig_pose import (
    calibrate,
    Calibration,
    deviations,
    directions_told,
    read_still,
    Reading,
)
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import (
    CalibrationError,
    InputError,
    SourceEnded,
    UnreachableError,
)
from spm_haptic_master.geometry_settings import (
    geometry_from,
    GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics import inverse_angles, zxz_rotation
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.source_factory import make_source, SOURCE_SETTINGS
from spm_haptic_master.tools import command_line

DESCRIPTION = """\
Reads the encoders for some seconds while a static jig holds the device in a known pose, and writes
their zero counts as a parameter file for the driver (--params-file). Where the file is there
already, nothing is written: the encoders are held against it. A run at a second pose also checks
the directions, which one pose cannot tell."""
READ_TIMEOUT = 0.1  # s
# s without any set after which the run gives up and says why.
PATIENCE = 5.0
# The workspace's centre, and a self-rotation far from the singularity near 50 deg.
POSE_DEFAULT = (degrees(trajectories.CENTRE_PSI), degrees(trajectories.CENTRE_THETA), 0.0)
# s between two lines of progress where the output is no terminal, and on one.
LINE_PERIOD, TERMINAL_PERIOD = 1.0, 0.1
BAR = 30  # characters


def main(args: list[str] | None = None) -> int:
    """Calibrate, or verify an earlier calibration; 1 where it cannot be trusted."""
    return command_line.run('calibrate', _run, args)


def _run(args: list[str]) -> int:
    options = _parser().parse_args(args)
    given = command_line.given(options)
    source = given.get('source', 'can')
    if source not in ('can', 'replay'):
        raise InputError(f"parameter 'source' is {source!r}; expected can or replay "
                         '(a simulation has nothing to calibrate)')
    values = command_line.checked(given, SOURCE_SETTINGS[source], source)
    angles = _joint_angles(options.pose, command_line.checked(
        given, (*GEOMETRY_SETTINGS, WORKING_MODE_SETTING)))
    before = read_calibration(options.output) if options.output.exists() else None
    if before is not None and before.counts_per_turn != values['encoders.counts_per_turn']:
        raise InputError(f'{options.output}: it is for {list(before.counts_per_turn)} counts per '
                         f'turn, the encoders have {list(values["encoders.counts_per_turn"])}')
    counts = _record(source, values, options.seconds)
    readings = read_still(counts, values['encoders.counts_per_turn'],
                          radians(options.noise_limit), radians(options.drift_limit))
    if before is not None and not options.force:
        return _verify(options, before, readings, angles)
    calibration = calibrate(
        readings, angles, values['encoders.direction'], values['encoders.counts_per_turn'],
        datetime.now().astimezone().isoformat(timespec='seconds'),
        tuple(map(radians, options.pose)), len(counts), before)
    write_calibration(options.output, calibration)
    _tell(options.output, calibration, replaced=before)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_line.make_parser('calibrate', DESCRIPTION)
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILE',
                        help='the parameter file to write, or to verify where it is there')
    parser.add_argument('--pose', type=float, nargs=3, default=POSE_DEFAULT,
                        metavar=('PSI', 'THETA', 'PHI'),
                        help='pose of the jig, ZXZ angles in deg (default {:g} {:.4f} {:g}, the '
                        "workspace's centre)".format(*POSE_DEFAULT))
    parser.add_argument('--seconds', type=float, default=5.0, metavar='S',
                        help='s to read (default 5)')
    parser.add_argument('--noise-limit', type=float, default=0.1, metavar='DEG',
                        help='noise (1 sigma) beyond which a sensor is refused (default 0.1)')
    parser.add_argument('--drift-limit', type=float, default=0.05, metavar='DEG',
                        help='motion beyond which the device did not stand still (default 0.05)')
    parser.add_argument('--tolerance', type=float, default=0.1, metavar='DEG',
                        help='deviation that a verification accepts (default 0.1)')
    parser.add_argument('--force', action='store_true', help='write although the file is there')
    return parser


def _joint_angles(pose: tuple[float, ...], values: dict[str, object]) -> tuple[float, ...]:
    """Return the four joint angles, rad, of a pose in deg."""
    try:
        th1a, th1b, th1c, _, th3a = inverse_angles(
            zxz_rotation(*map(radians, pose)), geometry_from(values), values['working_mode'])
    except UnreachableError as error:
        raise InputError(f'--pose {" ".join(f"{angle:g}" for angle in pose)}: '
                         'out of reach of the manipulator') from error
    return th1a, th1b, th1c, th3a


def _record(source_name: str, values: dict[str, object], seconds: float) -> list[list[int]]:
    """Return the counts of the sets that come within some seconds, and show the progress."""
    per_turn = values['encoders.counts_per_turn']
    # With these an angle is the counts themselves.
    source = make_source(source_name, values | {
        'encoders.direction': (1,) * 4, 'encoders.zero_count': (0,) * 4})
    progress = Progress(seconds)
    counts = []
    try:
        end = None
        give_up = time.monotonic() + PATIENCE
        while (now := time.monotonic()) < (end or give_up):
            sample = source.read(READ_TIMEOUT)
            if sample is not None:
                # The time runs from the first set: nodes may have to be started before.
                end = end or now + seconds
                give_up = now + PATIENCE
                counts.append([round(angle * turn / TURN) % turn for angle, turn
                               in zip(sample.angles, per_turn, strict=True)])
            elif now > give_up:
                break
            progress.show(0.0 if end is None else seconds - (end - now), len(counts), source)
    except SourceEnded:
        pass  # a recording shorter than asked for; read_still says whether it is enough
    finally:
        progress.end()
        fault = source.fault
        source.close()
    if not counts:
        raise CalibrationError(f'no set of four encoders came: {fault}')
    return counts


class Progress:
    """
    Shows on stderr how far the recording is: a bar on a terminal, else a line a second.

    Parameters
    ----------
    seconds : float
        How long it takes.

    """

    def __init__(self, seconds: float):
        self._seconds = seconds
        self._terminal = sys.stderr.isatty()
        self._next = 0.0

    def show(self, done: float, sets: int, source: EncoderSource) -> None:
        """Tell that `done` seconds have passed, if it is time to."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + (TERMINAL_PERIOD if self._terminal else LINE_PERIOD)
        fraction = min(done / self._seconds, 1.0)
        text = f'{done:4.1f} of {self._seconds:g} s, {sets} sets'
        if source.fault:
            text += f' ({source.fault})'
        if self._terminal:
            bar = ('#' * round(BAR * fraction)).ljust(BAR, '.')
            print(f'\r[{bar}] {text}\x1b[K', end='', file=sys.stderr, flush=True)
        else:
            print(f'calibrate: {text}', file=sys.stderr, flush=True)

    def end(self) -> None:
        """Leave the line."""
        if self._terminal:
            print(file=sys.stderr)


def _verify(options: argparse.Namespace, before: Calibration, readings: tuple[Reading, ...],
            angles: tuple[float, ...]) -> int:
    """Hold the encoders against an earlier calibration, and say what differs."""
    off = deviations(before, readings, angles)
    told = directions_told(before, readings, angles)
    wrong = []
    print(f'{options.output}: calibration of {before.date}, verified; not overwritten '
          '(--force writes it anew)')
    for index, joint in enumerate(JOINT_NAMES):
        direction = {0: 'not told by this pose', before.direction[index]: 'confirmed'}.get(
            told[index], 'REVERSED')
        print(f'  {joint}: {degrees(off[index]):+.3f} deg off, '
              f'sigma {degrees(readings[index].sigma):.4f} deg, direction {direction}')
        if direction == 'REVERSED':
            wrong.append(f'{joint} turns the other way')
        elif abs(off[index]) > radians(options.tolerance):
            wrong.append(f'{joint} is {degrees(off[index]):+.3f} deg off')
    if wrong:
        raise CalibrationError(f'{options.output} does not hold: {"; ".join(wrong)} '
                               f'(tolerance {options.tolerance:g} deg)')
    return 0


def _tell(path: Path, calibration: Calibration, replaced: Calibration | None) -> None:
    """Say what was written."""
    if replaced:
        print(f'{path}: overwritten (it held the calibration of {replaced.date})')
    else:
        print(f'{path}: written')
    for index, joint in enumerate(JOINT_NAMES):
        checked = 'checked' if calibration.direction_checked[index] else 'not checked'
        print(f'  {joint}: zero count {calibration.zero_count[index]}, '
              f'sigma {degrees(calibration.sigma[index]):.4f} deg, '
              f'direction {calibration.direction[index]:+d} ({checked})')
    if not all(calibration.direction_checked):
        print('One pose cannot tell a direction: move the jig to a second pose and run calibrate '
              'again.')
