# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum-likelihood orientations of samples in batches, and of single ones as arrays."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
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
from spm_haptic_master.kinematics.estimation.sample_estimates import estimate_sample
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.joints import (
    FEWEST_MOUNTED,
    FEWEST_USED,
    NUMBER_WORDS,
    UsedSensors,
)
from spm_haptic_master.kinematics.number_backends import Array, SLICE
from spm_haptic_master.kinematics.rotations import quaternion_from_matrix, rotation_from_quaternion

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
        healthy sensors. The first is the parity of the first four; each further one is the
        difference of the next sensor from the estimate of those before it.
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


def estimate(
    th1: ArrayLike,
    theta3a: ArrayLike,
    sigma: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
    prior: ArrayLike | None = None,
    theta3b: ArrayLike | None = None,
    theta3c: ArrayLike | None = None,
) -> Estimate:
    """
    Maximum-likelihood orientations from four to six joint sensors.

    The readings determine the working mode of each leg.

    Parameters
    ----------
    th1 : array_like, shape (..., 3)
        Active joints A, B, C, rad.
    theta3a : array_like, shape (...)
        Leg A's second passive joint, rad.
    sigma : float or array_like
        Standard deviations of the N readings th1A, th1B, th1C, th3A, th3B, th3C, rad, from
        `SMALLEST_SIGMA` to `LARGEST_SIGMA`: one for all, or N.
    geometry : Geometry
        Link angles and axes.
    prior : array_like, shape (..., 3, 3), optional
        The last known orientation R_base_platform. It selects among solutions that the readings do
        not contradict, and has no weight in the result.
    theta3b, theta3c : array_like, shape (...), optional
        Second passive joints of the legs B and C, of the fifth and the sixth sensor, rad.

    Returns
    -------
    Estimate
        In a batch, rows of samples that would raise on their own are NaN, and not determined. The
        covariance is of first order: docs/evidence.md states where it holds.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value; a NaN in a batch raises, too.
    SingularityError
        A single sample does not determine the orientation (see `estimate_sample`).
    UnreachableError
        The mechanism does not close near a single sample.

    Notes
    -----
    The parity of four sensors detects a faulty one but does not isolate it; near a parallel
    singularity the active sensors cannot check th3A. With th3B every sensor is checked everywhere;
    with th3C the direction of the parity vector isolates the faulty one.

    """
    check_geometry(geometry)
    active = check_angles('th1', th1, (3,))
    passive = _checked_passive(theta3a, theta3b, theta3c)
    sensors = _all_in_use(_check_sigma(sigma, 3 + len(passive)))
    shapes = [active.shape[:-1], *[angle.shape for angle in passive]]
    last: Array | None = None
    if prior is not None:
        last = quaternion_from_matrix(check_rotations('prior', prior))
        shapes.append(last.shape[:-1])
    # One sample is the usual case: its check would cost as much as all but the estimate.
    names = ['th1', 'theta3a', 'theta3b', 'theta3c'][: 1 + len(passive)]
    batch = check_broadcast(', '.join([*names, 'prior']), *shapes) if any(shapes) else ()
    if not batch:
        readings = (*active.tolist(), *[angle.item() for angle in passive])
        return _estimate_one(readings, sensors, geometry, last)
    angles = (*np.moveaxis(active, -1, 0), *passive)
    columns = [np.broadcast_to(angle, batch) for angle in angles]
    rows = np.stack(columns, axis=-1).reshape(-1, len(angles))
    priors = None
    if last is not None:
        priors = np.broadcast_to(last, (*batch, 4)).reshape(-1, 4)
    result = _estimate_rows(rows, sensors, geometry, priors)
    return Estimate(
        rotation=result.rotation.reshape(*batch, 3, 3),
        covariance=result.covariance.reshape(*batch, 3, 3),
        parity=result.parity.reshape(batch),
        parity_vector=result.parity_vector.reshape(*batch, len(angles) - FEWEST_USED),
        determined=result.determined.reshape(batch),
    )


def _checked_passive(
    theta3a: ArrayLike,
    theta3b: ArrayLike | None,
    theta3c: ArrayLike | None,
) -> list[Array]:
    """Return the given ones of th3A, th3B, th3C as arrays of angles, rad."""
    if theta3b is None and theta3c is not None:
        raise InputError('theta3b = None: expected the fifth sensor, since theta3c is given')
    passive = [check_angles('theta3a', theta3a, ())]
    if theta3b is not None:
        passive.append(check_angles('theta3b', theta3b, ()))
    if theta3c is not None:
        passive.append(check_angles('theta3c', theta3c, ()))
    return passive


def _estimate_rows(
    readings: Array,
    sensors: UsedSensors,
    g: Geometry,
    priors: Array | None,
) -> Estimate:
    """Estimate rows together where Case 2 starts them, and the others one by one."""
    starts = range(0, max(len(readings), 1), SLICE)
    slices = [fit_rows(readings[start : start + SLICE], sensors, g) for start in starts]
    rotations, covariances, vectors = zip(*slices, strict=True)
    rotation = np.concatenate(rotations)
    covariance = np.concatenate(covariances)
    vector = np.concatenate(vectors)
    if sensors.count == FEWEST_MOUNTED:
        parity = vector[:, 0].copy()
    else:
        parity = np.sqrt(np.sum(vector**2, axis=-1))
    result = Estimate(
        rotation=rotation,
        covariance=covariance,
        parity=parity,
        parity_vector=vector,
        determined=np.trace(covariance, axis1=-2, axis2=-1) < DETERMINED_VARIANCE,
    )
    for row in np.flatnonzero(np.isnan(rotation[:, 0, 0])):
        own = tuple(readings[row].tolist())
        prior = None if priors is None else priors[row]
        with suppress(SpmError):
            single = _estimate_one(own, sensors, g, prior)
            # Each attribute of the result has a row for each sample.
            for name in Estimate.__slots__:
                getattr(result, name)[row] = getattr(single, name)
    return result


def _estimate_one(
    readings: tuple[float, ...],
    sensors: UsedSensors,
    g: Geometry,
    prior: Array | None,
) -> Estimate:
    """Estimate one sample; the arrays of the result are views of one."""
    sample = estimate_sample(
        readings, sensors, g, None if prior is None else tuple(prior.tolist())
    )
    numbers = np.array(
        rotation_from_quaternion(*sample.quaternion) + sample.covariance + sample.parity_vector
    )
    matrices = numbers[:18].reshape(2, 3, 3)
    return Estimate(
        rotation=matrices[0],
        covariance=matrices[1],
        parity=cast('Array', np.float64(sample.parity)),
        parity_vector=numbers[18:],
        determined=cast('NDArray[np.bool_]', np.bool_(sample.determined)),
    )


@lru_cache(maxsize=8)
def _all_in_use(sigma: tuple[float, ...]) -> UsedSensors:
    """Return sensors that are all in use, made once: that costs a fifth of an estimate."""
    return UsedSensors(sigma)


def _check_sigma(sigma: ArrayLike, sensors: int) -> tuple[float, ...]:
    """Return the standard deviations of a number of sensors, rad; UsedSensors checks them."""
    if type(sigma) is float:
        # The usual case, at a twentieth of the cost.
        return (sigma,) * sensors
    deviations = check_array('sigma', sigma, ())
    sigmas = deviations.tolist() if deviations.ndim else [deviations.item()] * sensors
    if deviations.ndim > 1 or len(sigmas) != sensors:
        raise InputError(
            f'sigma = {quoted(sigma)}: expected one standard deviation in rad, or '
            f'{NUMBER_WORDS[sensors]}'
        )
    return tuple(sigmas)
