# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How well a mechanism explains readings: parity of samples and its derivatives, in batches.

A sample with N sensors has N readings and three unknowns of its own, its orientation. In units of
the sensors' noise, with the Jacobian J = d angles / d rotation and its null space U (U^T J = 0),
U^T (reading - angle) are the N - 3 numbers that no orientation explains: the parity vector.
Minimising its sum of squares over the parameters is weighted total least squares, as each sample
has its own maximum-likelihood orientation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.mechanism_parameters import Array, Layout
from spm_haptic_master.kinematics import forward_theta3a, Geometry, inverse, jacobian
from spm_haptic_master.kinematics.rotations import matrix_from_vector, wrapped

# Step of the parameters in the forward differences (rad): truncation and rounding are below 1e-5
# of the derivative.
DIFFERENCE = 1e-6
# Steps of an orientation towards its maximum-likelihood value from the closed form.
ROTATION_STEPS = 3
# Longest step of an orientation (rad): a longer one comes of a sample that fits nothing.
LONGEST_STEP = 0.3


@dataclass(frozen=True, slots=True)
class Linearised:
    """
    Parity of n samples and its derivatives at a parameter vector.

    The first component of a parity vector is the parity of the first four sensors, with a sign
    that is continuous over the workspace.
    """

    usable: NDArray[np.bool_]  # (n,); which samples have an orientation within reach, others are 0
    parity: Array  # (n, N - 3), standard deviations of white noise
    derivative: Array  # (n, N - 3, columns), 1/rad
    rotation: Array  # (n, 3, 3), one step closer to the maximum-likelihood ones
    spread: Array  # (n, 3, N), orientation error by each reading's, rad/rad, base frame


@dataclass(frozen=True, slots=True)
class MotionModel:
    """
    The readings that a mechanism with its encoders gives at orientations.

    Its methods take `turned`, readings by their directions before the zeros are subtracted, rad,
    shape (n, N), orientations `rotation`, shape (n, 3, 3), and parameters `vector`, shape (P,).
    """

    layout: Layout
    sigma: Array  # white noise of each sensor, rad, (N,)

    def joint_angles(self, rotation: Array, geometry: Geometry) -> Array:
        """Return the angles of the sensors' joints, rad, shape (n, N); NaN out of reach."""
        found = inverse(rotation, geometry, self.layout.working_mode)
        return np.column_stack([found.theta1, found.theta3a, found.theta3b,
                                found.theta3c])[:, :self.layout.sensors]

    def orientations(self, turned: Array, vector: Array) -> Array:
        """Return the orientations of readings, shape (n, 3, 3); NaN where there is none."""
        angles = self.corrected(turned, vector)
        rotation = forward_theta3a(angles[:, :3], angles[:, 3], self.layout.geometry(vector))
        for _ in range(ROTATION_STEPS):
            rotation = self.linearised(turned, rotation, vector).rotation
        return rotation

    def corrected(self, turned: Array, vector: Array) -> Array:
        """Return the joint angles by readings, rad, shape (n, N)."""
        angles = from_zero = wrapped(turned - vector[self.layout.slices['zeros']])
        for _ in range(2):
            angles = from_zero - self.layout.harmonic_deviation(angles, vector)[0]
        return angles

    def readings(self, rotation: Array, vector: Array) -> Array:
        """Return the readings by their directions, rad, shape (n, N); NaN out of reach."""
        angles = self.joint_angles(rotation, self.layout.geometry(vector))
        return (angles + self.layout.harmonic_deviation(angles, vector)[0]
                + vector[self.layout.slices['zeros']])

    def linearised(self, turned: Array, rotation: Array, vector: Array,
                   columns: tuple[int, ...] = ()) -> Linearised:
        """
        Return parity of samples, and its derivatives by the parameters in `columns`.

        The orientations are near the maximum-likelihood ones; NaN where there is none.
        """
        layout, geometry = self.layout, self.layout.geometry(vector)
        known = np.all(np.isfinite(rotation), axis=(1, 2))
        matrices = np.where(known[:, None, None], rotation, np.eye(3))
        angles = self.joint_angles(matrices, geometry)
        rates = jacobian(matrices, geometry, layout.working_mode, sensors=layout.sensors)
        usable = known & np.isfinite(angles).all(axis=1) & np.isfinite(rates).all(axis=(1, 2))
        angles[~usable] = 0.0
        rates[~usable] = np.eye(layout.sensors, 3)
        deviation, slope = layout.harmonic_deviation(angles, vector)
        residual = wrapped(turned - vector[layout.slices['zeros']] - angles - deviation)
        white_rates = rates * ((1.0 + slope) / self.sigma)[:, :, None]
        orthogonal, upper = np.linalg.qr(white_rates, mode='complete')
        across = _continuous(orthogonal[:, :, 3:], white_rates)
        white = residual / self.sigma
        spread = np.linalg.inv(upper[:, :3]) @ orthogonal[:, :, :3].swapaxes(1, 2)
        step = np.einsum('nij,nj->ni', spread, white)
        usable &= np.isfinite(step).all(axis=1) & (np.abs(step).max(axis=1) < LONGEST_STEP)
        step[~usable] = 0.0
        moved = matrix_from_vector(step) @ matrices
        by = self._derivative(matrices, angles, slope, vector, columns)
        parity = np.einsum('nik,ni->nk', across, white)
        derivative = across.swapaxes(1, 2) @ (by / self.sigma[:, None])
        parity[~usable] = 0.0
        derivative[~usable] = 0.0
        moved[~known] = np.nan
        return Linearised(usable, parity, derivative, moved, spread / self.sigma)

    def orientation_changes(self, rotation: Array, vector: Array) -> Array:
        """Return the orientations' changes with the parameters, rad, base frame, (n, 3, P)."""
        angles = self.joint_angles(rotation, self.layout.geometry(vector))
        slope = self.layout.harmonic_deviation(angles, vector)[1]
        spread = self.linearised(self.readings(rotation, vector), rotation, vector).spread
        return spread @ self._derivative(rotation, angles, slope, vector,
                                         tuple(range(self.layout.count)))

    def _derivative(self, rotation: Array, angles: Array, slope: Array, vector: Array,
                    columns: tuple[int, ...]) -> Array:
        """Return the derivative of reading minus predicted reading, shape (n, N, columns)."""
        layout = self.layout
        n, sensors = angles.shape
        zeros = layout.slices['zeros'].stop
        harmonics = layout.slices['first harmonics'].start
        found = np.zeros((n, sensors, len(columns)))
        for place, column in enumerate(columns):
            if column < zeros:
                found[:, column, place] = -1.0
            elif column < harmonics:
                moved = vector.copy()
                moved[column] += DIFFERENCE
                change = wrapped(
                    self.joint_angles(rotation, layout.geometry(moved)) - angles) / DIFFERENCE
                found[:, :, place] = np.nan_to_num(-change * (1.0 + slope))
            else:
                order, rest = divmod(column - harmonics, 2 * sensors)
                sensor, part = divmod(rest, 2)
                at = (order + 1) * angles[:, sensor]
                found[:, sensor, place] = -(np.sin(at) if part else np.cos(at))
        return found


def _continuous(across: Array, rates: Array) -> Array:
    """
    Return a basis of the null space of J^T, (n, N, N - 3), that does not jump between poses.

    Its first vector is along the signed 3 x 3 minors of the first four rows of J, `rates`, and 0
    for all further sensors. The vector of each of these is 0 for those after it and positive for
    itself. (The vectors of a QR decomposition, as `across`, change their sign where an element of
    J does.)
    """
    further = across.shape[2] - 1
    if further:
        # The last sensor comes first: its row becomes (x, 0, ...), the next one (x, x, ...).
        rotation, lower = np.linalg.qr(across[:, :3:-1].swapaxes(1, 2), mode='complete')
        rotation[:, :, :further] *= np.where(
            np.diagonal(lower, axis1=1, axis2=2) < 0.0, -1.0, 1.0)[:, None]
        across = (across @ rotation)[:, :, ::-1]
    first = np.cross(rates[:, 0], rates[:, 1])
    last = np.cross(rates[:, 2], rates[:, 3])
    minors = np.stack([(rates[:, 1] * last).sum(1), -(rates[:, 0] * last).sum(1),
                       (rates[:, 3] * first).sum(1), -(rates[:, 2] * first).sum(1)], axis=1)
    along = np.einsum('ni,ni->n', across[:, :4, 0], minors)
    found = across.copy()
    found[:, :, 0] *= np.where(along < 0.0, -1.0, 1.0)[:, None]
    return found
