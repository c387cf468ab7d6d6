# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Gauss-Newton on one joint sample, in plain floats, for the 1 kHz path.

Leg A's chain carries the platform: th1A, th2A, th3A are coordinates of its orientation, and the
sensors on th1A and th3A measure two of them directly. Legs B and C add their closures, which
contain the fitted th1B and th1C; sensors on th3B and th3C are compared with the closed legs.
Gauss-Newton on closures and corrections together minimises the weighted sum of the squared
corrections. Unlike the angles of the inverse model, the closures exist for all readings, also just
outside the reach of a leg, and each leg stays in the working mode of its reading.
"""

from __future__ import annotations

import functools
from math import hypot, sin
from typing import NamedTuple

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

# Largest last Gauss-Newton step (rad): each step is shorter than the one before by a factor of the
# noise (in rad) or less, so that the error after this one is 1e-8 rad at 0.04 deg.
CONVERGED_STEP = 1e-5
# Largest number of Gauss-Newton steps, of a sample and of rows together; two are usual. Rows that
# need more are done one by one.
STEPS, BATCH_STEPS = 30, 6
# Longest step along any coordinate (rad); a longer one is shortened to it.
LONGEST_STEP = 0.3
# Largest determinant of the normal equations, relative to the product of their diagonal, that
# counts as zero (unit 1).
RANK_TOLERANCE = 1e-12
# Largest |B_kk| of the wrong sign that noise may cause near the boundary of a working mode (unit
# 1).
MODE_MARGIN = 0.02
# Largest total standard deviation of a determined orientation (rad): beyond some 6 deg the
# first-order covariance does not describe the error.
DETERMINED_DEVIATION = 0.1
DETERMINED_VARIANCE = DETERMINED_DEVIATION ** 2


class SampleEstimate(NamedTuple):
    """Maximum-likelihood orientation of one sample of N mounted sensors, in plain floats."""

    # Unit quaternion x, y, z, w of R_base_platform, of either sign.
    quaternion: Quaternion[float]
    # Covariance of the rotation error, a rotation vector in the base frame, rad^2, row by row.
    covariance: Rotation[float]
    # As of `Estimate`; the parity is None with three sensors.
    parity: float | None
    parity_vector: tuple[float, ...]
    determined: bool
    sensors: UsedSensors
    # Lengths of the N parity gains (1 / rad) and gains (unit 1); 0 for a sensor that is left out.
    parity_sizes: tuple[float, ...]
    gain_sizes: tuple[float, ...]
    # Of `linearise` and `gauss_newton_step`: what the parity gains are made of.
    rows: tuple[Row[float], ...]
    spread: Symmetric[float]

    @property
    def parity_gains(self) -> tuple[tuple[float, ...], ...]:
        """Change of the parity vector with each of the N readings, 1 / rad."""
        _, changes = parities(self.rows, self.sensors, self.spread, FLOATS)
        return tuple(zip(*changes, strict=True)) if changes else ((),) * len(self.rows)


def fit(state: State[float], view: Linkage[float], readings: tuple[float, ...],
        sensors: UsedSensors, g: Geometry, working_mode: WorkingMode | None,
        last_step: float = CONVERGED_STEP) -> SampleEstimate:
    """
    Gauss-Newton to convergence, from a start with its `linkage`.

    Arguments and errors are those of `estimate_sample`.
    """
    for _ in range(STEPS):
        legs, rows = linearise(state, view, readings, sensors, g, FLOATS)
        right, entries, determinant, product = normal_equations(rows)
        if not determinant > RANK_TOLERANCE * product:
            raise SingularityError(
                f'readings {readings} rad: the sensors do not measure every direction')
        step, spread = gauss_newton_step(right, legs, entries, determinant)
        # By comparison: a call for each component costs as much as the step.
        d1, d2, d3, db, dc = step
        converged = (-last_step < d1 < last_step and -last_step < d2 < last_step
                     and -last_step < d3 < last_step and -last_step < db < last_step
                     and -last_step < dc < last_step)
        if not converged:
            scale = min(1.0, LONGEST_STEP / max(map(abs, step)))
            d1, d2, d3, db, dc = (scale * each for each in step)
        th1a, th2a, th3a, th1b, th1c = state
        th1a, th2a, th3a, th1b, th1c = state = (
            th1a + d1, th2a + d2, th3a + d3, th1b + db, th1c + dc)
        if converged:
            break
        view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
    else:
        raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')
    if working_mode is not None and not _in_mode(th2a, legs, sensors, working_mode, g):
        raise SingularityError('the angles fit together only in another working mode than '
                               f'{list(working_mode)}')
    covariance, motions = in_base_frame(th1a, th2a, spread, g, FLOATS)
    vector, changes = parities(rows, sensors, spread, FLOATS)
    parity_sizes = tuple(map(hypot, *changes)) if changes else (0.0,) * len(rows)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = motions
    gain_sizes = tuple([
        weight * hypot(x * ax + y * bx + z * cx, x * ay + y * by + z * cy,
                       x * az + y * bz + z * cz) for _, x, y, z, weight in rows])
    return SampleEstimate(
        chain_quaternion(th1a, th2a, th3a, g, FLOATS), covariance,
        vector[0] if len(vector) == 1 else hypot(*vector) if vector else None, vector,
        covariance[0] + covariance[4] + covariance[8] < DETERMINED_VARIANCE, sensors,
        parity_sizes, gain_sizes, rows, spread)


def _in_mode(th2a: float, legs: Legs[float], sensors: UsedSensors, working_mode: WorkingMode,
             g: Geometry) -> bool:
    """Return whether a solution is in a working mode; a leg without a sensor may have any."""
    sign_a, sign_b, sign_c = working_mode
    leg = g.legs[0]
    weight_a, _, _, weight_3, _, _ = sensors.weights
    # B_AA is the volume of Z1A, Z2A, Z3A.
    return sign_b * legs[0][4] > -MODE_MARGIN and sign_c * legs[1][4] > -MODE_MARGIN and (
        sign_a * leg.sin_alpha * leg.sin_beta * sin(th2a) > -MODE_MARGIN
        or not (weight_a or weight_3))


def fit_rows(readings: Array, sensors: UsedSensors,
             g: Geometry) -> tuple[Array, Array, Array]:
    """
    Gauss-Newton on rows of readings (n, N), rad, together, from Case 2.

    Returned are rotation, covariance and parity vector; NaN in rows that did not converge.
    """
    columns: tuple[Batch, ...] = tuple(np.ascontiguousarray(readings.T))
    th1a, th1b, th1c, th3a = columns[:4]
    view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
    th2a: Batch = np.arctan2(sine * determinant, cosine * determinant)
    state: State[Batch] = th1a, th2a, th3a, th1b, th1c
    trusted: NDArray[np.bool_] = np.abs(determinant) > CLOSED_FORM_TRUST * sensors.largest
    # Rows that are not trusted may diverge here; they are done one by one afterwards.
    with np.errstate(all='ignore'):
        for _ in range(BATCH_STEPS):
            legs, rows = linearise(state, view, columns, sensors, g, ARRAYS)
            right, entries, determinant, product = normal_equations(rows)
            step, spread = gauss_newton_step(right, legs, entries, determinant)
            d1, d2, d3, db, dc = step
            th1a, th2a, th3a, th1b, th1c = state = (
                th1a + d1, th2a + d2, th3a + d3, th1b + db, th1c + dc)
            longest = functools.reduce(np.maximum, map(np.abs, step))
            trusted &= (longest < LONGEST_STEP) & (determinant > RANK_TOLERANCE * product)
            settled = trusted & (longest < CONVERGED_STEP)
            if np.array_equal(settled, trusted):
                break
            view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
        vector = np.stack(parities(rows, sensors, spread, ARRAYS)[0], axis=-1)
        covariance = stack_matrix(in_base_frame(th1a, th2a, spread, g, ARRAYS)[0])
        quaternion = chain_quaternion(th1a, th2a, th3a, g, ARRAYS)
        rotation = stack_matrix(rotation_from_quaternion(*quaternion))
    rotation[~settled], covariance[~settled], vector[~settled] = np.nan, np.nan, np.nan
    return rotation, covariance, vector
