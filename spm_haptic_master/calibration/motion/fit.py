# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fits parameters of mechanism and encoders to readings of free motion, by least squares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.mechanism_parameters import Array
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.exceptions import CalibrationError, GeometryError

# Largest number of steps.
STEPS = 25
# Length of the last step (standard deviations of the result).
CONVERGED = 0.02
# Relative increase of the cost that is rounding (unit 1).
TOLERANCE = 1e-9
# Least relative change of the outliers' limit that is followed (unit 1).
LIMIT_CHANGE = 0.02
# Parity beyond which a sample is an outlier (robust standard deviations).
OUTLIER = 6.0
# Standard deviation over the median absolute deviation of a normal distribution (unit 1).
NORMAL_DEVIATION = 1.4826
# Least information that a step counts on (1/rad^2).
LEAST_INFORMATION = 1e-6
# Samples that are linearised together: larger arrays leave the cache.
SLICE = 5000
# Damping of the first step after one that made the fit worse, its factor after each further one,
# and the largest (unit 1). Without one there is none: it would hold what a poor motion hardly
# determines where it started.
DAMPING_START, DAMPING, DAMPING_LIMIT = 1e-8, 10.0, 1e4


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal equations of a batch of n samples."""

    cost: float  # sum of the squared parities, outliers at their limit (unit 1)
    matrix: Array  # (P, P), 1/rad^2
    right: Array  # (P,), 1/rad
    parity: Array  # (n, N - 3), standard deviations; NaN where there is no orientation
    kept: NDArray[np.bool_]  # (n,); which samples are no outliers
    rotation: Array  # (n, 3, 3)
    limit: float  # parity beyond which a sample is an outlier (unit 1)

    @property
    def sizes(self) -> Array:
        """Return the lengths of the parity vectors (unit 1); NaN where there is none."""
        found: Array = np.linalg.norm(self.parity, axis=1)
        return found


@dataclass(frozen=True, slots=True)
class Fit:
    """Result of a fit."""

    vector: Array  # parameters, (P,)
    columns: tuple[int, ...]  # those that were estimated; the others were left as they were
    normal: Normal  # normal equations of the estimated parameters at the result
    misfit: float  # cost with that of the parameters' deviations (unit 1)

    @property
    def rms(self) -> float:
        """Return the root mean square parity of the samples kept (unit 1)."""
        kept = self.normal.parity[self.normal.kept]
        return float(np.sqrt(np.mean(kept ** 2))) if kept.size else float('inf')


def normal_equations(model: MotionModel, turned: Array, rotation: Array, vector: Array,
                     columns: tuple[int, ...], limit: float | None = None) -> Normal:
    """
    Return the normal equations of samples; arguments of `MotionModel.linearised`.

    Without a limit of the parity, beyond which a sample is an outlier, the samples give it.
    """
    parts = [model.linearised(turned[at:at + SLICE], rotation[at:at + SLICE], vector, columns)
             for at in range(0, len(turned), SLICE)]
    usable = np.concatenate([part.usable for part in parts])
    parity = np.concatenate([part.parity for part in parts])
    size = np.linalg.norm(parity, axis=1)
    if limit is None:
        limit = _limit(size[usable])
    kept = usable & (size < limit)
    matrix, right = np.zeros((len(columns),) * 2), np.zeros(len(columns))
    for number, part in enumerate(parts):
        inside = kept[number * SLICE:(number + 1) * SLICE]
        # The derivatives, shape (m, P), and the parities, shape (m,).
        values = part.parity[inside].ravel()
        rows = part.derivative[inside].reshape(len(values), len(columns))
        matrix += rows.T @ rows
        right += rows.T @ values
    cost = float(np.sum(np.minimum(size, limit)[usable] ** 2)) + limit ** 2 * float(
        (~usable).sum())
    return Normal(cost, matrix, right, np.where(usable[:, None], parity, np.nan), kept,
                  np.concatenate([part.rotation for part in parts]), limit)


def outlier_limit(normal: Normal) -> float:
    """Return the parity beyond which a sample is an outlier, by the samples (unit 1)."""
    sizes = normal.sizes
    return _limit(sizes[np.isfinite(sizes)])


def _limit(sizes: Array) -> float:
    if not len(sizes):
        return OUTLIER
    return OUTLIER * max(1.0, NORMAL_DEVIATION * float(np.median(sizes)))


def fit(model: MotionModel, turned: Array, vector: Array, columns: Sequence[int],
        rotation: Array | None = None, progress: Callable[[], None] = lambda: None) -> Fit:
    """
    Return the parameters in `columns` that explain readings best, by Levenberg-Marquardt.

    The others keep their value of `vector`. The orientations are near those at the start, and
    `progress` is called after each step. CalibrationError where no sample has an orientation.
    """
    chosen = tuple(columns)
    places = np.array(chosen)
    weights = model.layout.deviations[places] ** -2.0
    vector = vector.copy()
    if rotation is None:
        rotation = model.orientations(turned, vector)
    now = normal_equations(model, turned, rotation, vector, chosen)
    if not now.kept.any():
        raise CalibrationError('no sample of the motion has an orientation')
    damping = 0.0
    for _ in range(STEPS):
        limit = now.limit
        cost = now.cost + float(weights @ vector[places] ** 2)
        matrix = now.matrix + np.diag(weights)
        # What nothing determines yet stays as it is.
        scale = np.sqrt(np.maximum(np.diag(matrix), LEAST_INFORMATION))
        damped = matrix / scale[:, None] / scale + damping * np.eye(len(places))
        step = -np.linalg.lstsq(
            damped, (now.right + weights * vector[places]) / scale, rcond=None)[0] / scale
        moved = vector.copy()
        moved[places] += step
        after = _tried(model, turned, now.rotation, moved, chosen, limit)
        if after is None or after.cost + float(weights @ moved[places] ** 2) \
                > cost * (1.0 + TOLERANCE):
            damping = max(DAMPING * damping, DAMPING_START)
            if damping > DAMPING_LIMIT:
                break
            continue
        # Fewer outliers, or more: with the limit of the samples themselves from here on.
        own = outlier_limit(after)
        vector, now = moved, after
        if abs(own - limit) > LIMIT_CHANGE * limit:
            now = normal_equations(model, turned, after.rotation, vector, chosen)
        damping = damping / DAMPING if damping > DAMPING_START else 0.0
        progress()
        # The length of the step in standard deviations of the result.
        if float(step @ matrix @ step) < CONVERGED ** 2 * len(places):
            break
    return Fit(vector, chosen, now, now.cost + float(weights @ vector[places] ** 2))


def _tried(model: MotionModel, turned: Array, rotation: Array, vector: Array,
           columns: tuple[int, ...], limit: float) -> Normal | None:
    """Return the normal equations at a new vector, None if it is an impossible mechanism."""
    try:
        near = model.linearised(turned, rotation, vector).rotation
        return normal_equations(model, turned, near, vector, columns, limit)
    except GeometryError:
        return None
