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
from spm_haptic_master.validation.recordings import MARKERS, Track

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
    """
    Orientations R_base_platform at the same times, by motion capture and forward models.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Times by the recording's clock, s.
    capture_time : ndarray, shape (n,)
        Times by the capture's clock, s.
    captured : ndarray, shape (n, 3, 3)
        Orientations by motion capture.
    models : dict of str to ndarray, shape (n, 3, 3)
        Orientations by each forward model; NaN where it
        has no answer.
    alignment : Alignment
        Time offset and frames of the capture.
    left_out : mapping of str to int
        Number of rows of the capture that were left out, by reason.

    """

    time: np.ndarray
    capture_time: np.ndarray
    captured: np.ndarray
    models: dict[str, np.ndarray]
    alignment: Alignment
    left_out: Mapping[str, int]


def compare(
    recorded: Track,
    capture: Track,
    joints: Track | None,
    geometry: kinematics.Geometry,
    azimuths: tuple[float, float],
    mounting: Mounting | None = None,
) -> Comparison:
    """
    Transform capture and models to the same times and the same frame.

    The models are `improved`, the recorded orientations, and `classic`, computed from three joint
    angles, where there are joint angles.

    Parameters
    ----------
    recorded : Track
        Recorded orientations, quaternions of R_base_platform, as mounted.
    capture : Track
        Motion capture: markers or poses of a body.
    joints : Track or None
        Joint angles; None without them.
    geometry : Geometry
        Mechanism for the classic model.
    azimuths : tuple of 2 float
        Azimuths of the markers C and D from the platform's x axis, rad; not used with poses.
    mounting : Mounting or None, optional
        Mounting with which the orientations were recorded; by default none.

    Returns
    -------
    Comparison
        At those of the capture's times at which there is a recorded orientation.

    Raises
    ------
    InputError
        The recordings are not of the same motion, or the capture is not as it should be.

    """
    by_markers = capture.values.shape[-1] == len(MARKERS)
    sifted = capture_rows.sifted_capture(capture)
    quaternions = sifted.track.values
    if by_markers:
        rotations = orientation_of_markers(quaternions, azimuths)
        quaternions = kinematics.quaternion_from_matrix(rotations)
    sifted, quaternions = capture_rows.without_jumps(sifted, quaternions)
    captured_time = sifted.track.time
    aligned = alignment.align(
        recorded.time, recorded.values, captured_time, quaternions, by_markers
    )
    rotations = kinematics.matrix_from_quaternion(quaternions)
    captured = aligned.frame.T @ rotations @ aligned.body.T
    time = aligned.recorded_time(captured_time)
    found = alignment.interpolate(recorded.time, recorded.values, time)
    known = np.isfinite(found[:, 0])
    if joints is not None:
        known &= time >= joints.time[0]
        known &= time <= joints.time[-1]
        if not known.any():
            raise InputError('the joint angles are of another time than the orientations')
    time = time[known]
    captured = captured[known]
    models = {'improved': kinematics.matrix_from_quaternion(found[known])}
    if joints is not None:
        models['classic'] = _mounted_classic(
            joints,
            time,
            found[known][0],
            geometry,
            mounting or Mounting(),
        )
    return Comparison(
        time=time,
        capture_time=captured_time[known],
        captured=captured,
        models=models,
        alignment=aligned,
        left_out=dict(sifted.left_out),
    )


def marker_directions(coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return the axis of the platform and the directions of two markers across it.

    Parameters
    ----------
    coordinates : ndarray, shape (n, 12)
        Coordinates of the markers A, B, C, D.

    Returns
    -------
    axis : ndarray, shape (n, 3)
        Unit vector Z_E, from A to B.
    toward_c, toward_d : ndarray, shape (n, 3)
        Unit vectors from the axis to C and to D.

    Raises
    ------
    InputError
        A and B coincide, or C or D is on the axis.

    """
    points = coordinates.reshape(-1, 4, 3)
    markers = points.swapaxes(0, 1)
    a, b, c, d = markers
    distances = np.linalg.norm(markers - a, axis=2)
    largest = distances.max(axis=0)
    span = float(np.median(largest))
    axis = _unit(b - a, span, 'A and B coincide')
    toward_c = _unit(_across(c - a, axis), span, 'C lies on the axis A-B')
    toward_d = _unit(_across(d - a, axis), span, 'D lies on the axis A-B')
    return axis, toward_c, toward_d


def _across(vectors: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the parts of vectors across unit axes, both of shape (n, 3)."""
    along = np.sum(vectors * axis, axis=1, keepdims=True)
    across: np.ndarray = vectors - along * axis
    return across


def orientation_of_markers(
    coordinates: np.ndarray,
    azimuths: tuple[float, float],
) -> np.ndarray:
    """
    Return the platform's orientation in the frame of the markers' coordinates.

    The self-rotation is the mean by C and D (Fig. 29 of the paper).

    Parameters
    ----------
    coordinates : ndarray, shape (n, 12)
        Coordinates of the markers A, B, C, D.
    azimuths : tuple of 2 float
        Azimuths of C and D about Z_E from the platform's x axis, rad.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Columns are the platform's x, y, z.

    Raises
    ------
    InputError
        The markers do not determine it.

    """
    axis, *toward = marker_directions(coordinates)
    x = np.zeros_like(axis)
    for azimuth, direction in zip(azimuths, toward, strict=True):
        beside = np.cross(axis, direction)
        x += np.cos(azimuth) * direction - np.sin(azimuth) * beside
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(axis, x)
    return np.stack([x, y, axis], axis=2)


def _unit(
    vectors: np.ndarray,
    span: float,
    problem: str,
) -> np.ndarray:
    """Return vectors as unit vectors; InputError for one that is short beside `span`."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not (length > LEAST_DISTANCE * span).all():
        raise InputError(f'markers: {problem}')
    units: np.ndarray = vectors / length
    return units


def _mounted_classic(
    joints: Track,
    time: np.ndarray,
    start: np.ndarray,
    geometry: kinematics.Geometry,
    mounting: Mounting,
) -> np.ndarray:
    """
    Return the classic model's orientations as mounted.

    Each is by the joint angles nearest to its time, and is the assembly mode nearest to the last
    one.

    Parameters
    ----------
    joints : Track
        Joint angles, rad.
    time : ndarray, shape (n,)
        Times, s.
    start : ndarray, shape (4,)
        Recorded quaternion x, y, z, w that the first mode is nearest to.
    geometry : Geometry
        Mechanism.
    mounting : Mounting
        Mounting of base and handle.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        NaN where the angles close no mechanism, or none are within `GAP`.

    """
    next_row = np.searchsorted(joints.time, time)
    after = np.clip(next_row, 1, len(joints.time) - 1)
    since = time - joints.time[after - 1]
    until = joints.time[after] - time
    index = after - (since < until)
    rotations = np.full((len(time), 3, 3), np.nan)
    x, y, z, w = start.tolist()
    unmounted = mounting.unmounted((x, y, z, w))
    last = kinematics.matrix_from_quaternion(unmounted)
    for place, row in enumerate(index):
        distance = joints.time[row] - time[place]
        if abs(distance) > alignment.GAP:
            continue
        try:
            tracked = kinematics.track_mode(joints.values[row, :3], last, geometry)
            last = tracked.rotation
            rotations[place] = last
        except SpmError:
            continue  # no mode, or infinitely many: the classic model has no answer here
    turns = [mounting.base, mounting.handle]
    table, handle = kinematics.matrix_from_quaternion(turns)
    mounted: np.ndarray = table @ rotations @ handle
    return mounted


def zxz_degrees(
    rotations: np.ndarray,
    unwrapped: bool = False,
) -> np.ndarray:
    """
    Return the ZXZ angles of orientations in deg.

    Parameters
    ----------
    rotations : ndarray, shape (n, 3, 3)
        Orientations, NaN where there is none.
    unwrapped : bool, optional
        Whether the angles go on beyond a turn, without jumps.

    Returns
    -------
    ndarray, shape (3, n)
        psi, theta, phi, deg; NaN as in the input.

    """
    known = np.isfinite(rotations).all(axis=(1, 2))
    angles = np.full((3, len(rotations)), np.nan)
    found = np.stack(kinematics.zxz_from_matrix(rotations[known]))
    if unwrapped:
        found = np.unwrap(found, axis=-1)
    angles[:, known] = np.degrees(found)
    return angles


class ErrorRow(NamedTuple):
    """
    Errors of one quantity of one model.

    Attributes
    ----------
    model : str
        Name of the forward model.
    quantity : str
        psi, theta, phi or rotation (the angle of the whole rotation).
    samples : int
        Number of orientations with an answer of the model.
    missing : int
        Number of orientations without one.
    figures_deg : tuple of float
        Mean error; root mean square, 95th percentile and maximum of its size, deg.

    """

    model: str
    quantity: str
    samples: int
    missing: int
    figures_deg: tuple[float, ...]


def error_table(comparison: Comparison) -> list[ErrorRow]:
    """
    Return the models' errors against the capture: psi, theta, phi and the rotation.

    Parameters
    ----------
    comparison : Comparison
        Orientations of capture and models at the same times.

    Returns
    -------
    list of ErrorRow
        Four rows for each model that has an answer.

    """
    captured = kinematics.zxz_from_matrix(comparison.captured)
    table = []
    for model, rotations in comparison.models.items():
        known = np.isfinite(rotations).all(axis=(1, 2))
        if not known.any():
            continue
        angles = kinematics.zxz_from_matrix(rotations[known])
        errors = []
        for angle, truth in zip(angles, captured, strict=True):
            difference = angle - truth[known]
            errors.append(np.angle(np.exp(1j * difference)))
        inverse = comparison.captured[known].swapaxes(1, 2)
        turns = alignment.rotation_vectors(rotations[known] @ inverse)
        errors.append(np.linalg.norm(turns, axis=1))
        for quantity, error in zip((*ANGLES, 'rotation'), errors, strict=True):
            table.append(
                ErrorRow(
                    model=model,
                    quantity=quantity,
                    samples=int(known.sum()),
                    missing=int((~known).sum()),
                    figures_deg=_figures_deg(error),
                )
            )
    return table


def _figures_deg(error: np.ndarray) -> tuple[float, ...]:
    """Return mean, root mean square, 95 % quantile and largest size of errors, rad, in deg."""
    size = np.degrees(np.abs(error))
    mean = np.degrees(error.mean())
    rms = np.sqrt(np.mean(size**2))
    return (
        float(mean),
        float(rms),
        float(np.percentile(size, 95.0)),
        float(size.max()),
    )


def write_error_table(path: Path, table: list[ErrorRow]) -> None:
    """
    Write errors.csv: a row for each quantity of each model, in deg.

    Parameters
    ----------
    path : Path
        The file to write.
    table : list of ErrorRow
        Rows of `error_table`.

    """
    with open(
        path,
        'w',
        newline='',
        encoding='utf-8',
    ) as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(ERROR_COLUMNS)
        for row in table:
            figures = [f'{value:.5f}' for value in row.figures_deg]
            writer.writerow([*row[:-1], *figures])


def write_aligned(path: Path, comparison: Comparison) -> None:
    """
    Write aligned.csv: both clocks' times (s) and the ZXZ angles (deg) of capture and models.

    Parameters
    ----------
    path : Path
        The file to write.
    comparison : Comparison
        Orientations of capture and models at the same times.

    """
    tracks = {'captured': comparison.captured, **comparison.models}
    columns = [comparison.time, comparison.capture_time]
    header = ['time', 'capture_time']
    for name, rotations in tracks.items():
        columns += list(zxz_degrees(rotations))
        header += [f'{name}_{angle}_deg' for angle in ANGLES]
    np.savetxt(
        path,
        np.column_stack(columns),
        fmt='%.6f',
        delimiter=',',
        header=','.join(header),
        comments='',
    )
