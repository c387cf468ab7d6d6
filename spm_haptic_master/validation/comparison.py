# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Forward models and motion capture at the same times and in the same frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from spm_haptic_master.exceptions import InputError, SpmError
from spm_haptic_master.kinematics import (
    Geometry,
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
    track_mode,
)
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.validation import markers
from spm_haptic_master.validation.alignment import align, Alignment, GAP, interpolate
from spm_haptic_master.validation.recordings import MARKERS, Track


@dataclass(frozen=True, slots=True)
class Comparison:
    """
    Orientations at the same times.

    Attributes
    ----------
    time, capture_time : ndarray, shape (n,)
        Times by the recording's clock and by the capture's, s.
    captured : ndarray, shape (n, 3, 3)
        Orientations by motion capture, R_base_platform.
    models : dict of str to ndarray, shape (n, 3, 3)
        Orientations by each forward model; NaN where it has no answer.
    alignment : Alignment
        Alignment of the capture.

    """

    time: np.ndarray
    capture_time: np.ndarray
    captured: np.ndarray
    models: dict[str, np.ndarray]
    alignment: Alignment


def compare(recorded: Track, capture: Track, joints: Track | None, geometry: Geometry,
            azimuths: tuple[float, float], mounting: Mounting | None = None) -> Comparison:
    """
    Transform capture and models to the same times and the same frame.

    Parameters
    ----------
    recorded, capture, joints : Track
        As read by `recordings`; without joints there is no classic model.
    geometry : Geometry
        Mechanism for the classic model.
    azimuths : tuple of two float
        Azimuths of the markers C and D, rad; not used with a captured pose.
    mounting : Mounting, optional
        Mounting with which the orientations were recorded.

    Returns
    -------
    Comparison
        At those of the capture's times at which there is a recorded orientation.

    Raises
    ------
    InputError
        The recordings are not of the same motion.

    """
    by_markers = capture.values.shape[-1] == len(MARKERS)
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
        models['classic'] = _mounted_classic(
            joints, time, found[known][0], geometry, mounting or Mounting())
    return Comparison(time, capture.time[known], captured, models, alignment)


def _mounted_classic(joints: Track, time: np.ndarray, start: np.ndarray, geometry: Geometry,
                     mounting: Mounting) -> np.ndarray:
    """Return the classic model's orientations as mounted, from a recorded quaternion on."""
    x, y, z, w = start.tolist()
    table, handle = matrix_from_quaternion([mounting.base, mounting.handle])
    first = matrix_from_quaternion(mounting.unmounted((x, y, z, w)))
    return table @ classic_orientations(joints, time, first, geometry) @ handle


def classic_orientations(joints: Track, time: np.ndarray, start: np.ndarray,
                         geometry: Geometry) -> np.ndarray:
    """
    Return the classic model's orientations: the assembly mode nearest to the last one.

    Parameters
    ----------
    joints : Track
        Joint angles; the first three are used, from the sample nearest to each time.
    time : ndarray, shape (n,)
        Times, s.
    start : ndarray, shape (3, 3)
        Orientation to begin at, R_base_platform.
    geometry : Geometry
        Link angles and axes.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        R_base_platform; NaN where the three angles close no mechanism, or are not known.

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
