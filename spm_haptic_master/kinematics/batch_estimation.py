# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum-likelihood orientations of many samples together, in arrays."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.kinematics.gauss_newton import (
    CONVERGED_STEP,
    LONGEST_STEP,
    RANK_TOLERANCE,
)
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    Linkage,
    linkage,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.normal_equations import (
    gauss_newton_step,
    in_base_frame,
    inverse_normal,
    Legs,
    linearise,
    normal_equations,
    parity_of,
    Readings,
    residuals_of,
    State,
    Symmetric,
    weights_of,
)
from spm_haptic_master.kinematics.number_backends import Array, ARRAYS, Batch, Vector
from spm_haptic_master.kinematics.passive_sensors import (
    linearise_more,
    NO_THIRDS,
    normal_equations_of_more,
    parity_of_more,
    six_weights,
    Thirds,
    Turn,
)
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, stack_matrix
from spm_haptic_master.kinematics.starting_points import CLOSED_FORM_TRUST

# Turn of a sensor that is not there.
NO_TURN = 1.0, 0.0

# Largest number of steps of a slice; rows that need more are done one by one.
BATCH_STEPS = 6


def estimate_slice(readings: Array, sigma: tuple[float, ...],
                   g: Geometry) -> tuple[NDArray[np.bool_], Array, Array, Array]:
    """
    Estimate rows together.

    Parameters
    ----------
    readings : ndarray, shape (n, N)
        th1A, th1B, th1C, th3A and, with five or six sensors, th3B, th3C, rad.
    sigma : tuple of N float
        Standard deviations of the readings, rad.
    g : Geometry
        Link angles and axes.

    Returns
    -------
    settled : ndarray of bool, shape (n,)
        Which rows converged; the others are to be done one by one.
    rotation, covariance, parity_vector : ndarray, shape (n, 3, 3), (n, 3, 3), (n, N - 3)
        As of `Estimate`.

    """
    columns = tuple(np.ascontiguousarray(readings.T))
    th1a, th1b, th1c, th3a = columns[:4]
    equations = _Equations(columns, sigma, g)
    view: Linkage[Batch] = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
    th2a = np.arctan2(sine * determinant, cosine * determinant)
    trusted = np.abs(determinant) > CLOSED_FORM_TRUST * max(sigma)
    # Rows that are not trusted may diverge here; they are done one by one afterwards.
    with np.errstate(all='ignore'):
        for _ in range(BATCH_STEPS):
            state = th1a, th2a, th3a, th1b, th1c
            matrix, right = equations.at(state, view)
            entries, determinant, product = inverse_normal(matrix)
            step = gauss_newton_step(right, equations.legs, entries, determinant)
            th1a, th2a, th3a, th1b, th1c = (
                angle + along for angle, along in zip(state, step, strict=True))
            longest = functools.reduce(np.maximum, map(np.abs, step))
            trusted &= (longest < LONGEST_STEP) & (determinant > RANK_TOLERANCE * product)
            settled = trusted & (longest < CONVERGED_STEP)
            if np.array_equal(settled, trusted):
                break
            view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
        parities = equations.parities(entries, determinant, step)
        covariance, _ = in_base_frame(th1a, th2a, entries, determinant, g, ARRAYS)
        quaternion = chain_quaternion(th1a, th2a, th3a, g, ARRAYS)
        rotation = stack_matrix(rotation_from_quaternion(*quaternion))
    return settled, rotation, stack_matrix(covariance), np.stack(parities, axis=-1)


class _Equations:
    """The normal equations of rows together, with four sensors or more."""

    legs: Legs[Batch]

    def __init__(self, columns: tuple[Array, ...], sigma: tuple[float, ...], g: Geometry) -> None:
        th1a, th1b, th1c, th3a, *more = columns
        self._four: Readings[Batch] = th1a, th1b, th1c, th3a
        self._weights = weights_of(sigma[:4])
        self._six = six_weights([each ** -2.0 for each in sigma])
        turns: list[Turn[Batch]] = [(np.cos(angle), np.sin(angle)) for angle in more]
        turn_b, turn_c = (*turns, NO_TURN, NO_TURN)[:2]
        self._turns = turn_b, turn_c
        self._residuals: Readings[Batch] = self._four
        self._thirds: Thirds[Batch] = NO_THIRDS
        self._g = g

    def at(self, state: State[Batch],
           view: Linkage[Batch]) -> tuple[Symmetric[Batch], Vector[Batch]]:
        """Matrix and right side at a state."""
        if not self._six[4]:
            self.legs, _, _, _ = linearise(state[1], *view, self._weights, self._g, ARRAYS)
            self._residuals = residuals_of(state, self._four, self.legs)
            return normal_equations(self._residuals, self.legs, self._weights)
        self.legs, self._residuals, self._thirds = linearise_more(
            state, view, self._four, self._turns, self._six, self._g, ARRAYS)
        return normal_equations_of_more(self._residuals, self.legs, self._thirds, self._six)

    def parities(self, entries: Symmetric[Batch], determinant: Batch,
                 step: State[Batch]) -> tuple[Batch, ...]:
        """Parity vector of the last state and its step."""
        if not self._six[4]:
            return (parity_of(self._residuals, self.legs, self._weights, ARRAYS),)
        return parity_of_more(self._residuals, self.legs, self._thirds, self._six, entries,
                              determinant, step, ARRAYS)
