# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compares recorded orientations with motion capture: the paper's Figs. 32 to 34, and errors."""

from __future__ import annotations

import math
from pathlib import Path

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.parameters import geometry
from spm_haptic_master.parameters.arguments import finite, Parser
from spm_haptic_master.tools import command_line
from spm_haptic_master.validation import bags, comparison, recordings

DESCRIPTION = """\
Compares recorded orientations of the platform with a motion capture. The capture's clock and frame
need not be those of the recording: the offset in time is found from the angular speeds, the
constant rotation by least squares. Writes the pictures fig32.png to fig34.png of Saafi et al.
(2015), errors.csv and aligned.csv."""
# The parameters of fkm that it takes.
SETTINGS = (*geometry.MECHANISM_SETTINGS, *geometry.MOUNTING_SETTINGS)
# Default azimuths of the markers C and D (deg): if they are opposite each other, a displacement of
# both across the axis cancels in their average.
MARKER_AZIMUTHS = (0.0, 180.0)


@command_line.program('validate')
def main(args: list[str]) -> int:
    """
    Compare recorded orientations with a motion capture.

    RECORDING has the orientations, CAPTURE markers or poses of a body; joint angles, from --joints
    or a rosbag2, give the classic model as well. It writes fig32.png to fig34.png, errors.csv and
    aligned.csv to -o DIR, and prints the errors.

    Parameters
    ----------
    args : list of str
        Command line without the name of the program.

    Returns
    -------
    int
        Exit code: 0. After an error, which is one line on stderr, it is 1.

    """
    options = _parser().parse(args)
    values = command_line.checked(
        command_line.given(options, ('fkm',), {setting.name for setting in SETTINGS}), SETTINGS
    )
    # matplotlib is an extra: report that it is missing before anything is read.
    from spm_haptic_master.validation import plot_style

    recorded = recordings.read_orientation(options.recording, options.topic)
    if options.joints or bags.is_bag(options.recording):
        joints = recordings.read_joints(
            options.joints or options.recording,
            options.joints_topic,
            '--joints-topic',
        )
    else:
        joints = None
    capture = recordings.read_capture(options.capture, options.capture_topic)
    azimuth_c, azimuth_d = map(math.radians, options.marker_azimuths)
    result = comparison.compare(
        recorded,
        capture,
        joints,
        geometry.geometry_from(values),
        (azimuth_c, azimuth_d),
        geometry.mounting_from(values),
    )
    table = comparison.error_table(result)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        comparison.write_error_table(options.output / 'errors.csv', table)
        comparison.write_aligned(options.output / 'aligned.csv', result)
    except OSError as error:
        raise InputError(f'{options.output}: cannot be written: {error}') from error
    plot_style.draw_comparison(result, options.output)
    _report(result, table, options.output)
    if joints is not None and joints.left_out:
        print(f'{joints.left_out} rows with fewer than {len(JOINT_NAMES)} joint angles left out')
    return 0


def _parser() -> Parser:
    """Return the parser of the command line; its epilog describes the files."""
    parser = Parser('validate', DESCRIPTION)
    parser.epilog = recordings.__doc__
    _add_files(parser)
    _add_topics(parser)
    parser.add_argument(
        '--marker-azimuths',
        type=finite,
        nargs=2,
        default=MARKER_AZIMUTHS,
        metavar=('C', 'D'),
        help='azimuths of the markers C and D about Z_E, deg '
        "from the platform's x axis (default {:g} {:g})".format(*MARKER_AZIMUTHS),
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        default=Path('validation'),
        metavar='DIR',
        help='directory for pictures and tables (default: validation)',
    )
    return parser


def _add_files(parser: Parser) -> None:
    """Add the recordings that are compared."""
    parser.add_argument(
        'recording',
        type=Path,
        metavar='RECORDING',
        help='orientations: rosbag2 (directory, .mcap or .db3), directory of recorder, or CSV',
    )
    parser.add_argument(
        'capture',
        type=Path,
        metavar='CAPTURE',
        help='motion capture: markers or pose as CSV, such as ground_truth.csv of '
        'recorder or sim_bus, or rosbag2 with a pose',
    )
    parser.add_argument(
        '--joints',
        type=Path,
        metavar='FILE',
        help='joint angles, for the classic model from the active three '
        '(default: those in RECORDING, if it is a rosbag2 or of recorder)',
    )


def _add_topics(parser: Parser) -> None:
    """Add where the recordings have what is compared."""
    parser.add_argument(
        '--topic',
        default='orientation',
        help='topic of the orientations in a rosbag2 (default: orientation)',
    )
    parser.add_argument(
        '--joints-topic',
        default='measured_js',
        metavar='TOPIC',
        help='topic of the joint angles in a rosbag2 (default: measured_js)',
    )
    parser.add_argument(
        '--capture-topic',
        metavar='TOPIC',
        help='topic of the captured PoseStamped, if CAPTURE is a rosbag2',
    )


def _report(
    result: comparison.Comparison,
    table: list[comparison.ErrorRow],
    output: Path,
) -> None:
    """Print the alignment, what of the capture was left out, and the errors."""
    print(_verdict(result, table))
    alignment = result.alignment
    parts_per_million = 0.0 - 1e6 * alignment.rate
    print(
        f'{len(result.time)} captured orientations; their clock is '
        f'{-alignment.offset:+.6f} s off and runs {parts_per_million:+.0f} ppm fast, angular '
        f'speeds correlate by {alignment.correlation:.3f}'
    )
    for reason, count in result.left_out.items():
        print(f'  {count} captured rows left out: {reason}')
    print(f'{"error, deg":<24}{"mean":>9}{"rms":>9}{"95 %":>9}{"max":>9}{"missing":>9}')
    for row in table:
        print(
            f'{row.model + " " + row.quantity:<24}'
            + ''.join(f'{value:9.4f}' for value in row.figures_deg)
            + f'{row.missing:9d}'
        )
    print(f'{output}: fig32.png, fig33.png, fig34.png, errors.csv, aligned.csv')


def _verdict(
    result: comparison.Comparison,
    table: list[comparison.ErrorRow],
) -> str:
    """
    Return in one line by how much the recorded orientations are off.

    Parameters
    ----------
    result : comparison.Comparison
        Capture and models at the same times.
    table : list of comparison.ErrorRow
        Errors of the models.

    Returns
    -------
    str
        Root mean square and largest error of the whole rotation, deg, and the number of moments.

    """
    (row,) = (row for row in table if (row.model, row.quantity) == ('improved', 'rotation'))
    _, rms, _, largest = row.figures_deg
    left_out = sum(result.left_out.values())
    return (
        f'The recorded orientations are {rms:.3f} deg rms off the motion capture, {largest:.3f} '
        f'deg at most, at {row.samples} moments; captured rows left out: {left_out}'
    )
