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
from spm_haptic_master.calibration.motion.model import Array, MotionModel
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
    calibration: MotionCalibration,
    turned: Array,
    outside: Array,
    sigma: float,
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
    both = len(outside) >= BOTH_MINIMUM
    prior = inverse(calibration.covariance)
    rotation = _orientations(calibration.model, turned, calibration.vector)
    base, handle = constant_frames(outside, rotation, not both)
    now = _Frames(
        vector=calibration.vector,
        base=base,
        handle=handle,
    )
    count = len(now.vector)
    for _ in range(STEPS):
        rotation = _orientations(calibration.model, turned, now.vector)
        errors, rows = _linearised(
            calibration.model,
            rotation,
            outside,
            now,
            both,
        )
        flat = rows.reshape(-1, rows.shape[2]) / sigma
        matrix = flat.T @ flat
        right = flat.T @ errors.ravel() / sigma
        # The motion's result is the prior of the parameters.
        matrix[:count, :count] += prior
        right[:count] += prior @ (now.vector - calibration.vector)
        covariance = inverse(matrix)
        now = now.changed(-covariance @ right)
    rotation = calibration.model.orientations(turned, now.vector)
    rms = _residual(rotation, outside, now)
    if rms > CONTRADICTION * sigma:
        raise CalibrationError(
            f'the orientations from outside contradict the motion: their residual is '
            f'{degrees(rms):.3f} deg rms, expected up to {degrees(CONTRADICTION * sigma):.3f} deg'
        )
    deviations = np.sqrt(np.diag(covariance))
    return Mounted(
        calibration=_fused(calibration, now.vector, covariance[:count, :count]),
        base=now.base,
        handle=now.handle,
        base_deviations=deviations[count : count + 3],
        handle_deviations=deviations[count + 3 :] if both else np.zeros(3),
        rms=rms,
    )


def _fused(
    calibration: MotionCalibration,
    vector: Array,
    covariance: Array,
) -> MotionCalibration:
    """Return a calibration with other parameters and covariance."""
    normal = normal_equations(
        calibration.model,
        calibration.turned,
        calibration.rotation,
        vector,
        (),
    )
    return replace(
        calibration,
        vector=vector,
        covariance=covariance,
        rotation=normal.rotation,
    )


@dataclass(frozen=True, slots=True)
class _Frames:
    """
    Parameters of the mechanism with the mounting: C = base R(vector) handle.

    Attributes
    ----------
    vector : ndarray, shape (P,)
        Parameters, rad.
    base : ndarray, shape (3, 3)
        R_table_base.
    handle : ndarray, shape (3, 3)
        R_platform_handle.

    """

    vector: Array
    base: Array
    handle: Array

    def changed(self, change: Array) -> _Frames:
        """Return all three after changes, rad: of the vector, the base and perhaps the handle."""
        count = len(self.vector)
        base = matrix_from_vector(change[None, count : count + 3])[0]
        handle = self.handle
        if len(change) > count + 3:
            handle = matrix_from_vector(change[None, count + 3 :])[0] @ handle
        return _Frames(
            vector=self.vector + change[:count],
            base=base @ self.base,
            handle=handle,
        )


def _orientations(
    model: MotionModel,
    turned: Array,
    vector: Array,
) -> Array:
    """Return the platform's orientations at readings; CalibrationError where there are none."""
    try:
        rotation = model.orientations(turned, vector)
    except GeometryError as error:
        raise CalibrationError(
            f'the orientations from outside contradict the motion: {error}'
        ) from error
    if not np.isfinite(rotation).all():
        raise CalibrationError('the readings at a pose from outside have no orientation')
    return rotation


def _linearised(
    model: MotionModel,
    rotation: Array,
    outside: Array,
    now: _Frames,
    both: bool,
) -> tuple[Array, Array]:
    """
    Return the errors of C = Y R X, and how they change with what is estimated.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    rotation : ndarray, shape (k, 3, 3)
        Orientations R of the platform.
    outside : ndarray, shape (k, 3, 3)
        Orientations C from outside.
    now : _Frames
        Parameters and mounting.
    both : bool
        Whether the mounting of the handle is estimated.

    Returns
    -------
    errors : ndarray, shape (k, 3)
        Rotation vectors in the table's frame, rad.
    rows : ndarray, shape (k, 3, columns)
        Changes by parameters, base and perhaps handle.

    """
    carried = now.base @ rotation
    errors = rotation_vectors(carried @ now.handle @ outside.swapaxes(1, 2))
    columns = [
        now.base @ model.orientation_changes(rotation, now.vector),
        np.broadcast_to(np.eye(3), carried.shape),
    ]
    if both:
        columns.append(carried)
    return errors, np.concatenate(columns, axis=2)


def _residual(
    rotation: Array,
    outside: Array,
    now: _Frames,
) -> float:
    """Return what is left of the orientations from outside, rad rms."""
    expected = now.base @ rotation @ now.handle
    left = rotation_vectors(expected @ outside.swapaxes(1, 2))
    return float(np.sqrt(np.mean(left**2)))
