# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum-likelihood orientations of many samples together, in arrays."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.kinematics.estimation.gauss_newton import (
    CONVERGED_STEP,
    LONGEST_STEP,
    RANK_TOLERANCE,
)
from spm_haptic_master.kinematics.estimation.linearisation import linearise, State
from spm_haptic_master.kinematics.estimation.normal_equations import (
    gauss_newton_step,
    in_base_frame,
    normal_equations,
    parities,
)
from spm_haptic_master.kinematics.estimation.starting_points import CLOSED_FORM_TRUST
from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    linkage,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.number_backends import Array, ARRAYS, Batch
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, stack_matrix

# Largest number of steps of a slice; rows that need more are done one by one.
BATCH_STEPS = 6


def estimate_slice(readings: Array, sensors: UsedSensors,
                   g: Geometry) -> tuple[NDArray[np.bool_], Array, Array, Array]:
    """
    Estimate rows together, with th1A, th1B, th1C and th3A among the sensors in use.

    `readings` (n, N) are those of the mounted sensors, rad.

    Returned are the rows that converged, (n,) bool; the others are to be done one by one. Then
    rotation, covariance and parity vector, (n, 3, 3), (n, 3, 3) and (n, count - 3), of `Estimate`.
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
        vector, _ = parities(rows, sensors, spread, ARRAYS)
        covariance, _ = in_base_frame(th1a, th2a, spread, g, ARRAYS)
        quaternion = chain_quaternion(th1a, th2a, th3a, g, ARRAYS)
        rotation = stack_matrix(rotation_from_quaternion(*quaternion))
    return settled, rotation, stack_matrix(covariance), np.stack(vector, axis=-1)
