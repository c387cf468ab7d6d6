# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Orientations from outside, of a jig or a motion capture: mounting, and further measurements.

A motion alone does not determine how the base is mounted on its table, nor the handle on the
platform. Each orientation C from outside does: C = Y R X with the orientation R of the platform,
the mounting Y of the base and X of the handle. Together with the result of the motion and its
covariance, these are linear least squares: with many of them, X, Y and the mechanism, with one or
two of them Y alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import degrees

import numpy as np
from spm_haptic_master.calibration.motion.calibration import MotionCalibration, over_region
from spm_haptic_master.calibration.motion.coverage import (
    aligned_changes,
    inverse,
    orientation_error,
)
from spm_haptic_master.calibration.motion.fit import normal_equations
from spm_haptic_master.calibration.motion.mechanism_parameters import Array
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.exceptions import CalibrationError, GeometryError
from spm_haptic_master.kinematics.rotations import matrix_from_vector
from spm_haptic_master.validation.alignment import constant_frames, rotation_vectors

# Least number of orientations that determine both mountings.
BOTH_MINIMUM = 3
# Steps of the linear least squares: the second one corrects what the first linearised.
STEPS = 3
# Deviation of the orientations from outside beyond which they contradict the motion (standard
# deviations, rms).
CONTRADICTION = 4.0


@dataclass(frozen=True, slots=True)
class Mounted:
    """
    A calibration with its mounting.

    Attributes
    ----------
    calibration : MotionCalibration
        With what the orientations from outside add.
    base, handle : ndarray, shape (3, 3)
        R_table_base and R_platform_handle.
    base_deviations, handle_deviations : ndarray, shape (3,)
        Standard deviations of their rotation vectors, rad; 0 for a handle that was not estimated.
    rms : float
        What is left of the orientations from outside, rad rms.

    """

    calibration: MotionCalibration
    base: Array
    handle: Array
    base_deviations: Array
    handle_deviations: Array
    rms: float


def mounted(calibration: MotionCalibration, model: MotionModel, turned: Array, outside: Array,
            sigma: float) -> Mounted:
    """
    Return the calibration with what orientations from outside add.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of the motion.
    model : MotionModel
        Mechanism with encoders.
    turned : ndarray, shape (k, N)
        Readings by their directions, rad, at the orientations.
    outside : ndarray, shape (k, 3, 3)
        R_table_handle.
    sigma : float
        Standard deviation of these, rad about each axis.

    Raises
    ------
    CalibrationError
        The orientations contradict the motion, or the readings have no orientation.

    """
    try:
        found = _fused(calibration, model, turned, outside, sigma)
    except GeometryError as error:
        raise CalibrationError(
            f'the orientations from outside contradict the motion: {error}') from error
    if len(outside) > 1 and found.rms > CONTRADICTION * sigma:
        raise CalibrationError(
            f'the orientations from outside contradict the motion: {degrees(found.rms):.3f} deg '
            f'rms are left of them, expected up to {degrees(CONTRADICTION * sigma):.3f} deg')
    return found


def _fused(calibration: MotionCalibration, model: MotionModel, turned: Array, outside: Array,
           sigma: float) -> Mounted:
    """Return the least-squares solution; arguments and errors of `mounted`."""
    vector = calibration.vector.copy()
    both = len(outside) >= BOTH_MINIMUM
    before = inverse(calibration.covariance)
    base, handle = np.eye(3), np.eye(3)
    for step in range(STEPS):
        rotation = model.orientations(turned, vector)
        if not np.isfinite(rotation).all():
            raise CalibrationError('the readings at a pose from outside have no orientation')
        if step == 0:
            base, handle = constant_frames(outside, rotation, not both)
        carried = base @ rotation
        errors = rotation_vectors(carried @ handle @ outside.swapaxes(1, 2))
        blocks = [base @ model.orientation_changes(rotation, vector),
                  np.broadcast_to(np.eye(3), carried.shape)]
        if both:
            blocks.append(carried)
        rows = np.concatenate(blocks, axis=2)
        flat = rows.reshape(-1, rows.shape[2]) / sigma
        matrix = flat.T @ flat
        count = len(vector)
        matrix[:count, :count] += before
        right = flat.T @ errors.ravel() / sigma
        right[:count] += before @ (vector - calibration.vector)
        covariance = inverse(matrix)
        change = -covariance @ right
        vector = vector + change[:count]
        base = matrix_from_vector(change[None, count:count + 3])[0] @ base
        if both:
            handle = matrix_from_vector(change[None, count + 3:])[0] @ handle
    rotation = model.orientations(turned, vector)
    left = rotation_vectors(base @ rotation @ handle @ outside.swapaxes(1, 2))
    rms = float(np.sqrt(np.mean(left ** 2)))
    deviations = np.sqrt(np.diag(covariance))
    return Mounted(_with_vector(calibration, model, vector, covariance[:count, :count]), base,
                   handle, deviations[count:count + 3],
                   deviations[count + 3:] if both else np.zeros(3), rms)


def _with_vector(calibration: MotionCalibration, model: MotionModel, vector: Array,
                 covariance: Array) -> MotionCalibration:
    """Return a calibration with other parameters and what follows from them."""
    turned = calibration.readings.readings * np.array(calibration.direction)
    normal = normal_equations(model, turned, calibration.rotation, vector, ())
    scale = float(np.sqrt(np.mean(model.sigma ** 2)))
    some = np.flatnonzero(normal.kept)[::max(1, int(normal.kept.sum()) // 1000)]
    return over_region(replace(
        calibration, vector=vector, covariance=covariance, rotation=normal.rotation,
        parity=normal.parity[:, 0] * scale,
        error=orientation_error(
            aligned_changes(model, normal.rotation[some], vector), covariance)),
        model, calibration.region)
