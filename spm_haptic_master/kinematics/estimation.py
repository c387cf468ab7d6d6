# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum-likelihood orientations from four joint sensors, or from three, in batches."""

from __future__ import annotations

from dataclasses import dataclass
import functools
import math
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from spm_haptic_master.exceptions import InputError, SpmError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics.checks import (
    check_angles,
    check_array,
    check_broadcast,
    check_rotations,
)
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    linkage,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.normal_equations import (
    gauss_newton_step,
    in_base_frame,
    inverse_normal,
    linearise,
    parity_of,
    Readings,
    residuals_of,
    weights_of,
)
from spm_haptic_master.kinematics.number_backends import Array, ARRAYS, Batch, SLICE
from spm_haptic_master.kinematics.quoting import quoted
from spm_haptic_master.kinematics.rotations import (
    quaternion_from_matrix,
    rotation_from_quaternion,
    stack_matrix,
)
from spm_haptic_master.kinematics.sample_estimation import (
    CLOSED_FORM_TRUST,
    CONSISTENT_PARITY,
    CONVERGED_STEP,
    DETERMINED_DEVIATION,
    estimate_sample,
    LONGEST_STEP,
    RANK_TOLERANCE,
)

# Smallest and largest standard deviation of a sensor (rad): a resolution of 32 bits a turn, and
# more than a reading has that says nothing.
SMALLEST_SIGMA, LARGEST_SIGMA = 1e-9, math.pi

# Largest number of steps of a slice; rows that need more are done one by one.
BATCH_STEPS = 6


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
        Signed residual of the four sensors over its standard deviation (unit 1); unit variance for
        healthy sensors. NaN with a sensor missing: three sensors cannot contradict each other.
    determined : ndarray of bool, shape (...)
        Whether the sensors determine the orientation: total deviation below
        `DETERMINED_DEVIATION`. It does not say whether they agree: see `consistent`.

    """

    rotation: Array
    covariance: Array
    parity: Array
    determined: NDArray[np.bool_]

    @property
    def consistent(self) -> NDArray[np.bool_]:
        """
        Whether the sensors agree and determine the orientation, shape (...).

        The parity is at most `CONSISTENT_PARITY` in size. False with a sensor missing: nothing
        checks the other three.
        """
        agree: NDArray[np.bool_] = np.abs(self.parity) <= CONSISTENT_PARITY
        return agree & self.determined


def estimate(th1: ArrayLike, theta3a: ArrayLike, sigma: ArrayLike,
             geometry: Geometry = PAPER_GEOMETRY, prior: ArrayLike | None = None,
             missing: str | None = None) -> Estimate:
    """
    Maximum-likelihood orientations from four joint sensors, or from three of them.

    Gauss-Newton starts from the closed form of Case 2. The result reaches the Cramer-Rao bound
    wherever the noise is small compared with the mechanism's curvature. It holds in all eight
    working modes: the readings determine the working mode of each leg.

    The parity of one sample detects a faulty sensor but does not isolate it. Near a parallel
    singularity the three active sensors cannot check th3A.

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
    sigma : float or array_like of four
        Standard deviation of the readings, rad: one for all, or th1A, th1B, th1C, th3A; from
        `SMALLEST_SIGMA` to `LARGEST_SIGMA`.
    geometry : Geometry
        Link angles and axes.
    prior : array_like, shape (..., 3, 3), optional
        Last known orientation. It selects among solutions that the readings do not contradict,
        and has no weight in the result.
    missing : {'joint_1a', 'joint_1b', 'joint_1c', 'joint_3a'}, optional
        Name of a missing sensor; its readings are ignored and may be NaN. Three sensors have
        several solutions and require a prior: the solution reached from it is returned.

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
    deviations = _check_sigma(sigma)
    active, passive = _check_readings(th1, theta3a, missing)
    shapes = [active.shape[:-1], passive.shape]
    last: Array | None = None
    if prior is not None:
        last = quaternion_from_matrix(check_rotations('prior', prior))
        shapes.append(last.shape[:-1])
    elif missing is not None:
        raise InputError(f'prior = None: expected an orientation, since {missing} is missing')
    batch = check_broadcast('th1, theta3a, prior', *shapes)
    if not batch:
        th1a, th1b, th1c = active.tolist()
        return _estimate_one(
            (th1a, th1b, th1c, passive.item()), deviations, geometry, last, missing)
    readings = np.empty(batch + (4,))
    readings[..., :3] = active
    readings[..., 3] = passive
    readings = readings.reshape(-1, 4)
    priors = None if last is None else np.broadcast_to(last, batch + (4,)).reshape(-1, 4)
    if missing is None:
        result, settled = _estimate_batch(readings, deviations, geometry)
    else:
        result, settled = _unknown(len(readings)), np.zeros(len(readings), bool)
    for row in np.flatnonzero(~settled):
        try:
            single = _estimate_one(
                tuple(readings[row].tolist()), deviations, geometry,
                None if priors is None else priors[row], missing)
        except SpmError:
            continue
        for name in Estimate.__slots__:
            getattr(result, name)[row] = getattr(single, name)
    return Estimate(*(
        getattr(result, name).reshape(batch + getattr(result, name).shape[1:])
        for name in Estimate.__slots__))


def _estimate_batch(readings: Array, sigma: tuple[float, float, float, float],
                    g: Geometry) -> tuple[Estimate, NDArray[np.bool_]]:
    """Estimate all rows, a slice at a time; return the result and which rows converged."""
    result, settled = _unknown(len(readings)), np.zeros(len(readings), bool)
    for start in range(0, len(readings), SLICE):
        rows = slice(start, start + SLICE)
        settled[rows], *values = _estimate_slice(readings[rows], sigma, g)
        for name, value in zip(('rotation', 'covariance', 'parity'), values, strict=True):
            target = getattr(result, name)[rows]
            target[settled[rows]] = value[settled[rows]]
    result.determined[settled] = _determined(result.covariance[settled])
    return result, settled


def _estimate_slice(readings: Array, sigma: tuple[float, float, float, float],
                    g: Geometry) -> tuple[NDArray[np.bool_], Array, Array, Array]:
    """Return of rows together: which converged; of these rotation, covariance and parity."""
    columns: Readings[Batch] = tuple(np.ascontiguousarray(readings.T))
    weights = weights_of(sigma)
    th1a, th1b, th1c, th3a = columns
    view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
    th2a = np.arctan2(sine * determinant, cosine * determinant)
    trusted = np.abs(determinant) > CLOSED_FORM_TRUST * max(sigma)
    # Rows that are not trusted may diverge here; they are done one by one afterwards.
    with np.errstate(all='ignore'):
        for _ in range(BATCH_STEPS):
            state = th1a, th2a, th3a, th1b, th1c
            legs = linearise(th2a, *view, weights, g, ARRAYS)
            residuals = residuals_of(state, columns, legs)
            entries, determinant, product = inverse_normal(legs, weights)
            step = gauss_newton_step(residuals, legs, weights, entries, determinant)
            th1a, th2a, th3a, th1b, th1c = (
                angle + along for angle, along in zip(state, step, strict=True))
            longest = functools.reduce(np.maximum, map(np.abs, step))
            trusted &= (longest < LONGEST_STEP) & (determinant > RANK_TOLERANCE * product)
            settled = trusted & (longest < CONVERGED_STEP)
            if np.array_equal(settled, trusted):
                break
            view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
        parity = np.asarray(parity_of(residuals, legs, weights, ARRAYS))
        covariance, _ = in_base_frame(th1a, th2a, entries, determinant, g, ARRAYS)
        quaternion = chain_quaternion(th1a, th2a, th3a, g, ARRAYS)
        rotation = stack_matrix(rotation_from_quaternion(*quaternion))
    return settled, rotation, stack_matrix(covariance), parity


def _determined(covariance: Array) -> NDArray[np.bool_]:
    """Whether the total deviation of covariances (n, 3, 3) is below the limit."""
    determined: NDArray[np.bool_] = (
        np.trace(covariance, axis1=-2, axis2=-1) < DETERMINED_DEVIATION ** 2)
    return determined


def _unknown(rows: int) -> Estimate:
    """Return an estimate of NaN, not determined, of a number of rows."""
    return Estimate(
        np.full((rows, 3, 3), np.nan), np.full((rows, 3, 3), np.nan), np.full(rows, np.nan),
        np.zeros(rows, bool))


def _estimate_one(readings: Readings[float], sigma: tuple[float, float, float, float],
                  g: Geometry, prior: Array | None, missing: str | None) -> Estimate:
    """Estimate one sample; rotation and covariance are views of one array."""
    sample = estimate_sample(
        *readings, sigma, g, None if prior is None else tuple(prior.tolist()), missing)
    numbers = np.array(
        rotation_from_quaternion(*sample.quaternion) + sample.covariance).reshape(2, 3, 3)
    return Estimate(
        numbers[0], numbers[1],
        cast('Array', np.float64(math.nan if sample.parity is None else sample.parity)),
        cast('NDArray[np.bool_]', np.bool_(sample.determined)))


def _check_sigma(sigma: ArrayLike) -> tuple[float, float, float, float]:
    """Return four checked standard deviations, rad."""
    deviations = check_array('sigma', sigma, ())
    four = deviations.tolist() if deviations.ndim else [deviations.item()] * 4
    if deviations.ndim > 1 or len(four) != 4 or not (
            SMALLEST_SIGMA <= min(four) and max(four) <= LARGEST_SIGMA):
        raise InputError(
            f'sigma = {quoted(sigma)}: expected one standard deviation in rad, or four, from '
            f'{SMALLEST_SIGMA:g} to {LARGEST_SIGMA:.6g}')
    sigma_a, sigma_b, sigma_c, sigma_3 = four
    return sigma_a, sigma_b, sigma_c, sigma_3


def _check_readings(th1: ArrayLike, theta3a: ArrayLike,
                    missing: str | None) -> tuple[Array, Array]:
    """Return the checked readings, rad, with zeros for those of a missing sensor."""
    if missing is None:
        return check_angles('th1', th1, (3,)), check_angles('theta3a', theta3a, ())
    if not isinstance(missing, str) or missing not in JOINT_NAMES:
        raise InputError(f'missing = {quoted(missing)}: expected one of {JOINT_NAMES} or None')
    if missing == 'joint_3a':
        readings = check_array('theta3a', theta3a, (), finite=False)
        return check_angles('th1', th1, (3,)), np.zeros(readings.shape)
    active = check_array('th1', th1, (3,), finite=False).copy()
    active[..., JOINT_NAMES.index(missing)] = 0.0
    return check_angles('th1', active, (3,)), check_angles('theta3a', theta3a, ())
