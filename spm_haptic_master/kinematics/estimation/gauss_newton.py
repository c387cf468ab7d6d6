# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Gauss-Newton on one joint sample, in plain floats for the 1 kHz path, and on rows of a batch.

It closes the legs, and minimises the weighted sum of the squared residuals of the readings. Unlike
the angles of the inverse model, the closures exist for all readings, also just outside the reach
of a leg, and each leg stays in the working mode of its reading.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sin, sqrt

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.closed_form import CLOSED_FORM_TRUST
from spm_haptic_master.kinematics.estimation.normal_equations import (
    gauss_newton_step,
    in_base_frame,
    Legs,
    linearise,
    Motions,
    normal_equations,
    parities,
    Row,
    State,
    Symmetric,
)
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    Linkage,
    linkage,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.number_backends import (
    Array,
    ARRAYS,
    Batch,
    FLOATS,
    Quaternion,
    Rotation,
)
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, stack_matrix

# Length of a Gauss-Newton step (rad) below which no other follows: each step is shorter than the
# one before by a factor of the noise (in rad) or less, so that 1e-8 rad are left at 0.04 deg.
CONVERGED_STEP = 1e-5
# Largest number of Gauss-Newton steps, of a sample and of rows together; two are usual. Rows that
# need more are done one by one.
MOST_STEPS = 30
BATCH_STEPS = 6
# Longest step along any coordinate (rad); a longer one is shortened to it.
LONGEST_STEP = 0.3
# Largest determinant of the normal equations that counts as zero, over the product of their
# diagonal (unit 1).
RANK_TOLERANCE = 1e-12
# Largest |B_kk| of the wrong sign that noise causes near the boundary of a working mode (unit 1).
MODE_MARGIN = 0.02
# Largest total standard deviation of a determined orientation (rad): beyond some 6 deg the
# first-order covariance does not describe the error.
DETERMINED_DEVIATION = 0.1
DETERMINED_VARIANCE = DETERMINED_DEVIATION**2


@dataclass(slots=True)  # to freeze it would cost as much as all its fields
class SampleEstimate:
    """
    Maximum-likelihood orientation of one sample, in plain floats.

    Attributes
    ----------
    quaternion : tuple of four float
        Unit quaternion x, y, z, w of R_base_platform, of either sign.
    covariance : tuple of nine float
        Covariance of the rotation error, a rotation vector in the base frame, rad^2, row by row.
    parity : float or None
        Signed residual of four sensors over its standard deviation (unit 1); unit variance for
        healthy sensors. The norm of `parity_vector` with more. None with three sensors: they
        cannot contradict each other.
    determined : bool
        Whether the sensors determine the orientation: total deviation below
        `DETERMINED_DEVIATION`. It does not say whether they agree: see `parity_vector`.
    sensors : UsedSensors
        The sensors in use.
    parity_vector : tuple of float
        Whitened residuals (unit 1), one for each sensor beyond three: independent, of unit
        variance for healthy sensors. The first is that of the first four sensors; each further
        one is what the next sensor differs by from the estimate of those before it.
    parity_sizes, gain_sizes : tuple of N float
        Of each of the N mounted sensors, the length of its parity gain (1 / rad) and of its gain
        (unit 1): what its reading moves the parity vector by, and turns the orientation by. 0 for
        a sensor that is left out.
    rows : tuple of N Row
        Residuals and rates of the sensors at the solution, of `linearise`.
    spread : Symmetric
        Covariance of th1A, th2A, th3A, rad^2.

    """

    quaternion: Quaternion[float]
    covariance: Rotation[float]
    parity: float | None
    parity_vector: tuple[float, ...]
    determined: bool
    sensors: UsedSensors
    parity_sizes: tuple[float, ...]
    gain_sizes: tuple[float, ...]
    rows: tuple[Row[float], ...]
    spread: Symmetric[float]

    def with_orientation(
        self, quaternion: Quaternion[float], covariance: Rotation[float]
    ) -> SampleEstimate:
        """Return the estimate with an orientation in other terms, and its covariance, rad^2."""
        return SampleEstimate(
            quaternion=quaternion,
            covariance=covariance,
            parity=self.parity,
            parity_vector=self.parity_vector,
            determined=self.determined,
            sensors=self.sensors,
            parity_sizes=self.parity_sizes,
            gain_sizes=self.gain_sizes,
            rows=self.rows,
            spread=self.spread,
        )

    @property
    def total_deviation(self) -> float:
        """Total standard deviation, rad: the rms length of the rotation error."""
        return sqrt(self.covariance[0] + self.covariance[4] + self.covariance[8])

    @property
    def parity_gains(self) -> tuple[tuple[float, ...], ...]:
        """Change of the parity vector with each of the N readings, 1 / rad."""
        _, changes = parities(self.rows, self.sensors, self.spread, FLOATS)
        if not changes:
            return ((),) * len(self.rows)
        return tuple(zip(*changes, strict=True))


def fit(
    state: State[float],
    view: Linkage[float],
    readings: tuple[float, ...],
    sensors: UsedSensors,
    g: Geometry,
    working_mode: WorkingMode | None,
    last_step: float = CONVERGED_STEP,
) -> SampleEstimate:
    """
    Estimate a sample by Gauss-Newton steps from a state with its `linkage`.

    All other arguments, and the errors, are those of `estimate_sample`. Covariance and parity are
    those at the state before the last step, which is shorter than `last_step`: no motion changes a
    parity to the first order.
    """
    for _ in range(MOST_STEPS):
        legs, rows = linearise(state, view, readings, sensors, g, FLOATS)
        right, adjugate, determinant, diagonal = normal_equations(rows)
        if not determinant > RANK_TOLERANCE * diagonal:
            raise SingularityError(
                f'readings {readings} rad: the sensors do not measure every direction'
            )
        step, spread = gauss_newton_step(right, legs, adjugate, determinant)
        if _is_short(step, last_step):
            state = moved(state, step)
            if working_mode is not None and not is_in_mode(
                state[1], legs, sensors, working_mode, g
            ):
                raise SingularityError(
                    'the angles fit together only in another working mode than '
                    f'{list(working_mode)}'
                )
            return _estimate_at(state, rows, sensors, spread, g)
        state = moved(state, step)
        th1a, _, th3a, th1b, th1c = state
        view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
    raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')


def _is_short(step: State[float], most: float) -> bool:
    """Whether a step is shorter than `most` along each coordinate; NaN is not."""
    d1a, d2a, d3a, d1b, d1c = step
    return (
        -most < d1a < most
        and -most < d2a < most
        and -most < d3a < most
        and -most < d1b < most
        and -most < d1c < most
    )


def moved(state: State[float], step: State[float]) -> State[float]:
    """Return a state after a step, rad, which is shortened to `LONGEST_STEP`."""
    th1a, th2a, th3a, th1b, th1c = state
    d1a, d2a, d3a, d1b, d1c = step
    longest = max(map(abs, step))
    scale = 1.0 if longest <= LONGEST_STEP else LONGEST_STEP / longest
    return (
        th1a + scale * d1a,
        th2a + scale * d2a,
        th3a + scale * d3a,
        th1b + scale * d1b,
        th1c + scale * d1c,
    )


def is_in_mode(
    th2a: float,
    legs: Legs[float],
    sensors: UsedSensors,
    working_mode: WorkingMode,
    g: Geometry,
) -> bool:
    """Whether the legs are in a working mode, but for noise; one without a sensor has any."""
    (*_, volume_b), (*_, volume_c) = legs
    leg = g.legs[0]
    sign_a, sign_b, sign_c = working_mode
    # B_AA, the volume of Z1A, Z2A, Z3A, is here sin alpha sin beta sin th2A.
    volume_a = leg.sin_alpha * leg.sin_beta * sin(th2a)
    is_leg_a = sign_a * volume_a > -MODE_MARGIN or {0, 3}.isdisjoint(sensors.used)
    is_leg_b = sign_b * volume_b > -MODE_MARGIN
    is_leg_c = sign_c * volume_c > -MODE_MARGIN
    return is_leg_a and is_leg_b and is_leg_c


def _estimate_at(
    state: State[float],
    rows: tuple[Row[float], ...],
    sensors: UsedSensors,
    spread: Symmetric[float],
    g: Geometry,
) -> SampleEstimate:
    """Return the estimate of a converged state: its orientation, covariance, parity and gains."""
    th1a, th2a, th3a, _, _ = state
    covariance, motions = in_base_frame(th1a, th2a, spread, g, FLOATS)
    vector, changes = parities(rows, sensors, spread, FLOATS)
    return SampleEstimate(
        quaternion=chain_quaternion(th1a, th2a, th3a, g, FLOATS),
        covariance=covariance,
        parity=_parity_of(vector),
        parity_vector=vector,
        determined=covariance[0] + covariance[4] + covariance[8] < DETERMINED_VARIANCE,
        sensors=sensors,
        parity_sizes=tuple(map(hypot, *changes)) if changes else (0.0,) * len(rows),
        gain_sizes=tuple([_gain_size(row, motions) for row in rows]),
        rows=rows,
        spread=spread,
    )


def _parity_of(vector: tuple[float, ...]) -> float | None:
    """Return the parity of a parity vector: signed with one entry, None without any."""
    if not vector:
        return None
    return vector[0] if len(vector) == 1 else hypot(*vector)


def _gain_size(row: Row[float], motions: Motions[float]) -> float:
    """Return how far the orientation turns with a sensor's reading (unit 1)."""
    _, x, y, z, weight = row
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = motions
    return weight * hypot(
        x * ax + y * bx + z * cx,
        x * ay + y * by + z * cy,
        x * az + y * bz + z * cz,
    )


def _trusted_starts(
    columns: tuple[Batch, ...],
    sensors: UsedSensors,
    g: Geometry,
) -> tuple[State[Batch], Linkage[Batch], NDArray[np.bool_]]:
    """Return states by leg A's Case 2 with their linkage, and which of them are to be trusted."""
    th1a, th1b, th1c, th3a = columns[:4]
    view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
    th2a: Batch = np.arctan2(sine * determinant, cosine * determinant)
    trusted = np.abs(determinant) > CLOSED_FORM_TRUST * sensors.largest
    return (th1a, th2a, th3a, th1b, th1c), view, trusted


def fit_rows(readings: Array, sensors: UsedSensors, g: Geometry) -> tuple[Array, Array, Array]:
    """
    Fit rows of readings together by Gauss-Newton.

    Parameters
    ----------
    readings : ndarray, shape (n, N)
        Of the N mounted sensors, all in use, rad.
    sensors : UsedSensors
        Standard deviations.
    g : Geometry
        Link angles and axes.

    Returns
    -------
    rotation, covariance : ndarray, shape (n, 3, 3)
        R_base_platform, and the covariance of its error in the base frame, rad^2.
    vector : ndarray, shape (n, N - 3)
        The parity vector (unit 1). All three are NaN in rows without a start to be trusted, and in
        those that do not converge in `BATCH_STEPS`: these have to be done one by one.

    """
    columns: tuple[Batch, ...] = tuple(np.ascontiguousarray(readings.T))
    state, view, trusted = _trusted_starts(columns, sensors, g)
    # Rows that are not trusted may diverge here.
    with np.errstate(all='ignore'):
        for _ in range(BATCH_STEPS):
            legs, rows = linearise(state, view, columns, sensors, g, ARRAYS)
            right, adjugate, determinant, diagonal = normal_equations(rows)
            step, spread = gauss_newton_step(right, legs, adjugate, determinant)
            d1, d2, d3, db, dc = step
            th1a, th2a, th3a, th1b, th1c = state
            state = th1a + d1, th2a + d2, th3a + d3, th1b + db, th1c + dc
            longest = np.max([np.abs(change) for change in step], axis=0)
            trusted &= (longest < LONGEST_STEP) & (determinant > RANK_TOLERANCE * diagonal)
            settled = trusted & (longest < CONVERGED_STEP)
            th1a, th2a, th3a, th1b, th1c = state
            if np.array_equal(settled, trusted):
                break
            view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
        vector = np.stack(parities(rows, sensors, spread, ARRAYS)[0], axis=-1)
        covariance = stack_matrix(in_base_frame(th1a, th2a, spread, g, ARRAYS)[0])
        quaternion = chain_quaternion(th1a, th2a, th3a, g, ARRAYS)
        rotation = stack_matrix(rotation_from_quaternion(*quaternion))
    rotation[~settled] = np.nan
    covariance[~settled] = np.nan
    vector[~settled] = np.nan
    return rotation, covariance, vector
