# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How far a rig is from its drawing, estimated from the rig itself.

The tolerances given are upper bounds. What a motion hardly determines is held by them, and bounds
of errors are as large as they are. The parameters that a motion determines show how well the rig
was built: their mean square is the tolerance's square (empirical Bayes; found by expectation
maximisation, in which the variance that the fit leaves is added to each square).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import sqrt

import numpy as np
from spm_haptic_master.calibration.motion.coverage import inverse
from spm_haptic_master.calibration.motion.model import Array, Layout, SECOND_HARMONIC

# Groups whose parameters share a tolerance, with the factor that makes its size theirs (unit 1).
MECHANISM = {'links': 1.0, 'base axes': 1.0, 'platform axes': 1.0}
HARMONICS = {'first harmonics': 1.0, 'second harmonics': SECOND_HARMONIC}
# Number of parameters that the tolerance given counts as: so few parameters show a rig's
# tolerance to some 20 % only, and none of 0.
GIVEN_COUNTS = 1.0
# Largest number of estimates, and the relative change of a tolerance that ends them (unit 1).
ESTIMATES = 200
CONVERGED = 1e-3


def estimated_tolerances(
    layout: Layout,
    vector: Array,
    columns: Sequence[int],
    information: Array,
) -> Layout:
    """
    Return a layout with the tolerances that a fit shows; at most those of the layout given.

    Empirical Bayes by expectation maximisation: the expected square of each parameter is that of
    its value plus the variance that the fit leaves, and the mean of these squares is the square of
    the next tolerance, until it no longer changes.

    Parameters
    ----------
    layout : Layout
        The rig as drawn, with the tolerances that the fit used.
    vector : ndarray, shape (P,)
        Parameters of the fit, rad.
    columns : sequence of int
        Places of the parameters that were estimated.
    information : ndarray
        Normal matrix of these by the readings alone, 1/rad^2.

    Returns
    -------
    Layout
        The same rig. A group that the fit left as drawn shows nothing of its tolerance.

    """
    places = np.array(columns)
    # The fit is where (information + weights) vector = right.
    before = np.diag(layout.deviations[places] ** -2.0)
    right = (information + before) @ vector[places]
    estimated = layout
    for _ in range(ESTIMATES):
        # Expectation: the fit with the tolerances so far, and the variance that it leaves.
        covariance = inverse(information + np.diag(estimated.deviations[places] ** -2.0))
        squares = np.zeros(layout.count)
        squares[places] = (covariance @ right) ** 2 + np.diag(covariance)
        before = estimated.deviations[layout.sensors :]
        # Maximisation: the tolerances with which these squares are most likely.
        estimated = replace(
            layout,
            mechanism_tolerance=_tolerance(
                layout,
                MECHANISM,
                layout.mechanism_tolerance,
                squares,
                columns,
            ),
            harmonic_tolerance=_tolerance(
                layout,
                HARMONICS,
                layout.harmonic_tolerance,
                squares,
                columns,
            ),
        )
        after = estimated.deviations[layout.sensors :]
        if np.allclose(
            before,
            after,
            rtol=CONVERGED,
            atol=0.0,
        ):
            break
    return estimated


def _tolerance(
    layout: Layout,
    groups: dict[str, float],
    given: float,
    squares: Array,
    columns: Sequence[int],
) -> float:
    """
    Return the tolerance that the expected squares of parameters show.

    The root of their mean square; the given tolerance counts as `GIVEN_COUNTS` parameters more.

    Parameters
    ----------
    layout : Layout
        The rig as drawn, and the meaning of the parameter vector.
    groups : dict of str to float
        Groups that share the tolerance, with the factor that makes its size theirs.
    given : float
        The given tolerance, rad: the largest that is returned.
    squares : ndarray, shape (P,)
        Expected squares of all parameters, rad^2.
    columns : sequence of int
        Places of the parameters that were estimated; a group counts if all of its were.

    Returns
    -------
    float
        rad.

    """
    total = GIVEN_COUNTS * given**2
    number = GIVEN_COUNTS
    for group, factor in groups.items():
        own = layout.columns(group)
        if not set(own) <= set(columns):
            continue
        total += float(squares[list(own)].sum()) / factor**2
        number += len(own)
    return min(given, sqrt(total / number))
