# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Fits parameters of mechanism and encoders to readings of free motion, by least squares.

Those are fitted that the motion determines and that a held-out part of it confirms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.coverage import inverse
from spm_haptic_master.calibration.motion.model import Array, GROUPS, MotionModel
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
DAMPING_START = 1e-8
DAMPING = 10.0
DAMPING_LIMIT = 1e4
# Predicted standard deviation of a parameter over that before the fit, below which the motion
# determines it (unit 1).
DETERMINED = 0.95
# Length of the pieces of the motion of which every third is held out (s).
HELD_OUT_SECONDS = 2.0
# Standard errors by which a larger model may be worse on the held-out motion than the noise makes
# it: one number for each parameter over the number of samples fitted.
WORSE_DEVIATIONS = 3.0


@dataclass(frozen=True, slots=True)
class Normal:
    """
    Normal equations of a batch of n samples for the P parameters of a fit.

    Attributes
    ----------
    cost : float
        Sum of the squared parities, outliers at their limit (unit 1).
    matrix : ndarray, shape (P, P)
        Normal matrix, 1/rad^2.
    right : ndarray, shape (P,)
        Its right-hand side, 1/rad.
    parity : ndarray, shape (n, N - 3)
        Parity, standard deviations of white noise; NaN where there is no orientation.
    kept : ndarray of bool, shape (n,)
        Which samples are no outliers.
    rotation : ndarray, shape (n, 3, 3)
        Orientations, one step closer to the maximum-likelihood ones.
    limit : float
        Parity beyond which a sample is an outlier (unit 1).

    """

    cost: float
    matrix: Array
    right: Array
    parity: Array
    kept: NDArray[np.bool_]
    rotation: Array
    limit: float


@dataclass(frozen=True, slots=True)
class Fit:
    """
    Result of a fit.

    Attributes
    ----------
    vector : ndarray, shape (P,)
        All parameters, rad.
    columns : tuple of int
        Places of those that were estimated; the others were left as they were.
    normal : Normal
        Normal equations of the estimated parameters at the result.
    misfit : float
        Cost with that of the parameters' deviations from the drawing (unit 1).

    """

    vector: Array
    columns: tuple[int, ...]
    normal: Normal
    misfit: float

    @property
    def rms(self) -> float:
        """Return the root mean square parity of the samples kept (unit 1)."""
        kept = self.normal.parity[self.normal.kept]
        if kept.size:
            return float(np.sqrt(np.mean(kept**2)))
        return float('inf')


def normal_equations(
    model: MotionModel,
    turned: Array,
    rotation: Array,
    vector: Array,
    columns: tuple[int, ...],
    limit: float | None = None,
) -> Normal:
    """
    Return the normal equations of samples for the parameters in `columns`.

    The derivatives are those of the parity, from which each sample's orientation is eliminated.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    rotation : ndarray, shape (n, 3, 3)
        Orientations near the maximum-likelihood ones.
    vector : ndarray, shape (P,)
        Parameters, rad.
    columns : tuple of int
        Places of the parameters in the vector.
    limit : float or None, optional
        Parity beyond which a sample is an outlier (unit 1); by default from the samples
        themselves.

    Returns
    -------
    Normal
        Sums over the samples that are no outliers.

    """
    parts = [
        model.linearised(
            turned[at : at + SLICE],
            rotation[at : at + SLICE],
            vector,
            columns,
        )
        for at in range(0, len(turned), SLICE)
    ]
    usable = np.concatenate([part.usable for part in parts])
    parities = np.concatenate([part.parity for part in parts])
    parity = np.where(usable[:, None], parities, np.nan)
    size = np.linalg.norm(parity, axis=1)
    if limit is None:
        limit = _outlier_limit(parity)
    kept = size < limit
    matrix = np.zeros((len(columns),) * 2)
    right = np.zeros(len(columns))
    for number, part in enumerate(parts):
        inside = kept[number * SLICE : (number + 1) * SLICE]
        # The derivatives, shape (m, P), and the parities, shape (m,).
        values = part.parity[inside].ravel()
        rows = part.derivative[inside].reshape(len(values), len(columns))
        matrix += rows.T @ rows
        right += rows.T @ values
    return Normal(
        cost=float(np.sum(np.fmin(size, limit) ** 2)),
        matrix=matrix,
        right=right,
        parity=parity,
        kept=kept,
        rotation=np.concatenate([part.rotation for part in parts]),
        limit=limit,
    )


def _outlier_limit(parity: Array) -> float:
    """
    Return the size of a parity beyond which a sample is an outlier.

    `OUTLIER` robust standard deviations (1.4826 times the median), and at least that of white
    noise.

    Parameters
    ----------
    parity : ndarray, shape (n, N - 3)
        Parity, standard deviations of white noise; NaN where there is none.

    Returns
    -------
    float
        Limit (unit 1).

    """
    has_parity = np.isfinite(parity[:, 0])
    if not has_parity.any():
        return OUTLIER
    sizes = np.linalg.norm(parity[has_parity], axis=1)
    return OUTLIER * max(1.0, NORMAL_DEVIATION * float(np.median(sizes)))


def fit(
    model: MotionModel,
    turned: Array,
    vector: Array,
    columns: Sequence[int],
    rotation: Array | None = None,
) -> Fit:
    """
    Return the parameters that explain readings best, by Levenberg-Marquardt.

    The cost is the sum of squared parities, outliers at their limit, and of the parameters in
    units of their standard deviations before the fit. Steps are undamped until one makes the cost
    larger.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    vector : ndarray, shape (P,)
        Start; parameters that are not estimated keep their value, rad.
    columns : sequence of int
        Places of the parameters to estimate.
    rotation : ndarray or None, shape (n, 3, 3), optional
        Orientations near those at the start; by default they are computed.

    Returns
    -------
    Fit
        Parameters with the normal equations there.

    Raises
    ------
    CalibrationError
        No sample has an orientation.

    """
    chosen = tuple(columns)
    places = np.array(chosen)
    weights = model.layout.deviations[places] ** -2.0
    vector = vector.copy()
    if rotation is None:
        rotation = model.orientations(turned, vector)

    def misfit(normal: Normal, vector: Array) -> float:
        """Return the cost with that of the estimated parameters' deviations."""
        return normal.cost + float(weights @ vector[places] ** 2)

    now = normal_equations(model, turned, rotation, vector, chosen)
    if not now.kept.any():
        raise CalibrationError('no sample of the motion has an orientation')
    damping = 0.0
    for _ in range(STEPS):
        step = _damped_step(now, weights, vector[places], damping)
        moved = vector.copy()
        moved[places] += step
        after = _normal_after(model, turned, now, moved, chosen)
        if after is None or misfit(after, moved) > misfit(now, vector) * (1.0 + TOLERANCE):
            damping = max(DAMPING * damping, DAMPING_START)
            if damping > DAMPING_LIMIT:
                break
            continue
        # The square of the step's length in standard deviations of the result.
        length = float(step @ (now.matrix + np.diag(weights)) @ step)
        now = _with_own_limit(model, turned, after, moved, chosen)
        vector = moved
        damping = damping / DAMPING if damping > DAMPING_START else 0.0
        if length < CONVERGED**2 * len(places):
            break
    return Fit(
        vector=vector,
        columns=chosen,
        normal=now,
        misfit=misfit(now, vector),
    )


def _damped_step(
    now: Normal,
    weights: Array,
    estimated: Array,
    damping: float,
) -> Array:
    """
    Return a step of Levenberg-Marquardt, with the parameters in units of their deviations.

    Parameters
    ----------
    now : Normal
        Normal equations of the P parameters that are estimated.
    weights : ndarray, shape (P,)
        Their variances before the fit, to the power of -1, 1/rad^2.
    estimated : ndarray, shape (P,)
        Their values, rad.
    damping : float
        Damping (unit 1).

    Returns
    -------
    ndarray, shape (P,)
        Changes, rad.

    """
    matrix = now.matrix + np.diag(weights)
    right = now.right + weights * estimated
    # What nothing determines yet stays as it is.
    scale = np.sqrt(np.maximum(np.diag(matrix), LEAST_INFORMATION))
    damped = matrix / scale[:, None] / scale + damping * np.eye(len(scale))
    scaled = np.linalg.lstsq(damped, right / scale, rcond=None)[0]
    return -scaled / scale


def _normal_after(
    model: MotionModel,
    turned: Array,
    now: Normal,
    vector: Array,
    columns: tuple[int, ...],
) -> Normal | None:
    """Return the normal equations after a step; None for an impossible mechanism."""
    try:
        near = model.linearised(turned, now.rotation, vector).rotation
        return normal_equations(
            model,
            turned,
            near,
            vector,
            columns,
            now.limit,
        )
    except GeometryError:
        return None


def _with_own_limit(
    model: MotionModel,
    turned: Array,
    normal: Normal,
    vector: Array,
    columns: tuple[int, ...],
) -> Normal:
    """Return the normal equations with the limit of their own outliers, if it is another one."""
    change = abs(_outlier_limit(normal.parity) - normal.limit)
    if change > LIMIT_CHANGE * normal.limit:
        return normal_equations(model, turned, normal.rotation, vector, columns)
    return normal


def choose(
    model: MotionModel,
    turned: Array,
    seconds: Array,
    first: Fit,
    factor: float,
    progress: Callable[[str, int], None],
) -> tuple[Array, tuple[int, ...], dict[str, str]]:
    """
    Choose the groups of parameters that the motion determines and a held-out part confirms.

    Group by group from the fit of the zeros: those parameters are added whose predicted standard
    deviation is below `DETERMINED` times that before the fit. They stay if the held-out motion
    does not fit worse with them. Groups that fail alone are tried together at the end.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    seconds : ndarray, shape (n,)
        Times of the samples, s.
    first : Fit
        Fit of the zeros to these readings.
    factor : float
        Number of the samples of the whole motion over that of these.
    progress : callable
        Takes name and number of each group.

    Returns
    -------
    vector : ndarray, shape (P,)
        Parameters at which the fit of all samples may start, rad.
    columns : tuple of int
        Places of the parameters to estimate.
    left : dict of str to str
        Groups that are left as drawn, and why.

    Raises
    ------
    CalibrationError
        No sample has an orientation, or the motion is too short to hold out a part.

    """
    layout = model.layout
    selection = _Selection(model, turned, held_out_part(seconds), first)
    left: dict[str, str] = {}
    unconfirmed: dict[str, list[int]] = {}
    for number, group in enumerate(GROUPS[1:], 1):
        progress(group, number)
        better = selection.determined([*layout.columns(group)], factor)
        if not better:
            left[group] = 'the motion does not determine them'
        elif not selection.confirms(better):
            unconfirmed[group] = better
    # A group alone takes the place of those that are missing, and fails elsewhere for that.
    if unconfirmed and selection.confirms(sum(unconfirmed.values(), [])):
        unconfirmed = {}
    left |= dict.fromkeys(unconfirmed, 'they do not explain the held-out motion better')
    return selection.fit.vector, tuple(sorted(selection.columns)), left


class _Selection:
    """
    Parameters that one part of a motion determines and the part held out confirms.

    Attributes
    ----------
    fit : Fit
        Fit of the chosen parameters to the part that is not held out.
    columns : list of int
        Places of the chosen parameters, in the order of their choice.

    """

    def __init__(
        self,
        model: MotionModel,
        turned: Array,
        held: NDArray[np.bool_],
        first: Fit,
    ):
        self._model = model
        self._fitted = turned[~held]
        self._held = turned[held]
        self._share = (~held).mean()
        self.columns = list(first.columns)
        rotation = first.normal.rotation[~held]
        self.fit = fit(
            model,
            self._fitted,
            first.vector,
            first.columns,
            rotation,
        )
        self._squares = _outside(model, self._held, self.fit.vector)

    def determined(
        self,
        wanted: list[int],
        factor: float,
    ) -> list[int]:
        """
        Return which of further parameters the whole motion determines.

        Parameters
        ----------
        wanted : list of int
            Places of the parameters.
        factor : float
            Number of the samples of the whole motion over that of both parts.

        Returns
        -------
        list of int
            Those with a predicted standard deviation below `DETERMINED` times the one before.

        """
        trial = self.columns + wanted
        normal = normal_equations(
            self._model,
            self._fitted,
            self.fit.normal.rotation,
            self.fit.vector,
            tuple(trial),
        )
        before = self._model.layout.deviations[trial]
        information = normal.matrix * factor / self._share + np.diag(before**-2.0)
        after = np.sqrt(np.diag(inverse(information)))
        is_determined = after < DETERMINED * before
        known = len(self.columns)
        further = zip(wanted, is_determined[known:], strict=True)
        return [column for column, good in further if good]

    def confirms(self, more: list[int]) -> bool:
        """Fit with more parameters, and keep them if the held-out part is no worse for it."""
        columns = self.columns + more
        rotation = self.fit.normal.rotation
        found = fit(
            self._model,
            self._fitted,
            self.fit.vector,
            columns,
            rotation,
        )
        squares = _outside(self._model, self._held, found.vector)
        change = squares - self._squares - len(more) / len(self._fitted)
        of_mean = WORSE_DEVIATIONS * change.std() / np.sqrt(len(change))
        if change.mean() > of_mean:
            return False
        self.fit = found
        self.columns = columns
        self._squares = squares
        return True


def held_out_part(seconds: Array) -> NDArray[np.bool_]:
    """
    Return which samples confirm the fit: every third piece of `HELD_OUT_SECONDS`.

    Parameters
    ----------
    seconds : ndarray, shape (n,)
        Times of the samples, s.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for a sample that is held out.

    Raises
    ------
    CalibrationError
        All or none of the samples would be held out.

    """
    piece = np.floor(seconds / HELD_OUT_SECONDS).astype(int)
    held = np.asarray(piece % 3 == 2)
    if held.all() or not held.any():
        raise CalibrationError(
            f'the motion lasts {seconds[-1] - seconds[0]:.1f} s; expected more than '
            f'{2.0 * HELD_OUT_SECONDS:g} s without a long pause: a part of it confirms what the '
            'rest determines'
        )
    return held


def considered_covariance(
    information: Array,
    deviations: Array,
    columns: tuple[int, ...],
) -> Array:
    """
    Return the covariance of all parameters' errors after a fit of some of them.

    The others keep the errors that they had before, which also enter the estimated ones (a
    consider covariance, as in Schmidt's filter).

    Parameters
    ----------
    information : ndarray, shape (P, P)
        Normal matrix of all parameters, 1/rad^2.
    deviations : ndarray, shape (P,)
        Standard deviations before the fit, rad; inf: none.
    columns : tuple of int
        Places of the parameters that were estimated.

    Returns
    -------
    ndarray, shape (P, P)
        Covariance, rad^2.

    """
    inside = np.array(columns)
    others = np.setdiff1d(np.arange(len(deviations)), inside)
    before = np.diag(deviations[inside] ** -2.0)
    own = inverse(information[np.ix_(inside, inside)] + before)
    # Of all errors by those of the others.
    effect = np.eye(len(deviations))[:, others]
    effect[inside] = -own @ information[np.ix_(inside, others)]
    found: Array = (effect * deviations[others] ** 2) @ effect.T
    found[np.ix_(inside, inside)] += own
    return found


def _outside(
    model: MotionModel,
    turned: Array,
    vector: Array,
) -> Array:
    """
    Return the squared parities of held-out samples, outliers at their limit.

    Returns
    -------
    ndarray, shape (n,)
        Squares, in variances of white noise.

    """
    rotation = model.orientations(turned, vector)
    normal = normal_equations(model, turned, rotation, vector, ())
    size = np.linalg.norm(normal.parity, axis=1)
    squares: Array = np.fmin(size, normal.limit) ** 2
    return squares
