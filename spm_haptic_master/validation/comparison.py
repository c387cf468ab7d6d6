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
    zxz_from_matrix,
)
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.validation import markers
from spm_haptic_master.validation.alignment import align, Alignment, GAP, interpolate
from spm_haptic_master.validation.recordings import MARKERS, Track


@dataclass(frozen=True, slots=True)
class Comparison:
    """Orientations R_base_platform, (n, 3, 3), at the same times."""

    time: np.ndarray  # by the recording's clock, s, (n,)
    capture_time: np.ndarray  # by the capture's clock, s, (n,)
    captured: np.ndarray  # by motion capture
    models: dict[str, np.ndarray]  # by each forward model; NaN where it has no answer
    alignment: Alignment


def compare(recorded: Track, capture: Track, joints: Track | None, geometry: Geometry,
            azimuths: tuple[float, float], mounting: Mounting | None = None) -> Comparison:
    """
    Transform capture and models to the capture's times with a recorded orientation, and its frame.

    Without joints there is no classic model. `azimuths` are those of the markers C and D, rad;
    `mounting` is the one with which the orientations were recorded. InputError where the
    recordings are not of the same motion.
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
    """
    Return the classic model's orientations as mounted, from a recorded quaternion on.

    From three joint angles, those nearest to each time: the assembly mode nearest to the last
    one; NaN where they close no mechanism, or are not known.
    """
    after = np.clip(np.searchsorted(joints.time, time), 1, len(joints.time) - 1)
    index = after - (time - joints.time[after - 1] < joints.time[after] - time)
    rotations = np.full((len(time), 3, 3), np.nan)
    x, y, z, w = start.tolist()
    last = matrix_from_quaternion(mounting.unmounted((x, y, z, w)))
    for place, (row, moment) in enumerate(zip(index, time, strict=True)):
        if abs(joints.time[row] - moment) > GAP:
            continue
        try:
            last = rotations[place] = track_mode(joints.values[row, :3], last, geometry).rotation
        except SpmError:
            continue  # no mode, or infinitely many: the classic model has no answer here
    table, handle = matrix_from_quaternion([mounting.base, mounting.handle])
    return table @ rotations @ handle


def zxz_degrees(rotations: np.ndarray, unwrapped: bool = False) -> np.ndarray:
    """Return psi, theta, phi, deg, (3, n), NaN as in the input; unwrapped: without jumps."""
    known = np.isfinite(rotations[:, 0, 0])
    angles = np.full((3, len(rotations)), np.nan)
    found = zxz_from_matrix(rotations[known])
    angles[:, known] = np.degrees(np.unwrap(found, axis=-1) if unwrapped else found)
    return angles
