# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parity of samples at given orientations, and how the error of each reading moves it."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan, pi, remainder
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics import Geometry, inverse, jacobian, measured_angles
from spm_haptic_master.kinematics.jacobians import velocity_rows
from spm_haptic_master.kinematics.number_backends import FLOATS, MODE_BOUNDARY, Quaternion
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, wrapped

Array = NDArray[np.float64]
WorkingMode = tuple[int, int, int]


class Parities(NamedTuple):
    """
    Parity of n samples at given orientations.

    Attributes
    ----------
    usable : ndarray of bool, shape (n,)
        Which of them have one; the values of the others are 0. A sample in which a joint has no
        reading has none.
    parity : ndarray, shape (n, N - 3)
        Parity vectors, standard deviations of white noise; their basis is another in each sample.
    gain : ndarray, shape (n, N - 3, N)
        Parity by error of each reading, 1/rad, in the same basis.
    step : ndarray, shape (n, 3)
        Rotation vectors to the maximum-likelihood orientations, base frame, rad.

    """

    usable: NDArray[np.bool_]
    parity: Array
    gain: Array
    step: Array


def parities(angles: Array, rotation: Array, sigma: Array, geometry: Geometry,
             working_mode: WorkingMode) -> Parities:
    """
    Return the parity of samples and its gains.

    Parameters
    ----------
    angles : ndarray, shape (n, N)
        Readings, rad.
    rotation : ndarray, shape (n, 3, 3)
        Orientations near the maximum-likelihood ones; NaN where there is none.
    sigma : ndarray, shape (N,)
        White noise of each reading, rad, 1 standard deviation.
    geometry : Geometry
        Mechanism.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.

    """
    sensors = angles.shape[1]
    known: NDArray[np.bool_] = np.asarray(np.isfinite(rotation).all(axis=(1, 2)))
    matrices = np.where(known[:, None, None], rotation, np.eye(3))
    found = inverse(matrices, geometry, working_mode)
    expected = np.column_stack(
        [found.theta1, found.theta3a, found.theta3b, found.theta3c])[:, :sensors]
    rates = jacobian(matrices, geometry, working_mode, sensors=sensors)
    usable: NDArray[np.bool_] = np.asarray(
        known & np.isfinite(expected).all(axis=1) & np.isfinite(rates).all(axis=(1, 2))
        & np.isfinite(angles).all(axis=1))
    return _projected(usable, wrapped(angles - expected), rates, sigma)


def parity_of_sample(angles: Sequence[float], quaternion: Quaternion[float], sigma: Array,
                     geometry: Geometry, working_mode: WorkingMode) -> Parities:
    """
    Return the parity of one sample in plain floats as far as can be; n is 1.

    Parameters
    ----------
    angles : sequence of N float
        Readings, rad.
    quaternion : tuple of 4 float
        R_base_platform near the maximum-likelihood one, x, y, z, w.
    sigma, geometry, working_mode
        As of `parities`.

    """
    sensors = len(angles)
    rotation = rotation_from_quaternion(*quaternion)
    usable, residual, rates = np.zeros(1, bool), np.zeros((1, sensors)), np.eye(sensors, 3)[None]
    if any(map(isnan, angles)):
        return _projected(usable, residual, rates, sigma)
    try:
        expected = measured_angles(rotation, geometry, working_mode, sensors)
    except UnreachableError:
        return _projected(usable, residual, rates, sigma)
    first_a, first_b, first_c, *_ = expected
    rows, diagonal = velocity_rows(rotation, (first_a, first_b, first_c), geometry, FLOATS)
    if min(map(abs, diagonal[:3])) >= MODE_BOUNDARY:
        usable[0] = True
        residual[0] = [remainder(angle - each, 2.0 * pi)
                       for angle, each in zip(angles, expected, strict=True)]
        rates[0] = [(x / b, y / b, z / b)
                    for (x, y, z), b in zip(rows[:sensors], diagonal, strict=False)]
    return _projected(usable, residual, rates, sigma)


def _projected(usable: NDArray[np.bool_], residual: Array, rates: Array,
               sigma: Array) -> Parities:
    """Return the part of residuals, rad, that no rotation explains, and that which one does."""
    white = residual / sigma
    rates[~usable] = np.eye(*rates.shape[1:])
    white[~usable] = 0.0
    orthogonal, upper = np.linalg.qr(rates / sigma[:, None], mode='complete')
    across = orthogonal[:, :, 3:].swapaxes(1, 2)
    along = orthogonal[:, :, :3].swapaxes(1, 2) @ white[:, :, None]
    step = np.linalg.solve(upper[:, :3], along)[:, :, 0]
    gain = across / sigma
    gain[~usable] = 0.0
    return Parities(usable, (across @ white[:, :, None])[:, :, 0], gain, step)
