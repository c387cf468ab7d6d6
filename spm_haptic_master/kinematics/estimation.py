# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum-likelihood orientations from three to six joint sensors, in batches."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from spm_haptic_master.exceptions import InputError, SpmError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.batch_estimation import estimate_slice
from spm_haptic_master.kinematics.checks import (
    check_angles,
    check_array,
    check_broadcast,
    check_rotations,
)
from spm_haptic_master.kinematics.gauss_newton import CONVERGED_STEP
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.number_backends import Array, SLICE
from spm_haptic_master.kinematics.quoting import quoted
from spm_haptic_master.kinematics.rotations import quaternion_from_matrix, rotation_from_quaternion
from spm_haptic_master.kinematics.sample_estimate import CONSISTENT_PARITY, DETERMINED_DEVIATION
from spm_haptic_master.kinematics.sample_estimation import estimate_sample

# Smallest and largest standard deviation of a sensor (rad): a resolution of 32 bits a turn, and
# more than a reading has that says nothing.
SMALLEST_SIGMA, LARGEST_SIGMA = 1e-9, math.pi

# Names of the arguments that broadcast together, with four, five and six sensors.
BROADCAST = ('th1, theta3a, prior', 'th1, theta3a, theta3b, prior',
             'th1, theta3a, theta3b, theta3c, prior')


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
        Signed residual of four sensors over its standard deviation (unit 1); unit variance for
        healthy sensors. The norm of `parity_vector` with more sensors. NaN with three: they
        cannot contradict each other.
    parity_vector : ndarray, shape (..., N - 3)
        Whitened residuals of the N sensors that are there (unit 1): independent, of unit variance
        for healthy sensors. The first is that of the first four; each further one is what the
        next sensor differs by from the estimate of those before it.
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
        """
        Whether the sensors agree and determine the orientation, shape (...).

        The parity is at most `CONSISTENT_PARITY` in size. False with three sensors: nothing checks
        them.
        """
        agree: NDArray[np.bool_] = np.abs(self.parity) <= CONSISTENT_PARITY
        return agree & self.determined


def estimate(th1: ArrayLike, theta3a: ArrayLike, sigma: ArrayLike,
             geometry: Geometry = PAPER_GEOMETRY, prior: ArrayLike | None = None,
             missing: str | None = None, theta3b: ArrayLike | None = None,
             theta3c: ArrayLike | None = None) -> Estimate:
    """
    Maximum-likelihood orientations from four to six joint sensors, or from all but one of them.

    Gauss-Newton starts from the closed form of Case 2. The result reaches the Cramer-Rao bound
    wherever the noise is small compared with the mechanism's curvature. It holds in all eight
    working modes: the readings determine the working mode of each leg.

    The parity of four sensors detects a faulty one in one sample but does not isolate it. Near a
    parallel singularity the three active sensors cannot check th3A. With th3B as well every sensor
    is checked everywhere; with th3C, too, the direction of the parity vector isolates the faulty
    one.

    The covariance is of first order. By simulation (sigma 0.04 deg, 20,000 samples a row), the rms
    error is within 2 % of the stated one with four sensors over the workspace, at the parallel
    singularity too, with noise up to 1 deg, and as near as |B_kk| = 10 sigma to the boundary of a
    working mode. At 3 sigma the rms still is, but one error in a hundred is beyond the limit that
    one in a thousand should exceed; nearer, the estimate may fail. Without th3A, nearer than 4 deg
    to the parallel singularity, samples have no answer (14 % at 2 deg, half at 0.3 deg) and the
    others are biased: do not use that covariance.

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
    missing : {'joint_1a', 'joint_1b', 'joint_1c', 'joint_3a', 'joint_3b', 'joint_3c'}, optional
        Name of a missing sensor; its readings are ignored and may be NaN. Three sensors have
        several solutions and require a prior: the solution reached from it is returned.
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
        A single sample that does not determine the orientation: two solutions explain it equally
        well (the closed form is degenerate) and there is no prior, or a direction is not measured,
        or a leg is on the boundary of its working mode.
    UnreachableError
        A single sample near which the mechanism does not close.

    """
    check_geometry(geometry)
    active, passive = _check_readings(th1, theta3a, theta3b, theta3c, missing)
    sensors = 3 + len(passive)
    deviations = _check_sigma(sigma, sensors)
    shapes = [active.shape[:-1], *[angle.shape for angle in passive]]
    last: Array | None = None
    if prior is not None:
        last = quaternion_from_matrix(check_rotations('prior', prior))
        shapes.append(last.shape[:-1])
    elif missing is not None and sensors == 4:
        raise InputError(f'prior = None: expected an orientation, since {missing} is missing')
    # One sample is the usual case, and its check the dearest part of what is not the estimate.
    batch = check_broadcast(BROADCAST[sensors - 4], *shapes) if any(shapes) else ()
    if not batch:
        return _estimate_one(
            [*active.tolist(), *[angle.item() for angle in passive]], deviations, geometry, last,
            missing)
    readings = np.empty(batch + (sensors,))
    readings[..., :3] = active
    for sensor, angle in enumerate(passive, start=3):
        readings[..., sensor] = angle
    readings = readings.reshape(-1, sensors)
    priors = None if last is None else np.broadcast_to(last, batch + (4,)).reshape(-1, 4)
    if missing is None:
        result, settled = _estimate_batch(readings, deviations, geometry)
    else:
        result, settled = _unknown(len(readings), sensors - 4), np.zeros(len(readings), bool)
    for row in np.flatnonzero(~settled):
        try:
            single = _estimate_one(
                readings[row].tolist(), deviations, geometry,
                None if priors is None else priors[row], missing)
        except SpmError:
            continue
        for name in Estimate.__slots__:
            getattr(result, name)[row] = getattr(single, name)
    return Estimate(*(
        getattr(result, name).reshape(batch + getattr(result, name).shape[1:])
        for name in Estimate.__slots__))


def _estimate_batch(readings: Array, sigma: tuple[float, ...],
                    g: Geometry) -> tuple[Estimate, NDArray[np.bool_]]:
    """Estimate all rows, a slice at a time; return the result and which rows converged."""
    result = _unknown(len(readings), len(sigma) - 3)
    settled = np.zeros(len(readings), bool)
    for start in range(0, len(readings), SLICE):
        rows = slice(start, start + SLICE)
        settled[rows], *values = estimate_slice(readings[rows], sigma, g)
        for name, value in zip(('rotation', 'covariance', 'parity_vector'), values, strict=True):
            target = getattr(result, name)[rows]
            target[settled[rows]] = value[settled[rows]]
    result.parity[:] = result.parity_vector[:, 0] if len(sigma) == 4 else (
        np.sqrt(np.sum(result.parity_vector ** 2, axis=-1)))
    result.determined[settled] = _determined(result.covariance[settled])
    return result, settled


def _determined(covariance: Array) -> NDArray[np.bool_]:
    """Whether the total deviation of covariances (n, 3, 3) is below the limit."""
    determined: NDArray[np.bool_] = (
        np.trace(covariance, axis1=-2, axis2=-1) < DETERMINED_DEVIATION ** 2)
    return determined


def _unknown(rows: int, parities: int) -> Estimate:
    """Return an estimate of NaN, not determined, of a number of rows."""
    return Estimate(
        np.full((rows, 3, 3), np.nan), np.full((rows, 3, 3), np.nan), np.full(rows, np.nan),
        np.full((rows, parities), np.nan), np.zeros(rows, bool))


def _estimate_one(readings: list[float], sigma: tuple[float, ...], g: Geometry,
                  prior: Array | None, missing: str | None) -> Estimate:
    """Estimate one sample; its arrays are views of one."""
    th1a, th1b, th1c, th3a, *more = readings
    sample = estimate_sample(
        th1a, th1b, th1c, th3a, sigma, g, None if prior is None else tuple(prior.tolist()),
        missing, None, CONVERGED_STEP, *more)
    numbers = np.array(rotation_from_quaternion(*sample.quaternion) + sample.covariance
                       + sample.parity_vector)
    matrices = numbers[:18].reshape(2, 3, 3)
    return Estimate(
        matrices[0], matrices[1],
        cast('Array', np.float64(math.nan if sample.parity is None else sample.parity)),
        numbers[18:],
        cast('NDArray[np.bool_]', np.bool_(sample.determined)))


def _check_sigma(sigma: ArrayLike, sensors: int) -> tuple[float, ...]:
    """Return the checked standard deviations of a number of sensors, rad."""
    if type(sigma) is float and SMALLEST_SIGMA <= sigma <= LARGEST_SIGMA:
        # The usual case, at a twentieth of the cost.
        return (sigma,) * sensors
    deviations = check_array('sigma', sigma, ())
    each = deviations.tolist() if deviations.ndim else [deviations.item()] * sensors
    if deviations.ndim > 1 or len(each) != sensors or not (
            SMALLEST_SIGMA <= min(each) and max(each) <= LARGEST_SIGMA):
        raise InputError(
            f'sigma = {quoted(sigma)}: expected one standard deviation in rad, or '
            f'{("four", "five", "six")[sensors - 4]}, from {SMALLEST_SIGMA:g} to '
            f'{LARGEST_SIGMA:.6g}')
    return tuple(each)


def _check_readings(th1: ArrayLike, theta3a: ArrayLike, theta3b: ArrayLike | None,
                    theta3c: ArrayLike | None,
                    missing: str | None) -> tuple[Array, list[Array]]:
    """Return th1 and the passive angles, rad, checked; zeros for those of a missing sensor."""
    if theta3b is None and theta3c is not None:
        raise InputError('theta3b = None: expected the fifth sensor, since theta3c is given')
    if missing is not None:
        names = ALL_JOINT_NAMES[:4 + (theta3b is not None) + (theta3c is not None)]
        if not isinstance(missing, str) or missing not in names:
            raise InputError(f'missing = {quoted(missing)}: expected one of {names} or None')
        if missing in names[:3]:
            active = check_array('th1', th1, (3,), finite=False).copy()
            active[..., names.index(missing)] = 0.0
            th1 = active
        elif missing == 'joint_3a':
            theta3a = _zeros_for('theta3a', theta3a)
        elif missing == 'joint_3b':
            theta3b = _zeros_for('theta3b', theta3b)
        else:
            theta3c = _zeros_for('theta3c', theta3c)
    active, passive = check_angles('th1', th1, (3,)), [check_angles('theta3a', theta3a, ())]
    if theta3b is not None:
        passive.append(check_angles('theta3b', theta3b, ()))
    if theta3c is not None:
        passive.append(check_angles('theta3c', theta3c, ()))
    return active, passive


def _zeros_for(name: str, readings: ArrayLike | None) -> Array:
    """Return zeros instead of the readings of a missing sensor."""
    return np.zeros(check_array(name, readings, (), finite=False).shape)
