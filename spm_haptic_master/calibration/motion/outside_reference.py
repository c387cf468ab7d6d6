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
from spm_haptic_master.calibration.motion.calibration import MotionCalibration
from spm_haptic_master.calibration.motion.coverage import inverse
from spm_haptic_master.calibration.motion.fit import normal_equations
from spm_haptic_master.calibration.motion.model import Array
from spm_haptic_master.exceptions import CalibrationError, GeometryError
from spm_haptic_master.kinematics.rotations import matrix_from_vector
from spm_haptic_master.validation.alignment import constant_frames, rotation_vectors

# Least number of orientations that determine both mountings.
BOTH_MINIMUM = 3
# Steps of the linear least squares: the second one corrects the linearisation of the first.
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
        Result of the motion, fused with the orientations from outside.
    base : ndarray, shape (3, 3)
        R_table_base.
    handle : ndarray, shape (3, 3)
        R_platform_handle.
    base_deviations : ndarray, shape (3,)
        Standard deviations of the base's rotation vector, rad.
    handle_deviations : ndarray, shape (3,)
        The same of the handle; 0 where it was not estimated.
    rms : float
        Residual of the orientations from outside, rad rms.

    """

    calibration: MotionCalibration
    base: Array
    handle: Array
    base_deviations: Array
    handle_deviations: Array
    rms: float


def mounted(
    calibration: MotionCalibration, turned: Array, outside: Array, sigma: float
) -> Mounted:
    """
    Return the calibration fused with orientations from outside, with the mounting.

    Gauss-Newton steps on C = Y R X for parameters, Y and, with `BOTH_MINIMUM` orientations or
    more, X; the covariance of the motion's result is the prior of the parameters.
    `constant_frames` gives the start of X and Y.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of the motion.
    turned : ndarray, shape (k, N)
        Readings at the orientations, times their directions, rad.
    outside : ndarray, shape (k, 3, 3)
        R_table_handle.
    sigma : float
        Standard deviation of these about each axis, rad.

    Returns
    -------
    Mounted
        Calibration and mounting, with standard deviations.

    Raises
    ------
    CalibrationError
        The orientations contradict the motion, or the readings have no orientation.

    """
    model, vector = calibration.model, calibration.vector
    both = len(outside) >= BOTH_MINIMUM
    before = inverse(calibration.covariance)
    base, handle = np.eye(3), np.eye(3)
    for step in range(STEPS):
        try:
            rotation = model.orientations(turned, vector)
        except GeometryError as error:
            raise CalibrationError(
                f'the orientations from outside contradict the motion: {error}'
            ) from error
        if not np.isfinite(rotation).all():
            raise CalibrationError('the readings at a pose from outside have no orientation')
        if step == 0:
            base, handle = constant_frames(outside, rotation, not both)
        carried = base @ rotation
        # Error of C = Y R X, as a rotation vector in the table's frame.
        errors = rotation_vectors(carried @ handle @ outside.swapaxes(1, 2))
        rows = np.concatenate(
            [
                base @ model.orientation_changes(rotation, vector),
                np.broadcast_to(np.eye(3), carried.shape),
                *([carried] if both else []),
            ],
            axis=2,
        )
        flat = rows.reshape(-1, rows.shape[2]) / sigma
        matrix, count = flat.T @ flat, len(vector)
        # The motion's result is the prior of the parameters.
        matrix[:count, :count] += before
        right = flat.T @ errors.ravel() / sigma
        right[:count] += before @ (vector - calibration.vector)
        covariance = inverse(matrix)
        change = -covariance @ right
        vector = vector + change[:count]
        base = matrix_from_vector(change[None, count : count + 3])[0] @ base
        if both:
            handle = matrix_from_vector(change[None, count + 3 :])[0] @ handle
    rotation = model.orientations(turned, vector)
    left = rotation_vectors(base @ rotation @ handle @ outside.swapaxes(1, 2))
    rms = float(np.sqrt(np.mean(left**2)))
    if len(outside) > 1 and rms > CONTRADICTION * sigma:
        raise CalibrationError(
            f'the orientations from outside contradict the motion: their residual is '
            f'{degrees(rms):.3f} deg rms, expected up to {degrees(CONTRADICTION * sigma):.3f} deg'
        )
    deviations = np.sqrt(np.diag(covariance))
    normal = normal_equations(model, calibration.turned, calibration.rotation, vector, ())
    fused = replace(
        calibration, vector=vector, covariance=covariance[:count, :count], rotation=normal.rotation
    )
    return Mounted(
        fused,
        base,
        handle,
        deviations[count : count + 3],
        deviations[count + 3 :] if both else np.zeros(3),
        rms,
    )
