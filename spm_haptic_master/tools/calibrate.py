# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds the encoders' zero counts and directions while a jig holds the device in known poses."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import datetime
from math import degrees, radians
from pathlib import Path

import numpy as np
from spm_haptic_master.calibration import calibration_file, jig
from spm_haptic_master.calibration.axis_file import axis_parameters
from spm_haptic_master.calibration.recording import raw_counts
from spm_haptic_master.encoders.decoder_factory import make_harmonics
from spm_haptic_master.exceptions import InputError, UnreachableError
from spm_haptic_master.kinematics import measured_angles, zxz_rotation
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.arguments import finite, Parser, positive
from spm_haptic_master.parameters.encoders import HARMONIC_SETTINGS, sensors_of
from spm_haptic_master.parameters.geometry import geometry_from, MECHANISM_SETTINGS
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.parameters.setting import SENSORS_SETTING, Values
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.tools import (
    calibrate_axis,
    calibrate_motion,
    calibration_verdict,
    command_line,
)
from spm_haptic_master.tools.calibrate_motion import JIG_SECONDS
from spm_haptic_master.tools.motion_source import check_source, record_pose, wait_for_pose

DESCRIPTION = """\
Reads the encoders for some seconds while a static jig holds the device in a known pose, and writes
their zero counts, noise and bias as a parameter file for all nodes (--params-file). One pose
cannot determine a direction: give --pose twice or more often, and calibrate asks for one pose
after the other and verifies the directions of the joints that they move."""
# Default pose of the jig, psi theta phi (deg): the workspace's centre, with a self-rotation far
# from the singularity near 50 deg.
POSE_DEFAULT = (degrees(trajectories.CENTRE_PSI), degrees(trajectories.CENTRE_THETA), 0.0)
# Defaults of the settings that a calibration rests on, by name; None stands for zeros. Its file
# has the values that are others.
KEPT = {each.name: each.default for each in (*MECHANISM_SETTINGS, *HARMONIC_SETTINGS)}
# Bound of each sensor's systematic error after a calibration in a jig (deg), where the error of
# the jig is not given: that of a good jig, of links and of a 14-bit encoder.
BIAS_DEFAULT = 0.05


@command_line.program('calibrate')
def main(args: list[str]) -> int:
    """
    Calibrate, or check a calibration.

    With --insertion or --gripper it calibrates that axis from one end to the other; with --motion
    the encoders from free motion; without any of them the encoders from the poses of a jig
    (--pose). With --check and --motion it writes nothing, and says whether a calibration still
    holds.

    Parameters
    ----------
    args : list of str
        Command line without the name of the program.

    Returns
    -------
    int
        Exit code: 0 if the calibration was written or holds, 1 if a check of an axis finds a
        change. After an error, which is one line on stderr, it is 1.

    """
    options = _parser().parse(args)
    if options.insertion is not None or options.gripper is not None:
        return calibrate_axis.run(options)
    if options.check is not None:
        if options.motion is None:
            raise InputError(f'--check {options.check} without --motion, --insertion or --gripper')
        return calibration_verdict.check(options)
    if options.motion is not None:
        return calibrate_motion.run(options)
    return _calibrate_in_jig(options)


def _calibrate_in_jig(options: argparse.Namespace) -> int:
    """
    Calibrate from known poses of a jig.

    For each --pose it waits for Enter, if there are several, and records --seconds at rest. What
    is not given is as in the file to be overwritten, whose poses help to determine the directions.
    It writes -o FILE and prints zero count, noise, bias and direction of each encoder.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    int
        Exit code 0.

    Raises
    ------
    InputError
        The command line is not as expected, or a pose is out of reach.
    CalibrationError
        The device moved or is noisy, or the poses contradict each other.

    """
    if options.output is None:
        raise InputError('no -o FILE; expected the parameter file to write')
    given = command_line.given(options)
    source = str(given.get('source', 'can'))
    poses = options.pose or [POSE_DEFAULT]
    check_source(source, 'calibrate')
    if source == 'replay' and len(poses) > 1:
        raise InputError(
            f'--pose is given {len(poses)} times; expected once for a recording: run '
            'calibrate again, with --force, for the recording at the next pose'
        )
    calibration_file.check_output(options.output, options.force)
    before = calibration_file.read_calibration(options.output) if options.output.exists() else None
    if before is not None:
        # What is not given is as in the file: a calibration belongs to its mechanism.
        given = {
            name: value
            for name, value in read_parameters(options.output).items()
            if name in KEPT or name == SENSORS_SETTING.name
        } | given
    sensors = sensors_of(given)
    values = command_line.checked(raw_counts(sensors) | given, SOURCE_SETTINGS[source], source)
    mechanism = command_line.checked(given, MECHANISM_SETTINGS)
    harmonics = make_harmonics(values)
    angles = [
        tuple(
            angle if each is None else float(each.readings(angle))
            for angle, each in zip(_joint_angles(pose, mechanism, sensors), harmonics, strict=True)
        )
        for pose in poses
    ]
    counts_per_turn = values['encoders.counts_per_turn']
    if before is not None and before.counts_per_turn != counts_per_turn:
        raise InputError(
            f'{options.output}: it is for {list(before.counts_per_turn)} counts per '
            f'turn, the encoders have {list(counts_per_turn)}'
        )
    stations = []
    for number, (pose, of_pose) in enumerate(zip(poses, angles, strict=True), 1):
        if len(poses) > 1:
            wait_for_pose(number, len(poses), pose)
        counts = record_pose(source, values, options.seconds or JIG_SECONDS)
        means, noise = jig.read_still(
            counts, counts_per_turn, radians(options.noise_limit), radians(options.drift_limit)
        )
        stations.append(
            jig.Station(
                tuple(map(radians, pose)),
                of_pose,
                tuple(means.tolist()),
                tuple(noise.tolist()),
                len(counts),
            )
        )
    bias = (
        [radians(BIAS_DEFAULT)] * sensors
        if options.jig_error is None
        else np.max(
            [
                jig.jig_bias(
                    [*map(radians, pose)],
                    geometry_from(mechanism),
                    mechanism['working_mode'],
                    radians(options.jig_error),
                    sensors,
                )
                for pose in poses
            ],
            axis=0,
        ).tolist()
    )
    calibration = jig.calibrate(
        stations,
        values['encoders.direction'],
        counts_per_turn,
        datetime.now().astimezone().isoformat(timespec='seconds'),
        bias,
        radians(options.tolerance),
        before,
    )
    calibration_file.write_text(
        options.output,
        calibration_file.calibration_text(
            calibration,
            {
                name: value
                for name, value in (values | mechanism).items()
                if name in KEPT and (any(value) if KEPT[name] is None else value != KEPT[name])
            }
            | axis_parameters(options.output),
        ),
    )
    _report(options.output, calibration, replaced=before)
    return 0


def _parser() -> Parser:
    """Return the parser of the command line."""
    parser = Parser('calibrate', DESCRIPTION)
    parser.add_argument(
        '--motion',
        nargs='*',
        type=Path,
        metavar='LOG',
        help="calibrate from free motion: nothing has to be known but the drawing's link angles; "
        'from logs, one or several of the same rig, or from the bus',
    )
    parser.add_argument(
        '--insertion',
        type=finite,
        nargs=2,
        metavar=('FIRST', 'SECOND'),
        help='calibrate the slide: its insertion at the end where the motion begins, and at the '
        'other end, m',
    )
    parser.add_argument(
        '--gripper',
        type=finite,
        nargs=2,
        metavar=('OPEN', 'CLOSED'),
        help='calibrate the gripper, from open to closed: its angles there, deg',
    )
    parser.add_argument(
        '--check',
        type=Path,
        metavar='FILE',
        help='motion: parameter file of a calibration; check by a motion of '
        f'{calibration_verdict.SECONDS_DEFAULT:g} s whether it still holds, and '
        'write nothing',
    )
    parser.add_argument(
        '-o', '--output', type=Path, metavar='FILE', help='parameter file to write'
    )
    parser.add_argument(
        '--pose',
        type=finite,
        nargs=3,
        action='append',
        metavar=('PSI', 'THETA', 'PHI'),
        help='pose of the jig, ZXZ angles in deg (default {:g} {:.4f} {:g}, the '
        "workspace's centre); may be repeated: calibrate then waits for Enter at "
        'each'.format(*POSE_DEFAULT),
    )
    parser.add_argument(
        '--pose-recording',
        type=Path,
        action='append',
        metavar='LOG',
        help='motion from a log: the log of the device at rest at a --pose; as '
        'often as --pose, in its order',
    )
    parser.add_argument(
        '--capture',
        type=Path,
        metavar='FILE',
        help='motion: a motion capture of it, as of validate; gives the mounting',
    )
    parser.add_argument(
        '--capture-topic',
        metavar='TOPIC',
        help='topic of the captured PoseStamped, if --capture is a rosbag2',
    )
    parser.add_argument(
        '--capture-sigma',
        type=positive,
        default=calibrate_motion.CAPTURE_SIGMA,
        metavar='DEG',
        help="standard deviation of the capture's orientations (default %(default)g)",
    )
    parser.add_argument(
        '--jig-error',
        type=positive,
        metavar='DEG',
        help="largest error of the jig's pose: gives bias_deg of each sensor "
        f'(without it {BIAS_DEFAULT:g} each)',
    )
    parser.add_argument(
        '--seconds',
        type=positive,
        metavar='S',
        help=f'length of each recording, s (default {JIG_SECONDS:g}); of a motion '
        f'the longest (default {calibrate_motion.SECONDS_DEFAULT:g})',
    )
    parser.add_argument(
        '--target',
        type=positive,
        default=calibrate_motion.TARGET_DEFAULT,
        metavar='DEG',
        help='motion: predicted error of the orientation at which '
        'the recording ends (default %(default)g)',
    )
    parser.add_argument(
        '--mechanism-tolerance',
        type=positive,
        default=0.5,
        metavar='DEG',
        help='motion: standard deviation of links and axes from the drawing (default %(default)g)',
    )
    parser.add_argument(
        '--harmonic-tolerance',
        type=positive,
        default=0.3,
        metavar='DEG',
        help="motion: standard deviation of the first harmonic's coefficients "
        '(default %(default)g)',
    )
    parser.add_argument(
        '--noise-limit',
        type=positive,
        default=0.1,
        metavar='DEG',
        help='largest noise (1 sigma) of a sensor that is accepted (default 0.1)',
    )
    parser.add_argument(
        '--drift-limit',
        type=positive,
        default=0.05,
        metavar='DEG',
        help='largest motion of a joint that is accepted (default 0.05)',
    )
    parser.add_argument(
        '--tolerance',
        type=positive,
        default=0.1,
        metavar='DEG',
        help='largest difference between the zeros of two poses (default 0.1)',
    )
    parser.add_argument(
        '--force', action='store_true', help='write the file even if it already exists'
    )
    return parser


def _joint_angles(pose: Sequence[float], values: Values, sensors: int) -> tuple[float, ...]:
    """
    Return the angles of the sensors' joints at a pose of the jig.

    Parameters
    ----------
    pose : sequence of float
        psi, theta, phi (ZXZ), deg.
    values : Values
        Checked parameters of the mechanism.
    sensors : int
        Number N of sensors.

    Returns
    -------
    tuple of float
        rad, in the order of ALL_JOINT_NAMES.

    Raises
    ------
    InputError
        The pose is out of reach.

    """
    try:
        return measured_angles(
            zxz_rotation(*map(radians, pose)),
            geometry_from(values),
            values['working_mode'],
            sensors,
        )
    except UnreachableError as error:
        raise InputError(
            f'--pose {" ".join(f"{angle:g}" for angle in pose)}: out of reach of the manipulator'
        ) from error


def _report(path: Path, calibration: jig.Calibration, replaced: jig.Calibration | None) -> None:
    """Print what was written, a line for each encoder, and which directions are not verified."""
    print(
        f'{path}: overwritten (it held the calibration of {replaced.date})'
        if replaced
        else f'{path}: written'
    )
    for index, joint in enumerate(ALL_JOINT_NAMES[: len(calibration.zero_count)]):
        verified = 'verified' if calibration.direction_verified[index] else 'NOT verified'
        print(
            f'  {joint}: zero count {calibration.zero_count[index]}, '
            f'sigma {degrees(calibration.sigma[index]):.4f} deg, '
            f'bias {degrees(calibration.bias[index]):.4f} deg, '
            f'direction {calibration.direction[index]:+d} ({verified})'
        )
    if not all(calibration.direction_verified):
        print(
            'The driver refuses directions that are not verified: move the jig to a second '
            'pose, which\nturns each joint by more than '
            f'{degrees(jig.TRAVEL_MINIMUM):g} deg, and run calibrate --force with that --pose.'
        )
