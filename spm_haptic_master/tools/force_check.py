# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Check a recorded bring-up of force: signs of the motors, weight, friction, stiffness."""

from __future__ import annotations

from argparse import Namespace
import csv
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
import re
import sys
import time
from typing import Any

import numpy as np
from spm_haptic_master.calibration.motor_bring_up import (
    identify_friction,
    Release,
    step_response,
    StepResponse,
    wiring_faults,
)
from spm_haptic_master.drives.drive_factory import make_unchecked_drives
from spm_haptic_master.drives.passed_check import PassedCheck
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.force import ForceLimits, Gravity, identify_gravity
from spm_haptic_master.force.gravity import Weight
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.kinematics import estimate
from spm_haptic_master.kinematics.number_backends import Array
from spm_haptic_master.parameters import nodes
from spm_haptic_master.parameters.arguments import Parser, positive
from spm_haptic_master.parameters.fkm import FKM_SETTINGS, sigma_from
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import RATE_SETTING, Values
from spm_haptic_master.simulation.source_factory import make_source
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.force_record import ANGLES, BringUp, record, TORQUES
from spm_haptic_master.validation.alignment import rotation_vectors

DESCRIPTION = """\
Checks a recorded bring-up of force: the sign of each motor by a small step, the weight from poses
that motors hold, friction from releases, and with it the stiffest spring that is passive.
RECORDING is a CSV file with the columns part, time (s), th1a, th1b, th1c, th3a (rad), tau1a,
tau1b, tau1c and tau3a of a fourth motor (N m); parts are named 'step 1a', 'pose 1', 'release z 1'.
With --record --output FILE.json it writes, where all of it holds, the file without which no torque
goes to these drives (drives.check_file). Exit code 0 if all of it holds, 1 if not."""
# Nodes whose parameters it takes, and the names of these.
NODES = ('encoder_driver', 'fkm')
NAMES = nodes.DRIVER_NAMES | nodes.DRIVE_NAMES | {setting.name for setting in FKM_SETTINGS}
# Form of the date in the file of a passed check.
DATE = '%Y-%m-%dT%H:%M:%SZ'
# Samples at rest with which a release begins.
AT_REST = 5
# Poses of a recording.
POSES = 12
# Largest residual of the weight (N m): more is felt.
LARGEST_RESIDUAL = 2e-3
# First words of a part's name, with the motor of a step.
PART = re.compile(r'(?:step (1[abc]|3a)|pose|release [xyz])(?!\S)')
# Columns of the orientation about which a release turns the handle.
DIRECTIONS = 'xyz'


@dataclass(frozen=True, slots=True)
class Part:
    """
    A part of a recording, of n samples.

    Attributes
    ----------
    name : list of str
        Words of its name, such as `step`, `1a`.
    time : ndarray, shape (n,)
        Times in the part, s.
    angles : ndarray, shape (n, 4)
        th1A, th1B, th1C, th3A, rad.
    torque : ndarray, shape (n, motors)
        Commanded torques, N m.

    """

    name: list[str]
    time: Array
    angles: Array
    torque: Array


@command_line.program('force_check')
def main(args: list[str]) -> int:
    """
    Check a recorded bring-up, or record one first.

    With --record the device moves by itself, and RECORDING is written; with --output as well, the
    passed check of these drives is written if all of it holds. Without --record only RECORDING is
    read.

    Parameters
    ----------
    args : list of str
        Command line without the name of the program.

    Returns
    -------
    int
        Exit code: 0 if all of it holds, 1 if not. After an error, which is one line on stderr, it
        is 1.

    """
    options = _parser().parse(args)
    given = command_line.given(options, NODES, NAMES)
    values = command_line.checked(given, FKM_SETTINGS)
    check = None
    if options.record:
        check = _record(options.recording, given, values, options.poses)
    elif options.output is not None:
        raise InputError(
            f'--output {options.output} without --record: expected both, as the file has the '
            'serial numbers of the drives'
        )
    parts = read(options.recording)
    failed: list[str] = []
    check_wiring(parts, failed)
    gravity = check_weight(parts, values, failed)
    check_friction(parts, values, gravity, options, failed)
    for text in failed:
        print(f'not as expected: {text}')
    if not failed:
        print(f'all of it holds; springs of {options.stiffness:g} N m/rad are passive')
    if failed:
        return 1
    if check is not None and options.output is not None:
        check.write(options.output)
        print(f'{options.output}: torque for these drives, by drives.check_file')
    return 0


def _record(
    path: Path,
    given: Values,
    values: dict[str, Any],
    poses: int,
) -> PassedCheck:
    """
    Move the device through the bring-up, and write the recording.

    Parameters
    ----------
    path : Path
        Recording to write.
    given : Values
        Given parameters, by name.
    values : dict
        Checked parameters of fkm.
    poses : int
        Number of poses that a hand chooses.

    Returns
    -------
    PassedCheck
        Check with the serial numbers of the drives.

    Raises
    ------
    InputError
        There is no device, or the bring-up had to end.

    """
    kind = str(given.get('source', 'can'))
    if kind != 'can':
        raise InputError(f"source = '{kind}' with --record: expected can, a device's encoders")
    drives = make_unchecked_drives(
        command_line.checked(given, (*nodes.DRIVE_SETTINGS, RATE_SETTING))
    )
    if drives is None:
        raise InputError("drives.channel = '' with --record: expected the bus of the drives")
    settings = command_line.checked(given, nodes.SOURCE_SETTINGS[kind], kind)
    print(
        'force_check: the motors turn the handle by some degrees: balance it, and touch it only '
        'when asked',
        file=sys.stderr,
    )
    source = make_source(kind, settings)
    try:
        record(
            path,
            BringUp(
                source=source,
                drives=drives,
                geometry=geometry_from(values),
                working_mode=values['working_mode'],
                sigma=sigma_from(values)[:4],
                silence=settings['can.timeout'],
                show=lambda text: print(f'force_check: {text}', file=sys.stderr),
            ),
            poses,
        )
        return drives.passed_check(time.strftime(DATE, time.gmtime()))
    finally:
        drives.close()
        source.close()


def check_wiring(
    parts: list[Part],
    failed: list[str],
) -> None:
    """
    Print what each motor turns, by the steps of a recording.

    Parameters
    ----------
    parts : list of Part
        Parts of the recording.
    failed : list of str
        Gets what is wrong with signs, node ids and rated torques.

    """
    responses: list[StepResponse] = []
    for part in _of(parts, 'step'):
        motor = ANGLES.index('th' + part.name[1])
        response = step_response(motor, part.torque[:, motor], part.angles)
        print(response.words)
        responses.append(response)
    failed += wiring_faults(responses)


def check_weight(
    parts: list[Part],
    values: Values,
    failed: list[str],
) -> Gravity:
    """
    Print the weight by the poses that motors hold.

    The mean orientation of a pose is the rotation nearest to the mean matrix, by singular value
    decomposition; the moments are fitted to the torques by least squares (`identify_gravity`).

    Parameters
    ----------
    parts : list of Part
        Parts of the recording.
    values : Values
        Checked parameters of fkm.
    failed : list of str
        Gets a residual beyond `LARGEST_RESIDUAL`.

    Returns
    -------
    Gravity
        The weight; none without poses.

    """
    poses = _of(parts, 'pose')
    if not poses:
        return Gravity()
    left, _, right = np.linalg.svd([rotations(part, values).mean(axis=0) for part in poses])
    gravity, residual = identify_gravity(
        R=left @ right,
        motor_torque=[part.torque.mean(axis=0) for part in poses],
        geometry=geometry_from(values),
        working_mode=values['working_mode'],
    )
    handle, links = (
        '[' + ', '.join(f'{value:.4f}' for value in moments) + ']'
        for moments in (gravity.handle, gravity.proximal)
    )
    print(
        f'weight from {len(poses)} poses: handle {handle}, proximal links {links} kg m; '
        f'{1e3 * residual:.1f} mN m not explained'
    )
    if residual > LARGEST_RESIDUAL:
        failed.append(
            f'the weight does not explain {1e3 * residual:.1f} mN m: expected '
            f'{1e3 * LARGEST_RESIDUAL:g} or less'
        )
    return gravity


def check_friction(
    parts: list[Part],
    values: Values,
    gravity: Gravity,
    options: Namespace,
    failed: list[str],
) -> None:
    """
    Print inertia, friction and the stiffest passive spring by direction.

    Parameters
    ----------
    parts : list of Part
        Parts of the recording.
    values : Values
        Checked parameters of fkm.
    gravity : Gravity
        Weight that the motors' torques carry.
    options : Namespace
        The parsed command line: stiffness, damping, rate and latency of the control.
    failed : list of str
        Gets each direction in which the commanded spring is not passive.

    Raises
    ------
    CalibrationError
        The releases do not determine the friction.

    """
    releases: dict[str, list[Release]] = {}
    for part in _of(parts, 'release'):
        releases.setdefault(part.name[1], []).append(release_of(part, values, gravity))
    for direction, each in releases.items():
        found = identify_friction(each)
        stiffest = found.stiffest(options.damping, 1.0 / options.rate, options.latency)
        print(
            f'handle about {direction}: inertia {1e3 * found.inertia:.3f} g m^2, friction '
            f'{1e3 * found.viscous:.2f} mN m s/rad and {1e3 * found.dry:.1f} mN m; largest '
            f'stiffness {stiffest:.2f} N m/rad'
        )
        if options.stiffness > stiffest:
            failed.append(
                f'{options.stiffness:g} N m/rad about {direction}, at {options.rate:g} '
                f'Hz and {1e3 * options.latency:g} ms: expected {stiffest:.2f} or less'
            )


def rotations(part: Part, values: Values) -> Array:
    """
    Return the orientation of each row of a part.

    Parameters
    ----------
    part : Part
        Part of the recording.
    values : Values
        Checked parameters of fkm.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        R_base_platform.

    Raises
    ------
    InputError
        No orientation has the angles of a row.

    """
    found: Array = estimate(
        th1=part.angles[:, :3],
        theta3a=part.angles[:, 3],
        sigma=sigma_from(values)[:4],
        geometry=geometry_from(values),
    ).rotation
    if not np.isfinite(found).all():
        raise InputError(f"part '{' '.join(part.name)}': no orientation has these angles")
    return found


def release_of(
    part: Part,
    values: Values,
    gravity: Gravity,
) -> Release:
    """
    Return the motion of a release about its direction, a column of the first orientation.

    The net torque is that of the motors less the weight and less its mean at rest.

    Parameters
    ----------
    part : Part
        Part of the recording.
    values : Values
        Checked parameters of fkm.
    gravity : Gravity
        Weight of handle and links.

    Returns
    -------
    Release
        Time, s, turn, rad, and net torque, N m, (n,) each.

    """
    R = rotations(part, values)
    axis = R[0, :, DIRECTIONS.index(part.name[1])]
    statics = make_statics(
        geometry=geometry_from(values),
        working_mode=values['working_mode'],
        motors=part.torque.shape[1],
        limits=ForceLimits(),
    )
    weight = Weight(gravity, statics)
    net = []
    for pose, tau in zip(R.reshape(-1, 9), part.torque.tolist(), strict=True):
        statics.place(tuple(pose.tolist()))
        net.append(np.subtract(statics.rendered(tau), weight.torque()))
    torque = net @ axis
    # At rest there is none, but for what the weight leaves.
    torque -= np.mean(torque[:AT_REST])
    return part.time, rotation_vectors(R @ R[0].T) @ axis, torque


def read(path: Path) -> list[Part]:
    """
    Read the parts of a recording.

    Parameters
    ----------
    path : Path
        CSV file with the columns of `force_record`.

    Returns
    -------
    list of Part
        In their order.

    Raises
    ------
    InputError
        The file is not such a recording.

    """
    try:
        with path.open(encoding='utf-8', newline='') as file:
            rows = list(csv.DictReader(file))
        motors = [name for name in TORQUES if rows and name in rows[0]]
        columns = ['time', *ANGLES, *motors]
        groups = [
            (name, np.array([[float(row[column]) for column in columns] for row in group]))
            for name, group in groupby(rows, lambda row: row['part'])
        ]
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise InputError(
            f'{path}: cannot be read as a recording of a bring-up: {type(error).__name__}: {error}'
        ) from error
    if len(motors) < 3:
        raise InputError(f'{path}: torques of {len(motors)} motors: expected {", ".join(TORQUES)}')
    return [_part_of(path, name, numbers, motors) for name, numbers in groups]


def _part_of(
    path: Path,
    name: str,
    numbers: Array,
    motors: list[str],
) -> Part:
    """
    Return a part by its name and rows.

    Parameters
    ----------
    path : Path
        The file, for the error.
    name : str
        Name of the part.
    numbers : ndarray, shape (n, 5 + motors)
        Time, four angles and torques of each row.
    motors : list of str
        Names of the columns of torques.

    Returns
    -------
    Part
        The part.

    Raises
    ------
    InputError
        It has another name, or a number is not finite.

    """
    known = PART.match(name)
    if known is None or known[1] and f'tau{known[1]}' not in motors:
        raise InputError(f"{path}: part '{name}': expected 'step 1a', 'pose 1' or 'release z 1'")
    if not np.isfinite(numbers).all():
        raise InputError(f"{path}: part '{name}': expected finite numbers")
    return Part(
        name=name.split(),
        time=numbers[:, 0],
        angles=numbers[:, 1:5],
        torque=numbers[:, 5:],
    )


def _of(
    parts: list[Part],
    kind: str,
) -> list[Part]:
    """Return the parts of a kind: step, pose or release."""
    return [part for part in parts if part.name[0] == kind]


def _parser() -> Parser:
    """Return the parser of the command line."""
    parser = Parser('force_check', DESCRIPTION)
    parser.add_argument('recording', type=Path, metavar='RECORDING', help='CSV file')
    parser.add_argument(
        '--record',
        action='store_true',
        help='make RECORDING first, by the drives and encoders of the parameters: '
        'steps, releases, and poses that a hand chooses',
    )
    parser.add_argument(
        '--poses',
        type=int,
        default=POSES,
        choices=(0, *range(6, 41)),
        metavar='N',
        help=f'poses of --record, 6 to 40; 0: none, the handle is balanced (default {POSES})',
    )
    parser.add_argument(
        '--output',
        type=Path,
        metavar='FILE.json',
        help='with --record: write the passed check of these drives, for drives.check_file',
    )
    for name, default, words in (
        ('stiffness', 1.0, 'stiffest spring that is commanded, N m/rad'),
        ('damping', ForceLimits().damping, 'damping that the control adds, N m s/rad'),
        ('rate', 1000.0, 'rate of the control, Hz'),
        ('latency', 0.001, 'time from an angle to its torque, s'),
    ):
        parser.add_argument(
            f'--{name}',
            type=positive,
            default=default,
            metavar='X',
            help=f'{words} (default {default:g})',
        )
    return parser
