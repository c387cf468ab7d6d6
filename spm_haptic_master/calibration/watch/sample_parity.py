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

    A sample without a reading of each joint or without an orientation is not usable: its values
    are 0. The basis of the parity is another in each sample.
    """

    usable: NDArray[np.bool_]  # (n,)
    parity: Array  # (n, N - 3), standard deviations of white noise
    gain: Array  # parity by error of each reading, 1/rad, (n, N - 3, N)
    step: Array  # rotation vectors to the maximum-likelihood orientations, base frame, rad, (n, 3)


def parities(angles: Array, rotation: Array, sigma: Array, geometry: Geometry,
             working_mode: WorkingMode) -> Parities:
    """
    Return the parity of samples, (n, N), rad, at orientations near the maximum-likelihood ones.

    NaN where there is none; `sigma` is the white noise of each reading, rad, (N,).
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
    Return the parity of one sample, n = 1, as `parities` of a quaternion x, y, z, w.

    In plain floats as far as can be: a tenth of the time.
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
