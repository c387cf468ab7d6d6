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

import math

from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion, Linkage, linkage
from spm_haptic_master.kinematics.normal_equations import (
    gauss_newton_step,
    in_base_frame,
    inverse_normal,
    linearise,
    normal_equations,
    parity_of,
    Readings,
    residuals_of,
    State,
    Weights,
)
from spm_haptic_master.kinematics.number_backends import FLOATS
from spm_haptic_master.kinematics.passive_sensors import (
    linearise_more,
    NO_THIRDS,
    normal_equations_of_more,
    parity_of_more,
    SixReadings,
    SixWeights,
)
from spm_haptic_master.kinematics.sample_estimate import DETERMINED_DEVIATION, SampleEstimate

# Largest last Gauss-Newton step (rad): each step is shorter than the one before by a factor of the
# noise (in rad) or less, so that the error after this one is 1e-8 rad at 0.04 deg.
CONVERGED_STEP = 1e-5

# Largest number of Gauss-Newton steps; two are usual.
STEPS = 30

# Longest step along any coordinate (rad); a longer one is shortened to it.
LONGEST_STEP = 0.3

# Largest determinant of the normal equations, relative to the product of their diagonal, that
# counts as zero (unit 1).
RANK_TOLERANCE = 1e-12


def fit(th2a: float, view: Linkage[float], readings: Readings[float], weights: Weights,
        g: Geometry, last_step: float = CONVERGED_STEP) -> SampleEstimate:
    """
    Gauss-Newton to convergence with four sensors, or three of them.

    Parameters
    ----------
    th2a : float
        Start of leg A's first passive joint, rad.
    view : Linkage
        `linkage` of the readings.
    readings : tuple of four float
        th1A, th1B, th1C, th3A, rad; the start of a missing one.
    weights : tuple of four float
        1 / sigma^2, 1 / rad^2; 0 of a missing one.
    g : Geometry
        Link angles and axes.
    last_step : float
        Largest last step, rad.

    Raises
    ------
    SingularityError
        A direction is not measured, or a leg is on the boundary of its working mode.
    UnreachableError
        The mechanism does not close near the readings.

    """
    th1a, th1b, th1c, th3a = readings
    for _ in range(STEPS):
        state = th1a, th2a, th3a, th1b, th1c
        legs, _, _, _ = linearise(th2a, *view, weights, g, FLOATS)
        residuals = residuals_of(state, readings, legs)
        matrix, right = normal_equations(residuals, legs, weights)
        entries, determinant, product = inverse_normal(matrix)
        if not determinant > RANK_TOLERANCE * product:
            raise _not_measured(readings)
        d1, d2, d3, db, dc = step = gauss_newton_step(right, legs, entries, determinant)
        # Both tests by comparison: a call for each component costs as much as the step.
        converged = _within(last_step, d1, d2, d3, db, dc)
        if not converged and not _within(LONGEST_STEP, d1, d2, d3, db, dc):
            d1, d2, d3, db, dc = _shortened(step)
        th1a, th2a, th3a, th1b, th1c = th1a + d1, th2a + d2, th3a + d3, th1b + db, th1c + dc
        if converged:
            break
        view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
    else:
        raise _not_closed(readings)
    parity = parity_of(residuals, legs, weights, FLOATS) if all(weights) else None
    covariance, motions = in_base_frame(th1a, th2a, entries, determinant, g, FLOATS)
    determined = (covariance[0] + covariance[4] + covariance[8]
                  < DETERMINED_DEVIATION * DETERMINED_DEVIATION)
    return SampleEstimate(
        chain_quaternion(th1a, th2a, th3a, g, FLOATS), covariance, parity, determined, legs,
        weights, motions, () if parity is None else (parity,), NO_THIRDS, entries, determinant)


def fit_more(state: State[float], view: Linkage[float], readings: SixReadings[float],
             weights: SixWeights, sensors: int, g: Geometry,
             last_step: float = CONVERGED_STEP) -> SampleEstimate:
    """
    Gauss-Newton to convergence with five or six sensors, or all but one of them.

    Parameters
    ----------
    state : tuple of five float
        Start of th1A, th2A, th3A, th1B, th1C, rad: readings where there are any.
    view : Linkage
        `linkage` of the start.
    readings : tuple of six float
        th1A, th1B, th1C, th3A, th3B, th3C, rad; any number for a missing one.
    weights : tuple of six float
        1 / sigma^2, 1 / rad^2; 0 of a missing one.
    sensors : {5, 6}
        Number of sensors, with a missing one.
    g, last_step
        As of `fit`; so are the errors.

    """
    th1a, th2a, th3a, th1b, th1c = state
    reading_a, reading_b, reading_c, reading_3, reading_3b, reading_3c = readings
    four = reading_a, reading_b, reading_c, reading_3
    turns = ((math.cos(reading_3b), math.sin(reading_3b)),
             (math.cos(reading_3c), math.sin(reading_3c)))
    for _ in range(STEPS):
        state = th1a, th2a, th3a, th1b, th1c
        legs, residuals, thirds = linearise_more(
            state, view, four, turns, weights, g, FLOATS)
        matrix, right = normal_equations_of_more(residuals, legs, thirds, weights)
        entries, determinant, product = inverse_normal(matrix)
        if not determinant > RANK_TOLERANCE * product:
            raise _not_measured(readings)
        d1, d2, d3, db, dc = step = gauss_newton_step(right, legs, entries, determinant)
        converged = _within(last_step, d1, d2, d3, db, dc)
        if not converged and not _within(LONGEST_STEP, d1, d2, d3, db, dc):
            d1, d2, d3, db, dc = _shortened(step)
        th1a, th2a, th3a, th1b, th1c = th1a + d1, th2a + d2, th3a + d3, th1b + db, th1c + dc
        if converged:
            break
        view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
    else:
        raise _not_closed(readings)
    parities = parity_of_more(
        residuals, legs, thirds, weights, entries, determinant, step, FLOATS)
    covariance, motions = in_base_frame(th1a, th2a, entries, determinant, g, FLOATS)
    determined = (covariance[0] + covariance[4] + covariance[8]
                  < DETERMINED_DEVIATION * DETERMINED_DEVIATION)
    return SampleEstimate(
        chain_quaternion(th1a, th2a, th3a, g, FLOATS), covariance,
        parities[0] if len(parities) == 1 else math.hypot(*parities), determined, legs,
        weights[:sensors], motions, parities, thirds, entries, determinant)


def _within(limit: float, d1: float, d2: float, d3: float, db: float, dc: float) -> bool:
    """Return whether each component of a step is smaller than a limit."""
    return -limit < d1 < limit and -limit < d2 < limit and -limit < d3 < limit \
        and -limit < db < limit and -limit < dc < limit


def _shortened(step: State[float]) -> State[float]:
    """Return a step of which the longest component is `LONGEST_STEP`."""
    scale = LONGEST_STEP / max(map(abs, step))
    d1, d2, d3, db, dc = step
    return scale * d1, scale * d2, scale * d3, scale * db, scale * dc


def _not_measured(readings: tuple[float, ...]) -> SingularityError:
    return SingularityError(
        f'readings {readings} rad: the sensors do not measure every direction')


def _not_closed(readings: tuple[float, ...]) -> UnreachableError:
    return UnreachableError(f'readings {readings} rad: no mechanism closes near them')
