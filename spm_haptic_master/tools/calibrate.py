# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds the encoders' zero counts while a static jig holds the device in a known pose."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import datetime
from math import degrees, isfinite, radians
from pathlib import Path
from typing import Any

from spm_haptic_master.calibration.calibration_file import read_calibration, write_calibration
from spm_haptic_master.calibration.jig_pose import (
    calibrate,
    Calibration,
    jig_angles,
    read_still,
    Reading,
)
from spm_haptic_master.calibration.recording import RAW_COUNTS, record_counts
from spm_haptic_master.calibration.verification import check_joints
from spm_haptic_master.exceptions import CalibrationError, InputError, UnreachableError
from spm_haptic_master.geometry_settings import (
    geometry_from,
    GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.settings import Values
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.source_factory import make_source, SOURCE_SETTINGS
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.progress_bar import ProgressBar

DESCRIPTION = """\
Reads the encoders for some seconds while a static jig holds the device in a known pose, and writes
their zero counts as a parameter file for the driver (--params-file). If the file already exists,
nothing is written: the encoders are compared with it. A run at a second pose also checks the
directions, which cannot be determined from one pose."""
# Default pose of the jig, psi theta phi (deg): the workspace's centre, with a self-rotation far
# from the singularity near 50 deg.
POSE_DEFAULT = (degrees(trajectories.CENTRE_PSI), degrees(trajectories.CENTRE_THETA), 0.0)


def main(args: list[str] | None = None) -> int:
    """Calibrate, or verify an earlier calibration; 1 if it cannot be trusted."""
    return command_line.run('calibrate', _run, args)


def _run(args: list[str]) -> int:
    options = _parser().parse_args(args)
    given = command_line.given(options)
    source = str(given.get('source', 'can'))
    if source not in ('can', 'replay'):
        raise InputError(f"parameter 'source' is {source!r}; expected can or replay "
                         '(a simulation has nothing to calibrate)')
    values = command_line.checked(given, SOURCE_SETTINGS[source], source)
    angles = _joint_angles(options.pose, command_line.checked(
        given, (*GEOMETRY_SETTINGS, WORKING_MODE_SETTING)))
    counts_per_turn = values['encoders.counts_per_turn']
    if options.output.exists() and not options.output.is_file():
        raise InputError(f"--output '{options.output}'; expected a file, or a name that does not "
                         'exist yet')
    before = read_calibration(options.output) if options.output.exists() else None
    if before is not None and before.counts_per_turn != counts_per_turn:
        raise InputError(f'{options.output}: it is for {list(before.counts_per_turn)} counts per '
                         f'turn, the encoders have {list(counts_per_turn)}')
    counts = _record(source, values, options.seconds)
    readings = read_still(
        counts, counts_per_turn, radians(options.noise_limit), radians(options.drift_limit))
    if before is not None and not options.force:
        _verify(options, before, readings, angles)
        return 0
    calibration = calibrate(
        readings, angles, values['encoders.direction'], counts_per_turn,
        datetime.now().astimezone().isoformat(timespec='seconds'),
        tuple(map(radians, options.pose)), len(counts), before)
    write_calibration(options.output, calibration)
    _report(options.output, calibration, replaced=before)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_line.make_parser('calibrate', DESCRIPTION)
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILE',
                        help='parameter file to write, or to verify if it already exists')
    parser.add_argument('--pose', type=float, nargs=3, default=POSE_DEFAULT,
                        metavar=('PSI', 'THETA', 'PHI'),
                        help='pose of the jig, ZXZ angles in deg (default {:g} {:.4f} {:g}, the '
                        "workspace's centre)".format(*POSE_DEFAULT))
    parser.add_argument('--seconds', type=float, default=5.0, metavar='S',
                        help='length of the recording, s (default 5)')
    parser.add_argument('--noise-limit', type=float, default=0.1, metavar='DEG',
                        help='largest noise (1 sigma) of a sensor that is accepted (default 0.1)')
    parser.add_argument('--drift-limit', type=float, default=0.05, metavar='DEG',
                        help='largest motion of a joint that is accepted (default 0.05)')
    parser.add_argument('--tolerance', type=float, default=0.1, metavar='DEG',
                        help='largest deviation that a verification accepts (default 0.1)')
    parser.add_argument('--force', action='store_true',
                        help='write the file even if it already exists')
    return parser


def _joint_angles(pose: Sequence[float], values: Values) -> tuple[float, float, float, float]:
    """Return the four joint angles, rad, of a pose in deg."""
    if not all(map(isfinite, pose)):
        raise InputError(f'--pose {" ".join(f"{angle:g}" for angle in pose)}; '
                         'expected three finite angles')
    try:
        return jig_angles([*map(radians, pose)], geometry_from(values), values['working_mode'])
    except UnreachableError as error:
        raise InputError(f'--pose {" ".join(f"{angle:g}" for angle in pose)}: '
                         'out of reach of the manipulator') from error


def _record(name: str, values: dict[str, Any], seconds: float) -> list[list[int]]:
    """Return the counts of the sets that arrive within some seconds; show the progress."""
    source = make_source(name, values | RAW_COUNTS)
    bar = ProgressBar('calibrate', seconds, source)
    try:
        return record_counts(source, values['encoders.counts_per_turn'], seconds, bar.show)
    finally:
        bar.end()
        source.close()


def _verify(options: argparse.Namespace, before: Calibration, readings: tuple[Reading, ...],
            angles: tuple[float, ...]) -> None:
    """Print how the encoders differ from an earlier calibration; CalibrationError if too much."""
    checks = check_joints(before, readings, angles)
    print(f'{options.output}: calibration of {before.date}, verified; not overwritten '
          '(--force overwrites it)')
    for check in checks:
        print(f'  {check.joint}: {degrees(check.deviation):+.3f} deg off, '
              f'sigma {degrees(check.sigma):.4f} deg, direction {check.direction.value}')
    failures = [check.failure(radians(options.tolerance)) for check in checks]
    if any(failures):
        raise CalibrationError(f'{options.output} does not hold: '
                               f'{"; ".join(filter(None, failures))} '
                               f'(tolerance {options.tolerance:g} deg)')


def _report(path: Path, calibration: Calibration, replaced: Calibration | None) -> None:
    """Print what was written."""
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
        print('One pose cannot determine the directions: move the jig to a second pose and run '
              'calibrate again.')
