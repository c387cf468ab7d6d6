# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientations: of one sample in plain floats, for the 1 kHz path, and in batches.

Gauss-Newton starts from the closed form of a leg that carries the platform, leg A's Case 2 if it
can be. Where no closed form is to be trusted, the solutions are several, and prior, working mode
and readings select among them.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from math import atan2, sqrt
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from spm_haptic_master.exceptions import (
    AmbiguousError,
    InputError,
    quoted,
    SingularityError,
    SpmError,
    UnreachableError,
)
from spm_haptic_master.kinematics.checks import (
    check_angles,
    check_array,
    check_broadcast,
    check_rotations,
    WorkingMode,
)
from spm_haptic_master.kinematics.closed_form import (
    CLOSED_FORM_TRUST,
    possible_starts,
    start_at,
    trusted_start,
)
from spm_haptic_master.kinematics.estimation.gauss_newton import (
    CONVERGED_STEP,
    DETERMINED_VARIANCE,
    fit,
    fit_rows,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.normal_equations import State
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.joints import (
    FEWEST_MOUNTED,
    FEWEST_USED,
    NUMBER_WORDS,
    UsedSensors,
)
from spm_haptic_master.kinematics.leg_kernels import linkage, turn_of_second_joint
from spm_haptic_master.kinematics.number_backends import Array, FLOATS, Quaternion, SLICE
from spm_haptic_master.kinematics.rotations import (
    quaternion_from_matrix,
    rotation_distance,
    rotation_from_quaternion,
)

# Largest parity of healthy sensors (unit 1): noise alone exceeds it once in 4e11 samples.
CONSISTENT_PARITY = 7.0
# Largest difference of the squared parities of two solutions that explain the readings equally
# well (unit 1): 3 sigma.
AMBIGUOUS_COST = 9.0
# Largest parity of a solution that may be the true one of healthy sensors (unit 1): the noise and
# a nominal bias of the size of the noise.
CONSISTENT = 10.0
# Largest angle between two results of one solution (rad), and between one and that of another
# method or of a single step (its total standard deviation).
SAME_SOLUTION = 1e-4
SAME_DEVIATIONS = 6.0


def estimate_sample(
    readings: tuple[float, ...],
    sensors: UsedSensors,
    geometry: Geometry,
    prior: Quaternion[float] | None = None,
    working_mode: WorkingMode | None = None,
    last_step: float = CONVERGED_STEP,
    consistent: float = CONSISTENT,
) -> SampleEstimate:
    """
    Maximum-likelihood orientation of one sample in plain floats, for the 1 kHz path.

    Nothing is validated.

    Parameters
    ----------
    readings : tuple of float
        Finite numbers of the N mounted sensors th1A, th1B, th1C, th3A, th3B, th3C, rad; a sensor
        that is left out may have NaN.
    sensors : UsedSensors
        Standard deviations, and which sensors are in use.
    geometry : Geometry
        Link angles and axes.
    prior : tuple of four float, optional
        Quaternion x, y, z, w of the last orientation. It selects among solutions with a parity up
        to `consistent`, and has no weight in the result. Three sensors require one; without th3A,
        not within 4 deg of the parallel singularity.
    working_mode : tuple of three int, optional
        Signs of B_kk of the legs A, B, C (eq. 10); by default the readings decide. A leg without a
        sensor in use may have any.
    last_step : float
        Largest last Gauss-Newton step, rad.
    consistent : float
        Largest parity of a solution that the prior may select (unit 1).

    Returns
    -------
    SampleEstimate

    Raises
    ------
    InputError
        Three sensors are in use and there is no prior.
    SingularityError
        Two solutions explain the readings equally well and there is no prior, a direction is not
        measured, or a leg is on the boundary of its working mode or in another one.
    UnreachableError
        The mechanism does not close near the readings.

    """
    if sensors.usual:
        th1a, th1b, th1c, th3a = readings[:4]
        view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
        cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
        if abs(determinant) > CLOSED_FORM_TRUST * sensors.largest:
            th2a = atan2(sine * determinant, cosine * determinant)
            start = th1a, th2a, th3a, th1b, th1c
            return fit(start, view, readings, sensors, geometry, working_mode, last_step)
    return _estimate_others(
        readings, sensors, geometry, prior, working_mode, last_step, consistent
    )


def _estimate_others(
    readings: tuple[float, ...],
    sensors: UsedSensors,
    g: Geometry,
    prior: Quaternion[float] | None,
    working_mode: WorkingMode | None,
    last_step: float,
    consistent: float,
) -> SampleEstimate:
    """Estimate from sensors of which Case 2 gives no start."""
    known, readings = _used_readings(readings, sensors)
    if sensors.count == FEWEST_USED:
        if prior is None:
            raise InputError('prior = None: expected an orientation with three sensors in use')
        start = start_at(rotation_from_quaternion(*prior), known, g)
        return _fit_from(start, readings, sensors, g, working_mode)
    trusted = trusted_start(known, sensors.largest, g)
    if trusted is not None:
        return _fit_from(trusted, readings, sensors, g, working_mode, last_step)
    solutions = _solutions(known, readings, sensors, g, working_mode)
    if not solutions:
        raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')
    return _selected(solutions, readings, prior, consistent)


def other_solutions(
    found: SampleEstimate,
    readings: tuple[float, ...],
    geometry: Geometry,
    working_mode: WorkingMode | None = None,
) -> list[SampleEstimate]:
    """
    Return the solutions of a sample but the one `found`, some of them twice.

    `readings`, of which four at least are in use, and the rest are as of `estimate_sample`; it
    takes as long as tens of estimates.
    """
    known, readings = _used_readings(readings, found.sensors)
    covariance = found.covariance
    near = SAME_DEVIATIONS * sqrt(covariance[0] + covariance[4] + covariance[8])
    return [
        each
        for each in _solutions(known, readings, found.sensors, geometry, working_mode)
        if rotation_distance(each.quaternion, found.quaternion) > near
    ]


def _used_readings(
    readings: tuple[float, ...], sensors: UsedSensors
) -> tuple[tuple[float | None, ...], tuple[float, ...]]:
    """Return six readings, None of a sensor that is not in use, and N, 0 of such a sensor."""
    known = tuple(readings[place] if place in sensors.used else None for place in range(6))
    return known, tuple(each or 0.0 for each in known[: len(readings)])


def _solutions(
    known: tuple[float | None, ...],
    readings: tuple[float, ...],
    sensors: UsedSensors,
    g: Geometry,
    working_mode: WorkingMode | None,
) -> list[SampleEstimate]:
    """Return every orientation near which readings fit, some of them twice."""
    solutions = []
    for start in possible_starts(known, g):
        with suppress(SingularityError, UnreachableError):
            solutions.append(_fit_from(start, readings, sensors, g, working_mode))
    return solutions


def _fit_from(
    start: State[float],
    readings: tuple[float, ...],
    sensors: UsedSensors,
    g: Geometry,
    working_mode: WorkingMode | None,
    last_step: float = CONVERGED_STEP,
) -> SampleEstimate:
    th1a, _, th3a, th1b, th1c = start
    return fit(
        start,
        linkage(th1a, th1b, th1c, th3a, g, FLOATS),
        readings,
        sensors,
        g,
        working_mode,
        last_step,
    )


def _selected(
    solutions: list[SampleEstimate],
    readings: tuple[float, ...],
    prior: Quaternion[float] | None,
    consistent: float,
) -> SampleEstimate:
    """Return the solution that explains the readings best, or that the prior selects."""
    solutions.sort(key=_cost)
    best = solutions[0]
    if prior is not None:
        # Noise alone may make either explain the readings better: the last orientation decides.
        limit = max(consistent * consistent, _cost(best) + AMBIGUOUS_COST)
        rivals = [solution for solution in solutions if _cost(solution) < limit]
        return min(rivals, key=lambda rival: rotation_distance(rival.quaternion, prior))
    rivals = [each for each in solutions if _cost(each) - _cost(best) < AMBIGUOUS_COST]
    if any(rotation_distance(each.quaternion, best.quaternion) > SAME_SOLUTION for each in rivals):
        raise AmbiguousError(
            f'readings {readings} rad: two orientations explain them equally well; a prior selects'
        )
    return best


def _cost(solution: SampleEstimate) -> float:
    """Weighted sum of the squared residuals (unit 1)."""
    return sum(part * part for part in solution.parity_vector)


# In batches --------------------------------------------------------------------------------------


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
            for name in Estimate.__slots__:
                getattr(result, name)[row] = getattr(single, name)
    return result


def _estimate_one(
    readings: tuple[float, ...],
    sensors: UsedSensors,
    g: Geometry,
    prior: Array | None,
) -> Estimate:
    """Estimate one sample; its arrays are views of one."""
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
    """Return sensors that are all in use; made once, as that costs a fifth of an estimate."""
    return UsedSensors(sigma)


def _check_sigma(sigma: ArrayLike, sensors: int) -> tuple[float, ...]:
    """Return the standard deviations of a number of sensors, rad; UsedSensors checks them."""
    if type(sigma) is float:
        # The usual case, at a twentieth of the cost.
        return (sigma,) * sensors
    deviations = check_array('sigma', sigma, ())
    each = deviations.tolist() if deviations.ndim else [deviations.item()] * sensors
    if deviations.ndim > 1 or len(each) != sensors:
        raise InputError(
            f'sigma = {quoted(sigma)}: expected one standard deviation in rad, or '
            f'{NUMBER_WORDS[sensors]}'
        )
    return tuple(each)
