# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Holds recorded orientations against motion capture: the paper's Figs. 32 to 34, and errors."""

from __future__ import annotations

import argparse
import csv
from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np

from spm_haptic_master.exceptions import InputError, SpmError
from spm_haptic_master.kinematics import (
    Geometry,
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
    track_mode,
    zxz_from_matrix,
)
from spm_haptic_master.tools import command_line
from spm_haptic_master.validation import markers, recordings
from spm_haptic_master.validation.alignment import (
    align,
    Alignment,
    GAP,
    interpolate,
    rotation_vectors,
)

DESCRIPTION = """\
Compares recorded orientations of the platform with a motion capture. The capture's clock and frame
need not be those of the recording: the offset in time is found from the angular speeds, the
constant rotation by least squares. Writes the pictures fig32.png to fig34.png of Saafi et al.
(2015), errors.csv and aligned.csv."""
ANGLES = ('psi', 'theta', 'phi')
# Opposite each other, a displacement of both across the axis cancels in their average.
MARKER_AZIMUTHS = (0.0, 180.0)  # deg


@dataclass(frozen=True, slots=True)
class Comparison:
    """
    Orientations at the same times.

    Attributes
    ----------
    time, capture_time : ndarray, shape (n,)
        s, by the recording's clock and by the capture's.
    captured : ndarray, shape (n, 3, 3)
        By motion capture, in the base frame.
    models : dict of str to ndarray, shape (n, 3, 3)
        By each forward model; NaN where it gave none.
    alignment : Alignment
        Of the capture.

    """

    time: np.ndarray
    capture_time: np.ndarray
    captured: np.ndarray
    models: dict[str, np.ndarray]
    alignment: Alignment


def main(args: list[str] | None = None) -> int:
    """Validate a recording; 1 where its files are not what they should be."""
    return command_line.run('validate', _run, args)


def _run(args: list[str]) -> int:
    options = _parser().parse_args(args)
    from spm_haptic_master.validation import figures

    recorded = recordings.read_orientation(options.recording, options.topic)
    joints = recordings.read_joints(options.joints or options.recording, options.joints_topic) \
        if options.joints or options.recording.suffix != '.csv' else None
    capture = recordings.read_capture(options.capture, options.capture_topic)
    geometry = Geometry(*map(math.radians, options.geometry))
    comparison = compare(recorded, capture, joints, geometry,
                         tuple(map(math.radians, options.marker_azimuths)))
    table = error_table(comparison)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        _write_errors(options.output / 'errors.csv', table)
        _write_aligned(options.output / 'aligned.csv', comparison)
    except OSError as error:
        raise InputError(f'{options.output}: cannot be written: {error}') from error
    figures.draw(comparison, options.output)
    _tell(comparison, table, options.output)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='validate', description=DESCRIPTION, epilog=recordings.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('recording', type=Path, metavar='RECORDING',
                        help='orientations: rosbag2 (directory or .mcap) or CSV')
    parser.add_argument('capture', type=Path, metavar='CAPTURE',
                        help='motion capture: markers or pose as CSV, or rosbag2 with a pose')
    parser.add_argument('--joints', type=Path, metavar='FILE',
                        help='joint angles, for the classic model from the active three '
                        '(default: those in RECORDING, where it is a rosbag2)')
    parser.add_argument('--topic', default='orientation', help='default: orientation')
    parser.add_argument('--joints-topic', default='measured_js', metavar='TOPIC',
                        help='default: measured_js')
    parser.add_argument('--capture-topic', metavar='TOPIC',
                        help='of the captured PoseStamped, where CAPTURE is a rosbag2')
    parser.add_argument('--marker-azimuths', type=float, nargs=2, default=MARKER_AZIMUTHS,
                        metavar=('C', 'D'), help='where the markers C and D stand about Z_E, deg '
                        "from the platform's x axis (default {:g} {:g})".format(*MARKER_AZIMUTHS))
    parser.add_argument('--geometry', type=float, nargs=3, metavar=('ALPHA', 'BETA', 'GAMMA'),
                        default=[math.degrees(angle) for angle in (
                            Geometry().alpha, Geometry().beta, Geometry().gamma)],
                        help="link angles, deg (default: the paper's)")
    parser.add_argument('-o', '--output', type=Path, default=Path('validation'), metavar='DIR',
                        help='where pictures and tables go (default: validation)')
    return parser


def compare(recorded: recordings.Track, capture: recordings.Track,
            joints: recordings.Track | None, geometry: Geometry,
            azimuths: tuple[float, float]) -> Comparison:
    """
    Bring capture and models to the same times and the same frame.

    Parameters
    ----------
    recorded, capture, joints : Track
        As `recordings` reads them; without joints there is no classic model.
    geometry : Geometry
        For the classic model.
    azimuths : tuple of two float
        Of the markers C and D, rad; not used with a captured pose.

    Returns
    -------
    Comparison
        At those of the capture's times at which there is an orientation.

    Raises
    ------
    InputError
        They do not belong together.

    """
    by_markers = capture.values.shape[-1] == len(recordings.MARKERS)
    quaternions = quaternion_from_matrix(markers.orientation(capture.values, azimuths)) \
        if by_markers else capture.values
    alignment = align(recorded.time, recorded.values, capture.time, quaternions, by_markers)
    if by_markers:
        captured = matrix_from_zxz(
            *markers.self_rotation(capture.values, azimuths, alignment.frame))
    else:
        captured = alignment.captured(matrix_from_quaternion(quaternions))
    time = capture.time + alignment.offset
    found = interpolate(recorded.time, recorded.values, time)
    known = np.isfinite(found[:, 0])
    if joints is not None:
        known &= (time >= joints.time[0]) & (time <= joints.time[-1])
        if not known.any():
            raise InputError('the joint angles are of another time than the orientations')
    time, captured = time[known], captured[known]
    models = {'improved': matrix_from_quaternion(found[known])}
    if joints is not None:
        models['classic'] = classic(joints, time, models['improved'][0], geometry)
    return Comparison(time, capture.time[known], captured, models, alignment)


def classic(joints: recordings.Track, time: np.ndarray, start: np.ndarray,
            geometry: Geometry) -> np.ndarray:
    """
    Return the classic model's orientations: the assembly mode nearest to the last one.

    Parameters
    ----------
    joints : Track
        Joint angles; the first three are used, from the sample next to each time.
    time : ndarray, shape (n,)
        s.
    start : ndarray, shape (3, 3)
        Orientation to begin at.
    geometry : Geometry
        Link angles.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        NaN where the three angles close no mechanism, or are not known.

    """
    after = np.clip(np.searchsorted(joints.time, time), 1, len(joints.time) - 1)
    index = after - (time - joints.time[after - 1] < joints.time[after] - time)
    rotations = np.full((len(time), 3, 3), np.nan)
    for place, (row, moment) in enumerate(zip(index, time, strict=True)):
        if abs(joints.time[row] - moment) > GAP:
            continue
        try:
            start = rotations[place] = track_mode(
                joints.values[row, :3], start, geometry).rotation
        except SpmError:
            continue  # no mode, or infinitely many: the classic model has no answer here
    return rotations


def error_table(comparison: Comparison) -> list[dict[str, object]]:
    """
    Return the models' errors against the capture, a row each of psi, theta, phi and the rotation.

    Returns
    -------
    list of dict
        model, quantity, samples, missing, and in deg: mean, rms, p95 and max of the size.

    """
    captured = zxz_from_matrix(comparison.captured)
    table = []
    for model, rotations in comparison.models.items():
        known = np.isfinite(rotations[:, 0, 0])
        if not known.any():
            continue
        errors = [np.angle(np.exp(1j * (angle - truth[known]))) for angle, truth in zip(
            zxz_from_matrix(rotations[known]), captured, strict=True)]
        errors.append(np.linalg.norm(rotation_vectors(
            rotations[known] @ comparison.captured[known].swapaxes(-1, -2)), axis=-1))
        for quantity, error in zip((*ANGLES, 'rotation'), errors, strict=True):
            size = np.degrees(np.abs(error))
            table.append({
                'model': model, 'quantity': quantity, 'samples': int(known.sum()),
                'missing': int((~known).sum()), 'mean': float(np.degrees(error.mean())),
                'rms': float(np.sqrt(np.mean(size**2))), 'p95': float(np.percentile(size, 95.0)),
                'max': float(size.max())})
    return table


def _write_errors(path: Path, table: list[dict[str, object]]) -> None:
    names = {name: f'{name}_deg' if name in ('mean', 'rms', 'p95', 'max') else name
             for name in table[0]}
    with open(path, 'w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(names.values())
        writer.writerows([f'{value:.5f}' if isinstance(value, float) else value
                          for value in row.values()] for row in table)


def _write_aligned(path: Path, comparison: Comparison) -> None:
    tracks = {'captured': comparison.captured, **comparison.models}
    columns = [comparison.time, comparison.capture_time]
    for rotations in tracks.values():
        known = np.isfinite(rotations[:, 0, 0])
        angles = np.full((3, len(rotations)), np.nan)
        angles[:, known] = np.degrees(zxz_from_matrix(rotations[known]))
        columns += list(angles)
    header = ['time', 'capture_time',
              *(f'{name}_{angle}_deg' for name in tracks for angle in ANGLES)]
    np.savetxt(path, np.column_stack(columns), fmt='%.6f', delimiter=',',
               header=','.join(header), comments='')


def _tell(comparison: Comparison, table: list[dict[str, object]], output: Path) -> None:
    alignment = comparison.alignment
    print(f'{len(comparison.time)} captured orientations; their clock is '
          f'{-alignment.offset:+.6f} s off, angular speeds correlate by '
          f'{alignment.correlation:.3f}')
    print(f'{"error, deg":<24}{"mean":>9}{"rms":>9}{"95 %":>9}{"max":>9}{"missing":>9}')
    for row in table:
        print(f'{row["model"] + " " + row["quantity"]:<24}{row["mean"]:9.4f}{row["rms"]:9.4f}'
              f'{row["p95"]:9.4f}{row["max"]:9.4f}{row["missing"]:9d}')
    print(f'{output}: fig32.png, fig33.png, fig34.png, errors.csv, aligned.csv')
