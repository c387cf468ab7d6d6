# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum-likelihood orientations from four to six joint sensors, in batches."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from spm_haptic_master.exceptions import InputError, quoted, SpmError
from spm_haptic_master.kinematics.checks import (
    check_angles,
    check_array,
    check_broadcast,
    check_rotations,
)
from spm_haptic_master.kinematics.estimation.gauss_newton import DETERMINED_VARIANCE, fit_rows
from spm_haptic_master.kinematics.estimation.sample_estimation import estimate_sample
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.joints import NUMBER_WORDS, UsedSensors
from spm_haptic_master.kinematics.number_backends import Array, SLICE
from spm_haptic_master.kinematics.rotations import (
    quaternion_from_matrix,
    rotation_from_quaternion,
)

# Largest parity of healthy sensors (unit 1): noise alone exceeds it once in 4e11 samples.
CONSISTENT_PARITY = 7.0


@dataclass(frozen=True, slots=True)
class Estimate:
    """
    Maximum-likelihood orientations.

    Attributes
    ----------
    rotation : ndarray, shape (..., 3, 3)
        R_base_platform.
    covariance : ndarray, shape (..., 3, 3)
        Covariance of the rotation error, a rotation vector in the base frame, rad^2; first order.
    parity : ndarray, shape (...)
        Signed residual of four sensors over its standard deviation (unit 1), of unit variance for
        healthy sensors; the norm of `parity_vector` with more.
    parity_vector : ndarray, shape (..., N - 3)
        Whitened residuals of the N sensors (unit 1): independent, of unit variance for
        healthy sensors. The first is that of the first four; each further one is what the next
        sensor differs by from the estimate of those before it.
    determined : ndarray of bool, shape (...)
        Whether the sensors determine the orientation: total deviation below
        `DETERMINED_DEVIATION`. It does not say whether they agree: see `consistent`.

    """

    rotation: Array
    covariance: Array
    parity: Array
    parity_vector: Array
    determined: NDArray[np.bool_]

    @property
    def consistent(self) -> NDArray[np.bool_]:
        """Whether the sensors determine the orientation, and agree to `CONSISTENT_PARITY`."""
        agree: NDArray[np.bool_] = np.abs(self.parity) <= CONSISTENT_PARITY
        return agree & self.determined


def estimate(th1: ArrayLike, theta3a: ArrayLike, sigma: ArrayLike,
             geometry: Geometry = PAPER_GEOMETRY, prior: ArrayLike | None = None,
             theta3b: ArrayLike | None = None, theta3c: ArrayLike | None = None) -> Estimate:
    """
    Maximum-likelihood orientations from four to six joint sensors.

    Gauss-Newton starts from the closed form of Case 2. The result reaches the Cramer-Rao bound
    wherever the noise is small compared with the mechanism's curvature. It holds in all eight
    working modes: the readings determine the working mode of each leg.

    The parity of four sensors detects a faulty one but does not isolate it; near a parallel
    singularity the active sensors cannot check th3A. With th3B every sensor is checked everywhere;
    with th3C, too, the direction of the parity vector isolates the faulty one.

    The covariance is of first order. By simulation the rms error is within 2 % of the stated one
    with four sensors over the workspace, at the parallel singularity too, with noise up to 1 deg,
    and as near as |B_kk| = 10 sigma to the boundary of a working mode; nearer than 3 sigma the
    estimate may fail.

    Parameters
    ----------
    th1 : array_like, shape (..., 3)
        Active joints A, B, C, rad.
    theta3a : array_like, shape (...)
        Leg A's second passive joint, rad.
    sigma : float or array_like of N
        Standard deviation of the readings, rad: one for all, or th1A, th1B, th1C, th3A and, with
        N = 5 or 6 sensors, th3B, th3C; from `SMALLEST_SIGMA` to `LARGEST_SIGMA`.
    geometry : Geometry
        Link angles and axes.
    prior : array_like, shape (..., 3, 3), optional
        Last known orientation. It selects among solutions that the readings do not contradict,
        and has no weight in the result.
    theta3b, theta3c : array_like, shape (...), optional
        Second passive joints of leg B, the fifth sensor, and of leg C, the sixth beside it, rad.

    Returns
    -------
    Estimate
        In a batch, the rows of samples that would raise on their own are NaN, and not determined.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value; a NaN in a batch raises, too.
    SingularityError
        A single sample does not determine the orientation: see `estimate_sample`.
    UnreachableError
        The mechanism does not close near a single sample.

    """
    check_geometry(geometry)
    if theta3b is None and theta3c is not None:
        raise InputError('theta3b = None: expected the fifth sensor, since theta3c is given')
    active = check_angles('th1', th1, (3,))
    names = ['theta3a', 'theta3b', 'theta3c'][:1 + (theta3b is not None) + (theta3c is not None)]
    passive = [check_angles(name, angle, ())
               for name, angle in zip(names, (theta3a, theta3b, theta3c), strict=False)]
    number = 3 + len(passive)
    sensors = UsedSensors(_check_sigma(sigma, number))
    shapes = [active.shape[:-1], *[angle.shape for angle in passive]]
    last: Array | None = None
    if prior is not None:
        last = quaternion_from_matrix(check_rotations('prior', prior))
        shapes.append(last.shape[:-1])
    # One sample is the usual case, and its check the dearest part of what is not the estimate.
    batch = check_broadcast(', '.join(['th1', *names, 'prior']), *shapes) if any(shapes) else ()
    if not batch:
        readings = (*active.tolist(), *[angle.item() for angle in passive])
        return _estimate_one(readings, sensors, geometry, last)
    rows = np.stack([np.broadcast_to(angle, batch) for angle in (
        *np.moveaxis(active, -1, 0), *passive)], axis=-1).reshape(-1, number)
    priors = None if last is None else np.broadcast_to(last, batch + (4,)).reshape(-1, 4)
    result = _estimate_rows(rows, sensors, geometry, priors)
    return Estimate(*(
        getattr(result, name).reshape(batch + getattr(result, name).shape[1:])
        for name in Estimate.__slots__))


def _estimate_rows(readings: Array, sensors: UsedSensors, g: Geometry,
                   priors: Array | None) -> Estimate:
    """Estimate rows together where Case 2 starts them, and the others one by one."""
    rotation, covariance, vector = map(np.concatenate, zip(*(
        fit_rows(readings[start:start + SLICE], sensors, g)
        for start in range(0, max(len(readings), 1), SLICE)), strict=True))
    parity = vector[:, 0].copy() if sensors.count == 4 else np.sqrt(np.sum(vector ** 2, axis=-1))
    result = Estimate(rotation, covariance, parity, vector,
                      np.trace(covariance, axis1=-2, axis2=-1) < DETERMINED_VARIANCE)
    for row in np.flatnonzero(np.isnan(rotation[:, 0, 0])):
        with suppress(SpmError):
            single = _estimate_one(tuple(readings[row].tolist()), sensors, g,
                                   None if priors is None else priors[row])
            for name in Estimate.__slots__:
                getattr(result, name)[row] = getattr(single, name)
    return result


def _estimate_one(readings: tuple[float, ...], sensors: UsedSensors, g: Geometry,
                  prior: Array | None) -> Estimate:
    """Estimate one sample; its arrays are views of one."""
    sample = estimate_sample(
        readings, sensors, g, None if prior is None else tuple(prior.tolist()))
    numbers = np.array(rotation_from_quaternion(*sample.quaternion) + sample.covariance
                       + sample.parity_vector)
    matrices = numbers[:18].reshape(2, 3, 3)
    return Estimate(
        matrices[0], matrices[1], cast('Array', np.float64(sample.parity)), numbers[18:],
        cast('NDArray[np.bool_]', np.bool_(sample.determined)))


def _check_sigma(sigma: ArrayLike, sensors: int) -> tuple[float, ...]:
    """Return the standard deviations of a number of sensors, rad; UsedSensors checks them."""
    if type(sigma) is float:
        # The usual case, at a twentieth of the cost.
        return (sigma,) * sensors
    deviations = check_array('sigma', sigma, ())
    each = deviations.tolist() if deviations.ndim else [deviations.item()] * sensors
    if deviations.ndim > 1 or len(each) != sensors:
        raise InputError(f'sigma = {quoted(sigma)}: expected one standard deviation in rad, or '
                         f'{NUMBER_WORDS[sensors]}')
    return tuple(each)
