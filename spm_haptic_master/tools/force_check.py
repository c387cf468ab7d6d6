# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Check a recorded bring-up of force: signs of the motors, weight, friction, stiffness."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import csv
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motor_bring_up import identify_friction, motor_sign, Release
from spm_haptic_master.drives.drives import make_drives
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.force import ForceLimits, Gravity, identify_gravity
from spm_haptic_master.force.gravity import Weight
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.kinematics import estimate, Geometry, jacobian
from spm_haptic_master.parameters.arguments import Parser, positive
from spm_haptic_master.parameters.drives import DRIVE_SETTINGS
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.limits import sigma_from
from spm_haptic_master.parameters.nodes import DRIVER_NAMES, SOURCE_SETTINGS
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.parameters.shared import RATE_SETTING
from spm_haptic_master.simulation.source_factory import make_source
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.force_record import ANGLES, BringUp, record, TORQUES

DESCRIPTION = """\
Checks a recorded bring-up of force: the sign of each motor by a small step, the weight from poses
that motors hold, friction from releases, and with it the stiffest spring that is passive.
RECORDING is a CSV file with the columns part, time (s), th1a, th1b, th1c, th3a (rad), tau1a,
tau1b, tau1c and tau3a of a fourth motor (N m); parts are named 'step 1a', 'pose 1', 'release z 1'.
Exit code 0 if all of it holds, 1 if not."""
# Nodes whose parameters it takes, and the names of these.
NODES = ('encoder_driver', 'fkm')
NAMES = DRIVER_NAMES | {setting.name for setting in (*FKM_SETTINGS, *DRIVE_SETTINGS)}
# Samples at rest with which a release begins.
AT_REST = 5
# Poses of a recording.
POSES = 12
# Largest residual of the weight (N m): more is felt.
LARGEST_RESIDUAL = 2e-3
# Columns of the orientation about which a release turns the handle.
DIRECTIONS = 'xyz'
WORDS = {1: 'right', -1: 'wrong: turn its direction over', 0: 'not seen: its joint did not turn'}


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a recording."""

    name: list[str]  # words of it
    time: NDArray[np.float64]  # (n,), s
    angles: NDArray[np.float64]  # (n, 4), th1A, th1B, th1C, th3A, rad
    torque: NDArray[np.float64]  # (n, motors), N m


class Device:
    """Orientation, torque on the handle and weight of recorded parts."""

    def __init__(self, values: dict[str, Any], motors: int) -> None:
        self.geometry: Geometry = geometry_from(values)
        self.mode, self._sigma = values['working_mode'], sigma_from(values)[:4]
        self._motors = motors
        self.gravity = Gravity()

    def rotations(self, part: Part) -> NDArray[np.float64]:
        """Return R_base_platform of each row, shape (n, 3, 3)."""
        return estimate(part.angles[:, :3], part.angles[:, 3], self._sigma, self.geometry).rotation

    def release(self, part: Part) -> Release:
        """Return time, turn and net torque about the direction of a release."""
        R = self.rotations(part)
        axis = R[0, :, DIRECTIONS.index(part.name[1])]
        # A turn about the fixed axis: the sine and cosine of it are in R_0^T R.
        turned = np.einsum('nij,kj->nik', R, R[0])
        skew = np.stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0],
                         turned[:, 1, 0] - turned[:, 0, 1]], axis=1)
        trace = np.trace(turned, axis1=1, axis2=2)
        G = jacobian(R, self.geometry, self.mode, sensors=4)[:, :self._motors]
        statics = make_statics(self.geometry, self.mode, self._motors, ForceLimits())
        weight, held = Weight(self.gravity, statics), []
        poses: list[Any] = R.reshape(-1, 9).tolist()
        for pose in poses:
            statics.place(pose)
            held.append(weight.torque())
        torque = (np.einsum('nij,ni->nj', G, part.torque) - held) @ axis
        # At rest there is none, but for what the weight leaves.
        torque -= np.mean(torque[:AT_REST])
        return part.time, np.arctan2(skew @ axis, trace - 1.0), torque


def main(args: list[str] | None = None) -> int:
    """Check a recorded bring-up; 1 if something does not hold."""
    return command_line.run('force_check', _run, args)


def _run(args: list[str]) -> int:
    options = _parser().parse(args)
    given = command_line.given(options, NODES, NAMES)
    values = command_line.checked(given, FKM_SETTINGS)
    if options.record:
        _record(options.recording, given, values, options.poses)
    parts = list(read(options.recording))
    device = Device(values, parts[0].torque.shape[1])
    failed: list[str] = []
    check(parts, device, failed.append)
    releases: dict[str, list[Release]] = {}
    for part in _of(parts, 'release'):
        releases.setdefault(part.name[1], []).append(device.release(part))
    for direction, each in releases.items():
        found = identify_friction(each)
        stiffest = found.stiffest(options.damping, 1.0 / options.rate, options.latency)
        print(f'handle about {direction}: inertia {1e3 * found.inertia:.3f} g m^2, friction '
              f'{1e3 * found.viscous:.2f} mN m s/rad and {1e3 * found.dry:.1f} mN m; largest '
              f'stiffness {stiffest:.2f} N m/rad')
        if options.stiffness > stiffest:
            failed.append(f'{options.stiffness:g} N m/rad about {direction}, at {options.rate:g} '
                          f'Hz and {1e3 * options.latency:g} ms: expected {stiffest:.2f} or less')
    for text in failed:
        print(f'not as it has to be: {text}')
    if not failed:
        print(f'all of it holds; springs of {options.stiffness:g} N m/rad are passive')
    return 1 if failed else 0


def _record(path: Path, given: Values, values: dict[str, Any], poses: int) -> None:
    """Move the device, and write the recording."""
    kind = str(given.get('source', 'can'))
    if kind != 'can':
        raise InputError(f"source = '{kind}' with --record: expected can, a device's encoders")
    drives = make_drives(command_line.checked(given, (*DRIVE_SETTINGS, RATE_SETTING)))
    if drives is None:
        raise InputError("drives.channel = '' with --record: expected the bus of the drives")
    settings = command_line.checked(given, SOURCE_SETTINGS[kind], kind)
    print('force_check: the motors turn the handle by some degrees: balance it, and touch it only '
          'when asked', file=sys.stderr, flush=True)
    source = make_source(kind, settings)
    try:
        record(path, source, drives, BringUp(
            drives.motors, geometry_from(values), values['working_mode'],
            sigma_from(values)[:4]), settings['can.timeout'], lambda text: print(
                f'force_check: {text}', file=sys.stderr, flush=True), poses)
    finally:
        drives.close()
        source.close()


def check(parts: list[Part], device: Device, fail: Callable[[str], None]) -> None:
    """Check the signs and the weight; the device gets its gravity."""
    steps, poses = _of(parts, 'step'), _of(parts, 'pose')
    for part in steps:
        motor = ANGLES.index('th' + part.name[1])
        sign = motor_sign(part.torque[:, motor], part.angles[:, motor])
        text = f'motor on th{part.name[1].upper()}: sign {WORDS[sign]}'
        print(text)
        if sign != 1:
            fail(text)
    if poses:
        R = np.stack([device.rotations(part).mean(axis=0) for part in poses])
        left, _, right = np.linalg.svd(R)
        device.gravity, residual = identify_gravity(
            left @ right, [part.torque.mean(axis=0) for part in poses], device.geometry,
            device.mode)
        print(f'weight from {len(poses)} poses: handle {_listed(device.gravity.handle)}, proximal '
              f'links {_listed(device.gravity.proximal)} kg m; {1e3 * residual:.1f} mN m left')
        if residual > LARGEST_RESIDUAL:
            fail(f'the weight leaves {1e3 * residual:.1f} mN m: expected '
                 f'{1e3 * LARGEST_RESIDUAL:g} or less')


def read(path: Path) -> Iterator[Part]:
    """Read the parts of a recording; InputError where it is none."""
    try:
        with path.open(encoding='utf-8', newline='') as file:
            rows = list(csv.DictReader(file))
        motors = [name for name in TORQUES if rows and name in rows[0]]
        for name, group in groupby(rows, lambda row: row['part']):
            words = name.split()
            if not _is_known(words):
                raise InputError(f"{path}: part '{name}': expected 'step 1a', 'pose 1' or "
                                 "'release z 1'")
            numbers = np.array([[float(row[column]) for column in ['time', *ANGLES, *motors]]
                                for row in group])
            yield Part(words, numbers[:, 0], numbers[:, 1:5], numbers[:, 5:])
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f'{path}: cannot be read as a recording of a bring-up: '
                         f'{error!r}') from error
    if len(motors) < 3:
        raise InputError(f'{path}: torques of {len(motors)} motors: expected {", ".join(TORQUES)}')


def _is_known(words: list[str]) -> bool:
    kind, *rest = words or ['']
    return kind == 'pose' or bool(rest) and (
        kind == 'step' and 'th' + rest[0] in ANGLES
        or kind == 'release' and rest[0] in list(DIRECTIONS))


def _of(parts: list[Part], kind: str) -> list[Part]:
    return [part for part in parts if part.name[0] == kind]


def _listed(values: tuple[float, ...]) -> str:
    return '[' + ', '.join(f'{value:.4f}' for value in values) + ']'


def _parser() -> Parser:
    parser = Parser('force_check', DESCRIPTION)
    parser.add_argument('recording', type=Path, metavar='RECORDING', help='CSV file')
    parser.add_argument('--record', action='store_true',
                        help='make RECORDING first, by the drives and encoders of the parameters: '
                        'steps, releases, and poses that a hand chooses')
    parser.add_argument('--poses', type=int, default=POSES, choices=(0, *range(6, 41)),
                        metavar='N', help='poses of --record, 6 to 40; 0: none, the handle is '
                        f'balanced (default {POSES})')
    for name, default, words in (
            ('stiffness', 1.0, 'stiffest spring that is commanded, N m/rad'),
            ('damping', ForceLimits().damping, 'damping that the control adds, N m s/rad'),
            ('rate', 1000.0, 'rate of the control, Hz'),
            ('latency', 0.001, 'time from an angle to its torque, s')):
        parser.add_argument(f'--{name}', type=positive, default=default, metavar='X',
                            help=f'{words} (default {default:g})')
    return parser
