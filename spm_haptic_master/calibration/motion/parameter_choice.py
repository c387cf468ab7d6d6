# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which parameters a motion determines and a part of it that was not used confirms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.coverage import inverse
from spm_haptic_master.calibration.motion.fit import Fit, fit, normal_equations, outlier_limit
from spm_haptic_master.calibration.motion.mechanism_parameters import Array, GROUPS
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.exceptions import CalibrationError

# Predicted standard deviation of a parameter over that before the fit, below which the motion
# determines it (unit 1).
DETERMINED = 0.95
# Length of the pieces of the motion of which every third is held out (s).
HELD_OUT_SECONDS = 2.0
# Standard errors by which a larger model may be worse on the held-out motion than the noise makes
# it: one number for each parameter over the number of samples fitted.
WORSE = 3.0


def choose(model: MotionModel, turned: Array, seconds: Array, first: Fit, factor: float,
           progress: Callable[[str, int], None]) -> tuple[Array, tuple[int, ...], dict[str, str]]:
    """
    Return the start of a fit, the parameters to estimate, and which groups are left, and why.

    It goes group by group from the fit of the zeros to readings, (n, N), rad, of which the whole
    motion has `factor` times as many; `progress` takes the name and number of each group.
    """
    layout = model.layout
    held = held_out_part(seconds)
    fitted = ~held
    best = fit(model, turned[fitted], first.vector, first.columns, first.normal.rotation[fitted])
    outside = _outside(model, turned[held], best.vector)
    left: dict[str, str] = {}
    columns = list(first.columns)
    unconfirmed: dict[str, list[int]] = {}

    def confirmed(more: list[int]) -> bool:
        """Fit with more columns, and keep them if the held-out motion is no worse for it."""
        nonlocal best, columns, outside
        found = fit(model, turned[fitted], best.vector, columns + more, best.normal.rotation)
        now = _outside(model, turned[held], found.vector)
        change = now - outside - len(more) / fitted.sum()
        if change.mean() > WORSE * change.std() / np.sqrt(len(change)):
            return False
        best, columns, outside = found, columns + more, now
        return True

    for number, group in enumerate(GROUPS[1:], 1):
        progress(group, number)
        wanted = [*layout.columns(group)]
        trial = columns + wanted
        normal = normal_equations(model, turned[fitted], best.normal.rotation, best.vector,
                                  tuple(trial))
        after = np.sqrt(np.diag(inverse(
            normal.matrix * factor / fitted.mean() + np.diag(layout.deviations[trial] ** -2.0))))
        better = [column for column, each in zip(wanted, after[len(columns):], strict=True)
                  if each < DETERMINED * layout.deviations[column]]
        if not better:
            left[group] = 'the motion does not determine them'
        elif not confirmed(better):
            unconfirmed[group] = better
    # A group alone takes the place of those that are missing, and fails elsewhere for that.
    if unconfirmed and confirmed(sum(unconfirmed.values(), [])):
        unconfirmed = {}
    left |= dict.fromkeys(unconfirmed, 'they do not explain the held-out motion better')
    return best.vector, tuple(sorted(columns)), left


def held_out_part(seconds: Array) -> NDArray[np.bool_]:
    """
    Return which samples, by their times, confirm the parameters that the others determine.

    CalibrationError where the motion is too short to hold out a part of it.
    """
    held: NDArray[np.bool_] = np.floor(seconds / HELD_OUT_SECONDS).astype(int) % 3 == 2
    if held.all() or not held.any():
        raise CalibrationError(
            f'the motion lasts {seconds[-1] - seconds[0]:.1f} s; expected more than '
            f'{2.0 * HELD_OUT_SECONDS:g} s without a long pause: a part of it confirms what the '
            'rest determines')
    return held


def considered_covariance(information: Array, deviations: Array,
                          columns: tuple[int, ...]) -> Array:
    """
    Return the covariance of all parameters' errors after a fit of some of them, rad^2, (P, P).

    The others keep the errors that they had before, `deviations`, which also enter the estimated
    ones; `information` is the normal matrix of all parameters.
    """
    found = np.zeros_like(information)
    inside = np.array(columns)
    others = np.setdiff1d(np.arange(len(deviations)), inside)
    weights = deviations ** -2.0
    own = inverse(information[np.ix_(inside, inside)] + np.diag(weights[inside]))
    gain = own @ information[np.ix_(inside, others)]
    before = np.diag(deviations[others] ** 2)
    found[np.ix_(inside, inside)] = own + gain @ before @ gain.T
    found[np.ix_(inside, others)] = -gain @ before
    found[np.ix_(others, inside)] = -before @ gain.T
    found[np.ix_(others, others)] = before
    return found


def _outside(model: MotionModel, turned: Array, vector: Array) -> Array:
    """Return the squared parities of held-out samples, outliers at their limit (unit 1)."""
    normal = normal_equations(model, turned, model.orientations(turned, vector), vector, ())
    limit = outlier_limit(normal)
    found: Array = np.minimum(np.nan_to_num(normal.sizes, nan=limit), limit) ** 2
    return found
