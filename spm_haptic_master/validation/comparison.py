# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Forward models and motion capture at the same times and in the same frame; their errors."""

from __future__ import annotations

from collections.abc import Mapping
import csv
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import InputError, SpmError
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.validation import alignment, capture_rows
from spm_haptic_master.validation.alignment import Alignment
from spm_haptic_master.validation.capture_rows import Sifted
from spm_haptic_master.validation.recordings import MARKERS, ROWS_MINIMUM, Track

# Names of the ZXZ angles in both files.
ANGLES = ('psi', 'theta', 'phi')
# Least distance of A from B, and of C and D from the axis, as a part of the largest distance of
# two markers: below it a direction is only noise.
LEAST_DISTANCE = 0.05
# Header of errors.csv.
ERROR_COLUMNS = (
    'model',
    'quantity',
    'samples',
    'missing',
    'mean_deg',
    'rms_deg',
    'p95_deg',
    'max_deg',
)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Orientations R_base_platform, (n, 3, 3), at the same times."""

    time: np.ndarray  # by the recording's clock, s, (n,)
    capture_time: np.ndarray  # by the capture's clock, s, (n,)
    captured: np.ndarray  # by motion capture
    models: dict[str, np.ndarray]  # by each forward model; NaN where it has no answer
    alignment: Alignment
    left_out: Mapping[str, int]  # rows of the capture, by reason


def compare(
    recorded: Track,
    capture: Track,
    joints: Track | None,
    geometry: kinematics.Geometry,
    azimuths: tuple[float, float],
    mounting: Mounting | None = None,
) -> Comparison:
    """
    Return capture and models in one frame, at the capture's times with a recorded orientation.

    Without joints there is no classic model. `azimuths` are those of the markers C and D, rad;
    `mounting` is that of the recorded orientations. InputError: they are of another motion.
    """
    by_markers = capture.values.shape[-1] == len(MARKERS)
    sifted = capture_rows.sifted_capture(capture)
    values = sifted.track.values
    quaternions = (
        kinematics.quaternion_from_matrix(orientation_of_markers(values, azimuths))
        if by_markers
        else values
    )
    sifted, quaternions = _continuous(sifted, quaternions)
    captured_time = sifted.track.time
    aligned = alignment.align(
        recorded.time, recorded.values, captured_time, quaternions, by_markers
    )
    alignment.check_export(
        aligned, recorded.time, recorded.values, captured_time, quaternions, by_markers
    )
    captured = aligned.frame.T @ kinematics.matrix_from_quaternion(quaternions) @ aligned.body.T
    time = aligned.recorded_time(captured_time)
    found = alignment.interpolate(recorded.time, recorded.values, time)
    known = np.isfinite(found[:, 0])
    if joints is not None:
        known &= (time >= joints.time[0]) & (time <= joints.time[-1])
        if not known.any():
            raise InputError('the joint angles are of another time than the orientations')
    time, captured = time[known], captured[known]
    models = {'improved': kinematics.matrix_from_quaternion(found[known])}
    if joints is not None:
        models['classic'] = _mounted_classic(
            joints, time, found[known][0], geometry, mounting or Mounting()
        )
    return Comparison(time, captured_time[known], captured, models, aligned, dict(sifted.left_out))


def _continuous(sifted: Sifted, quaternions: np.ndarray) -> tuple[Sifted, np.ndarray]:
    """Return a capture and its orientations without those that no hand can give."""
    good = capture_rows.continuous(sifted.track.time, quaternions)
    if good.sum() < ROWS_MINIMUM:
        raise InputError(
            f'{int(good.sum())} captured orientations follow each other as a hand turns a body; '
            f'expected {ROWS_MINIMUM} or more'
        )
    return capture_rows.keep(sifted, good, 'that no hand can give'), quaternions[good]


def marker_directions(coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return the unit vectors, (n, 3), of the axis Z_E and of the projections of C and D across it.

    `coordinates` are those of the markers, (n, 12). InputError where A and B coincide, or C or D
    is on the axis.
    """
    a, b, c, d = markers = coordinates.reshape(-1, 4, 3).swapaxes(0, 1)
    span = float(np.median(np.linalg.norm(markers - a, axis=2).max(axis=0)))
    axis = _unit(b - a, span, 'A and B coincide')
    toward_c, toward_d = (
        _unit(
            beside - np.sum(beside * axis, axis=1, keepdims=True) * axis,
            span,
            f'{name} lies on the axis A-B',
        )
        for name, beside in (('C', c - a), ('D', d - a))
    )
    return axis, toward_c, toward_d


def orientation_of_markers(coordinates: np.ndarray, azimuths: tuple[float, float]) -> np.ndarray:
    """
    Return the platform's orientation in the frame of the coordinates, shape (n, 3, 3).

    The self-rotation is the mean by C and D (Fig. 29), whose azimuths are rad from the x axis.
    """
    axis, *toward = marker_directions(coordinates)
    x = sum(
        np.cos(azimuth) * each - np.sin(azimuth) * np.cross(axis, each)
        for azimuth, each in zip(azimuths, toward, strict=True)
    )
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(axis, x), axis], axis=2)


def _unit(vectors: np.ndarray, span: float, problem: str) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not (length > LEAST_DISTANCE * span).all():
        raise InputError(f'markers: {problem}')
    return vectors / length


def _mounted_classic(
    joints: Track,
    time: np.ndarray,
    start: np.ndarray,
    geometry: kinematics.Geometry,
    mounting: Mounting,
) -> np.ndarray:
    """
    Return the classic model's orientations as mounted, by the joint angles nearest to each time.

    Each is the assembly mode nearest to the last one, the first to a recorded quaternion; NaN
    where the angles close no mechanism, or are not known.
    """
    after = np.clip(np.searchsorted(joints.time, time), 1, len(joints.time) - 1)
    index = after - (time - joints.time[after - 1] < joints.time[after] - time)
    rotations = np.full((len(time), 3, 3), np.nan)
    x, y, z, w = start.tolist()
    last = kinematics.matrix_from_quaternion(mounting.unmounted((x, y, z, w)))
    for place, (row, moment) in enumerate(zip(index, time, strict=True)):
        if abs(joints.time[row] - moment) > alignment.GAP:
            continue
        try:
            last = rotations[place] = kinematics.track_mode(
                joints.values[row, :3], last, geometry
            ).rotation
        except SpmError:
            continue  # no mode, or infinitely many: the classic model has no answer here
    table, handle = kinematics.matrix_from_quaternion([mounting.base, mounting.handle])
    return table @ rotations @ handle


def zxz_degrees(rotations: np.ndarray, unwrapped: bool = False) -> np.ndarray:
    """Return psi, theta, phi, deg, (3, n), NaN as in the input; unwrapped: without jumps."""
    known = np.isfinite(rotations).all(axis=(1, 2))
    angles = np.full((3, len(rotations)), np.nan)
    found = kinematics.zxz_from_matrix(rotations[known])
    angles[:, known] = np.degrees(np.unwrap(found, axis=-1) if unwrapped else found)
    return angles


class ErrorRow(NamedTuple):
    """Errors of one quantity of one model."""

    model: str
    quantity: str  # psi, theta, phi or rotation (the angle of the whole rotation)
    samples: int  # orientations with an answer of the model
    missing: int  # orientations without one
    figures_deg: tuple[float, ...]  # mean error; rms, 95th percentile and maximum of its size


def error_table(comparison: Comparison) -> list[ErrorRow]:
    """Return the models' errors against the capture: psi, theta, phi and the rotation."""
    captured = kinematics.zxz_from_matrix(comparison.captured)
    table = []
    for model, rotations in comparison.models.items():
        known = np.isfinite(rotations).all(axis=(1, 2))
        if not known.any():
            continue
        errors = [
            np.angle(np.exp(1j * (angle - truth[known])))
            for angle, truth in zip(
                kinematics.zxz_from_matrix(rotations[known]), captured, strict=True
            )
        ]
        errors.append(
            np.linalg.norm(
                alignment.rotation_vectors(
                    rotations[known] @ comparison.captured[known].swapaxes(1, 2)
                ),
                axis=1,
            )
        )
        for quantity, error in zip((*ANGLES, 'rotation'), errors, strict=True):
            size = np.degrees(np.abs(error))
            table.append(
                ErrorRow(
                    model,
                    quantity,
                    int(known.sum()),
                    int((~known).sum()),
                    (
                        float(np.degrees(error.mean())),
                        float(np.sqrt(np.mean(size**2))),
                        float(np.percentile(size, 95.0)),
                        float(size.max()),
                    ),
                )
            )
    return table


def write_error_table(path: Path, table: list[ErrorRow]) -> None:
    """Write errors.csv."""
    with open(path, 'w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(ERROR_COLUMNS)
        for row in table:
            writer.writerow([*row[:-1], *(f'{value:.5f}' for value in row.figures_deg)])


def write_aligned(path: Path, comparison: Comparison) -> None:
    """Write aligned.csv: both clocks' times (s) and the ZXZ angles (deg) of capture and models."""
    tracks = {'captured': comparison.captured, **comparison.models}
    columns = [
        comparison.time,
        comparison.capture_time,
        *(column for rotations in tracks.values() for column in zxz_degrees(rotations)),
    ]
    header = [
        'time',
        'capture_time',
        *(f'{name}_{angle}_deg' for name in tracks for angle in ANGLES),
    ]
    np.savetxt(
        path,
        np.column_stack(columns),
        fmt='%.6f',
        delimiter=',',
        header=','.join(header),
        comments='',
    )
