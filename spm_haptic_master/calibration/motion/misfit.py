# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a fit leaves that is no white noise: slips, drifts, play, a mechanism of another kind.

Systematic errors change with the pose and not from sample to sample, so that the mean parity of a
piece of the motion keeps them, while its white noise averages out.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.coverage import around_middle, inverse
from spm_haptic_master.calibration.motion.fit import Fit, Normal, normal_equations
from spm_haptic_master.calibration.motion.model import Array, MotionModel
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import zxz_from_matrix
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Length of the pieces of the motion (s).
SLOW_SECONDS = 0.5
# Part of the pieces whose mean parity is covered (percent), and as many of a normal distribution
# (standard deviations).
PERCENT = 99.0
NORMAL_DEVIATIONS = 2.58
# Samples from which the sensors' parts of the parity are taken.
SAMPLES = 500
# Number of pieces of the motion; a slip is sought at the end of each.
PIECES = 60
# Least improvement of the squared parities by a slip (unit 1), and least part of their excess over
# noise that it explains: no slip explains play and unknown harmonics.
LEAST_IMPROVEMENT = 100.0
LEAST_PART = 0.3
# Part of what the best hypothesis explains within which another one is as good (unit 1): slips lie
# within a piece, and near an end of the motion few poses distinguish the sensors.
AS_GOOD = 0.1
# Parity beyond which a sample does not count (unit 1): a spike that passed.
SPIKE = 300.0


def slow_factor(seconds: Array, normal: Normal) -> float:
    """
    Return by how much slow errors exceed the white noise of the fit.

    Parameters
    ----------
    seconds : ndarray, shape (n,)
        Times of the samples, s.
    normal : Normal
        Normal equations of the fit, with the parity of each sample.

    Returns
    -------
    float
        Variance of pieces' mean parities over that of white noise (unit 1); at least 1.

    """
    means, counts = _piece_means(seconds, normal)
    squares = counts[:, None] * means**2
    return max(1.0, float(np.mean(squares)))


def slow_parity(seconds: Array, normal: Normal) -> float:
    """
    Return the part of the parity that is slow: the 99th percentile of pieces, less white noise.

    Parameters
    ----------
    seconds : ndarray, shape (n,)
        Times of the samples, s.
    normal : Normal
        Normal equations of the fit, with the parity of each sample.

    Returns
    -------
    float
        Length of the parity vector, standard deviations of white noise; 0 where noise explains it.

    """
    means, counts = _piece_means(seconds, normal)
    enough = counts > 0.5 * np.median(counts)
    size = np.linalg.norm(means[enough], axis=1)
    white = NORMAL_DEVIATIONS**2 / float(np.median(counts))
    return float(np.sqrt(max(0.0, float(np.percentile(size, PERCENT)) ** 2 - white)))


def unexplained_errors(
    model: MotionModel,
    turned: Array,
    vector: Array,
    normal: Normal,
    slow: float,
) -> Array:
    """
    Return the error of each sensor that alone causes a slow parity.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    vector : ndarray, shape (P,)
        Parameters, rad.
    normal : Normal
        Normal equations of the fit, with the parity of each sample.
    slow : float
        Slow part of the parity, standard deviations of white noise.

    Returns
    -------
    ndarray, shape (N,)
        rad.

    """
    rows = np.flatnonzero(normal.kept)
    rows = rows[:: max(1, len(rows) // SAMPLES)]
    zeros = tuple(range(model.layout.sensors))
    linear = model.linearised(
        turned[rows],
        normal.rotation[rows],
        vector,
        zeros,
    )
    squares = np.sum(linear.derivative**2, axis=1)
    errors: Array = slow / np.sqrt(np.mean(squares, axis=0))
    return errors


def contradiction(
    model: MotionModel,
    turned: Array,
    found: Fit,
) -> float:
    """
    Return by how much halves of the motion contradict each other.

    The motion is halved by the tilt in two directions and by the self-rotation. For each pair of
    halves the difference d of the parameters and the sum S of their covariances give d^T S^-1 d /
    P, which is about 1 or less for noise alone. The octants' normal equations are added to those
    of the halves.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    found : Fit
        Result of the fit.

    Returns
    -------
    float
        Largest of the three figures (unit 1).

    """
    rotation = found.normal.rotation
    columns = np.array(found.columns)
    known = np.isfinite(rotation).all(axis=(1, 2))
    turns = np.full(len(rotation), np.nan)
    turns[known] = around_middle(zxz_from_matrix(rotation[known])[2])
    places = np.column_stack([rotation[:, 0, 2], rotation[:, 1, 2], turns])
    above = places > np.nanmedian(places, axis=0)
    octant = above @ [1, 2, 4]
    parts = {
        each: normal_equations(
            model,
            turned[octant == each],
            rotation[octant == each],
            found.vector,
            found.columns,
            found.normal.limit,
        )
        for each in np.unique(octant).tolist()
    }
    # Each half has half of the prior information.
    weights = 0.5 * model.layout.deviations[columns] ** -2.0
    sizes = []
    for axis in range(3):
        difference = np.zeros(len(columns))
        both = np.zeros((len(columns),) * 2)
        for side, sign in ((0, 1.0), (1, -1.0)):
            half = [part for each, part in parts.items() if each >> axis & 1 == side]
            covariance = inverse(sum(part.matrix for part in half) + np.diag(weights))
            right = sum(part.right for part in half) + weights * found.vector[columns]
            difference += sign * covariance @ right
            both += covariance
        sizes.append(float(difference @ np.linalg.solve(both, difference)))
    return max(sizes) / len(columns)


def _piece_means(
    seconds: Array,
    normal: Normal,
) -> tuple[Array, NDArray[np.intp]]:
    """
    Return the mean parity of each piece of `SLOW_SECONDS`.

    Returns
    -------
    means : ndarray, shape (m, N - 3)
        Mean parities, standard deviations of white noise.
    counts : ndarray of int, shape (m,)
        Number of samples of each piece.

    """
    kept = normal.kept
    numbers = np.floor(seconds[kept] / SLOW_SECONDS)
    _, piece = np.unique(numbers, return_inverse=True)
    counts = np.bincount(piece)
    columns = normal.parity[kept].T
    sums = np.column_stack([np.bincount(piece, column) for column in columns])
    return sums / counts[:, None], counts


def check_slip(
    model: MotionModel,
    turned: Array,
    seconds: Array,
    found: Fit,
) -> None:
    """
    Raise CalibrationError where a slip or a drift explains what a fit leaves; name the sensor.

    A change of a zero after a time is one more parameter, and so is a drift over the motion; what
    it improves follows from the normal equations of the pieces, in which the zeros come first,
    without a further fit (a score test): slope^2 / size, where size is its information after the
    other parameters are eliminated (Schur complement).

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    seconds : ndarray, shape (n,)
        Times of the samples, s.
    found : Fit
        Result of the fit.

    Raises
    ------
    CalibrationError
        An encoder slipped or drifted; its name is given if no other explains it as well.

    """
    slips = _slips(model, turned, found)
    explained = slips.explained
    row, sensor = np.unravel_index(explained.argmax(), explained.shape)
    best = explained[row, sensor]
    if best <= slips.least:
        return
    others = np.delete(explained, sensor, axis=1).max()
    name = 'one of the encoders'
    by = ''
    if others <= max(slips.least, (1.0 - AS_GOOD) * best):
        name = ALL_JOINT_NAMES[sensor]
        by = f' by {degrees(-slips.slope[row, sensor] / slips.size[row, sensor]):+.2f} deg'
    if row == PIECES - 1:
        raise CalibrationError(
            f'{name} drifted{by} during the motion; let it warm up, check its '
            'coupling and move the device again'
        )
    begin = float(np.array_split(seconds, PIECES)[row + 1][0])
    raise CalibrationError(
        f'{name} slipped{by} during the motion, about {begin:.0f} s after '
        'its beginning; fasten the encoder and move the device again'
    )


@dataclass(frozen=True, slots=True)
class _Slips:
    """
    What a change of one zero would improve of a fit.

    The rows are a slip after each piece of the motion but the last, and a drift over all of it.

    Attributes
    ----------
    slope : ndarray, shape (PIECES, N)
        Slope of the cost by such a change, 1/rad.
    size : ndarray, shape (PIECES, N)
        Information on it after the other parameters are eliminated, 1/rad^2.
    least : float
        Improvement that noise alone may make (unit 1).

    """

    slope: Array
    size: Array
    least: float

    @property
    def explained(self) -> Array:
        """Return what each change improves (unit 1): slope^2 / size."""
        # A change that nothing shows explains nothing.
        explained = np.zeros_like(self.slope)
        np.divide(self.slope**2, self.size, out=explained, where=self.size > 0.0)
        return explained


def _slips(
    model: MotionModel,
    turned: Array,
    found: Fit,
) -> _Slips:
    """
    Return what slips and drifts would improve, from the normal equations of pieces.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    found : Fit
        Result of the fit.

    Returns
    -------
    _Slips
        One for each time and sensor.

    """
    rotation = found.normal.rotation
    places = np.array(found.columns)
    weights = model.layout.deviations[places] ** -2.0
    pieces = [
        normal_equations(
            model,
            turned[rows],
            rotation[rows],
            found.vector,
            found.columns,
            SPIKE,
        )
        for rows in np.array_split(np.arange(len(turned)), PIECES)
    ]
    matrices = np.stack([piece.matrix for piece in pieces])
    rights = np.stack([piece.right for piece in pieces])
    right = rights.sum(axis=0) + found.vector[places] * weights
    covariance = inverse(matrices.sum(axis=0) + np.diag(weights))
    # The part of the change that a piece has: after each piece all of it, or more and more. What
    # all pieces share is the zero's own.
    steps = np.tri(PIECES, PIECES - 1, -1).T
    drift = np.arange(PIECES) / PIECES
    shares = np.vstack([steps, drift])
    sensors = model.layout.sensors
    along = np.tensordot(shares, matrices, 1)[:, :, :sensors]
    squared = np.tensordot(shares**2, matrices, 1)
    own = np.diagonal(squared, axis1=1, axis2=2)[:, :sensors]
    eliminated = np.einsum('tpi,pq,tqi->ti', along, covariance, along)
    slope = (shares @ rights)[:, :sensors]
    slope = slope - np.einsum('tpi,p->ti', along, covariance @ right)
    beyond = sum(_beyond_noise(piece) for piece in pieces)
    return _Slips(
        slope=slope,
        size=own - eliminated,
        least=max(LEAST_IMPROVEMENT, LEAST_PART * beyond),
    )


def _beyond_noise(piece: Normal) -> float:
    """Return the sum of squared parities less what noise alone makes of it (unit 1)."""
    parity = piece.parity[piece.kept]
    return float(np.nansum(parity**2)) - parity.size
