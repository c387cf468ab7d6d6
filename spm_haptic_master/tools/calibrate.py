# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command line of calibrate: in a jig, by a free motion, of an axis, or a check of these."""

from __future__ import annotations

from pathlib import Path

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.arguments import finite, Parser, positive
from spm_haptic_master.tools import (
    calibrate_axis,
    calibrate_jig,
    calibrate_motion,
    calibration_verdict,
    command_line,
)
from spm_haptic_master.tools.motion_source import POSE_SECONDS

DESCRIPTION = """\
Reads the encoders for some seconds while a static jig holds the device in a known pose, and writes
their zero counts, noise and bias as a parameter file for all nodes (--params-file). One pose
cannot determine a direction: give --pose twice or more often, and calibrate asks for one pose
after the other and verifies the directions of the joints that they move."""


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
    return calibrate_jig.run(options)


def _parser() -> Parser:
    """Return the parser of the command line."""
    parser = Parser('calibrate', DESCRIPTION)
    _add_tasks(parser)
    _add_references(parser)
    _add_recording(parser)
    _add_limits(parser)
    parser.add_argument(
        '--force',
        action='store_true',
        help='write the file even if it already exists',
    )
    return parser


def _add_tasks(parser: Parser) -> None:
    """Add what is calibrated or checked, and the file."""
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
        '-o',
        '--output',
        type=Path,
        metavar='FILE',
        help='parameter file to write',
    )


def _add_references(parser: Parser) -> None:
    """Add the orientations from outside: of a jig, or of a motion capture."""
    parser.add_argument(
        '--pose',
        type=finite,
        nargs=3,
        action='append',
        metavar=('PSI', 'THETA', 'PHI'),
        help='pose of the jig, ZXZ angles in deg (default {:g} {:.4f} {:g}, the '
        "workspace's centre); may be repeated: calibrate then waits for Enter at "
        'each'.format(*calibrate_jig.POSE_DEFAULT),
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
        f'(without it {calibrate_jig.BIAS_DEFAULT:g} each)',
    )


def _add_recording(parser: Parser) -> None:
    """Add how long is recorded, and what a motion has to determine."""
    parser.add_argument(
        '--seconds',
        type=positive,
        metavar='S',
        help=f'length of each recording, s (default {POSE_SECONDS:g}); of a motion '
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


def _add_limits(parser: Parser) -> None:
    """Add what is accepted of a device at rest in a jig."""
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
