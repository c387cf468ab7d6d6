# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Orientations from outside for `calibrate --motion`: poses of a jig, or a motion capture."""

from __future__ import annotations

import argparse
from math import degrees, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.jig import read_still
from spm_haptic_master.calibration.motion.calibration import MotionCalibration
from spm_haptic_master.calibration.motion.outside_reference import Mounted, mounted
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.kinematics import (
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
    zxz_from_matrix,
)
from spm_haptic_master.tools.motion_source import record_pose, wait_for_pose
from spm_haptic_master.validation.alignment import align, interpolate
from spm_haptic_master.validation.recordings import read_capture

# Standard deviation of a jig's pose without --jig-error, and of a capture (deg).
JIG_SIGMA, CAPTURE_SIGMA = 0.1, 0.2
# Length of a recording at a jig's pose (s).
JIG_SECONDS = 5.0
# Time between two captured orientations that are used (s): their errors last about so long.
CAPTURE_PERIOD = 0.25
# Columns of captured orientations.
QUATERNION_COLUMNS = 4
# Least number of captured orientations.
CAPTURED_MINIMUM = 20


def check_references(options: argparse.Namespace, source: str) -> None:
    """Raise InputError for orientations from outside that do not fit together."""
    if options.pose and options.capture is not None:
        raise InputError('--pose and --capture; expected one of the two')
    if source != 'replay' and options.pose_recording:
        raise InputError(f'--pose-recording with source {source!r}; expected it with replay')
    if source == 'replay' and len(options.pose or ()) != len(options.pose_recording or ()):
        raise InputError(f'--pose is given {len(options.pose or ())} times and --pose-recording '
                         f'{len(options.pose_recording or ())} times; expected as many')


def mounted_by(options: argparse.Namespace, source: str, values: dict[str, Any],
               found: MotionCalibration) -> Mounted:
    """Return a calibration with the mounting by a jig's poses or a motion capture."""
    if options.capture is not None:
        turned, outside = _captured(options, found)
        return mounted(found, turned, outside, radians(options.capture_sigma))
    recordings = options.pose_recording or [None] * len(options.pose)
    per_turn = values['encoders.counts_per_turn']
    rows = []
    for number, (pose, recording) in enumerate(zip(options.pose, recordings, strict=True), 1):
        if recording is None:
            wait_for_pose(number, len(options.pose), pose)
        counts = record_pose(
            source, values | ({} if recording is None else {'replay.path': str(recording)}),
            JIG_SECONDS)
        rows.append(read_still(counts, per_turn, radians(options.noise_limit),
                               radians(options.drift_limit))[0])
    return mounted(found, np.array(rows) * TURN / np.array(per_turn) * np.array(found.direction),
                   matrix_from_zxz(*np.radians(options.pose).T),
                   radians(options.jig_error or JIG_SIGMA))


def _captured(options: argparse.Namespace,
              found: MotionCalibration) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return readings by their directions, and captured orientations, at the same times."""
    capture = read_capture(options.capture, options.capture_topic)
    if capture.values.shape[1] != QUATERNION_COLUMNS:
        raise InputError(f'{options.capture}: markers; expected the pose of a body (qx, qy, qz, '
                         'qw), as the motion capture computes it')
    seconds = found.readings.seconds
    known = np.isfinite(found.rotation).all(axis=(1, 2))
    times, quaternions = seconds[known], quaternion_from_matrix(found.rotation[known])
    begin = capture.time - capture.time[0]
    fitted = align(times, quaternions, begin, capture.values, False)
    rows = np.flatnonzero(known)[::max(1, int(CAPTURE_PERIOD / np.median(np.diff(times))))]
    at = interpolate(begin + fitted.offset, capture.values, seconds[rows])
    inside = np.isfinite(at).all(axis=1)
    if inside.sum() < CAPTURED_MINIMUM:
        raise CalibrationError(f'{options.capture}: {int(inside.sum())} orientations at times of '
                               f'the motion; expected at least {CAPTURED_MINIMUM}')
    rows = rows[inside]
    return (found.readings.readings[rows] * np.array(found.direction),
            matrix_from_quaternion(at[inside]))


def mounting_settings(mounting: Mounted | None) -> dict[str, Any]:
    """Return the parameters of a mounting."""
    if mounting is None:
        return {}
    return {f'mounting.{part}_zxz_deg': tuple(
        round(degrees(float(angle)), 6) for angle in zxz_from_matrix(rotation))
        for part, rotation in (('base', mounting.base), ('handle', mounting.handle))
        if part == 'base' or mounting.handle_deviations.any()}


def print_mounting(mounting: Mounted) -> None:
    """Print the mounting that the orientations from outside determined."""
    for name, deviations in (('base', mounting.base_deviations),
                             ('handle', mounting.handle_deviations)):
        if deviations.any():
            print(f'  mounting of the {name}: standard deviations '
                  f'{" ".join(f"{degrees(each):.3f}" for each in deviations)} deg')
    print(f'  left of the orientations from outside: {degrees(mounting.rms):.3f} deg rms')
