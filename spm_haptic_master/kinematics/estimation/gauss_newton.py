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
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.estimation.linearisation import Legs, linearise, State
from spm_haptic_master.kinematics.estimation.normal_equations import (
    gauss_newton_step,
    in_base_frame,
    normal_equations,
    parities,
)
from spm_haptic_master.kinematics.estimation.sample_estimate import (
    DETERMINED_DEVIATION,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion, Linkage, linkage
from spm_haptic_master.kinematics.number_backends import FLOATS

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
# Largest |B_kk| of the wrong sign that noise may cause near the boundary of a working mode (unit
# 1).
MODE_MARGIN = 0.02
# Largest total variance of a determined orientation (rad^2).
DETERMINED_VARIANCE = DETERMINED_DEVIATION ** 2


def fit(state: State[float], view: Linkage[float], readings: tuple[float, ...],
        sensors: UsedSensors, g: Geometry, working_mode: WorkingMode | None,
        last_step: float = CONVERGED_STEP) -> SampleEstimate:
    """
    Gauss-Newton to convergence, from a start with its `linkage`.

    Parameters, and what is raised, are those of `estimate_sample`; a direction that is not
    measured raises SingularityError, readings near which no mechanism closes UnreachableError.
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
            d1, d2, d3, db, dc = _shortened(step)
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
    parity_sizes = tuple(map(math.hypot, *changes)) if changes else (0.0,) * len(rows)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = motions
    gain_sizes = tuple([
        weight * math.hypot(x * ax + y * bx + z * cx, x * ay + y * by + z * cy,
                            x * az + y * bz + z * cz) for _, x, y, z, weight in rows])
    return SampleEstimate(
        chain_quaternion(th1a, th2a, th3a, g, FLOATS), covariance,
        vector[0] if len(vector) == 1 else math.hypot(*vector) if vector else None, vector,
        covariance[0] + covariance[4] + covariance[8] < DETERMINED_VARIANCE, sensors,
        parity_sizes, gain_sizes, rows, spread, motions)


def _shortened(step: State[float]) -> State[float]:
    """Return a step of which no component is longer than `LONGEST_STEP`."""
    longest = max(map(abs, step))
    if longest < LONGEST_STEP:
        return step
    scale = LONGEST_STEP / longest
    d1, d2, d3, db, dc = step
    return scale * d1, scale * d2, scale * d3, scale * db, scale * dc


def _in_mode(th2a: float, legs: Legs[float], sensors: UsedSensors, working_mode: WorkingMode,
             g: Geometry) -> bool:
    """Return whether a solution is in a working mode; a leg without a sensor may have any."""
    sign_a, sign_b, sign_c = working_mode
    leg = g.legs[0]
    weight_a, _, _, weight_3, _, _ = sensors.weights
    # B_AA is the volume of Z1A, Z2A, Z3A.
    return sign_b * legs[0][4] > -MODE_MARGIN and sign_c * legs[1][4] > -MODE_MARGIN and (
        sign_a * leg.sin_alpha * leg.sin_beta * math.sin(th2a) > -MODE_MARGIN
        or not (weight_a or weight_3))
