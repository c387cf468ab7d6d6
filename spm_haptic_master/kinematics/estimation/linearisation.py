# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Residuals and rates of all sensors at a state, to first order: kernels of the estimate.

State: the fitted th1A, th2A, th3A, th1B, th1C, rad. Leg A's chain carries the platform: its joints
are coordinates of the orientation. The legs B and C add their closures. A sensor's row has its
residual and its rates along th1A, th2A, th3A, with the closure of its own leg kept.
"""

from __future__ import annotations

from typing import TypeAlias

from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_constants import Leg
from spm_haptic_master.kinematics.leg_kernels import Linkage, turn_through_link, View
from spm_haptic_master.kinematics.number_backends import Backend, N, Vector

State: TypeAlias = tuple[N, N, N, N, N]
# Correction of a leg's active angle (rad), its rates along th1A, th2A, th3A (unit 1), and B_kk.
Closure: TypeAlias = tuple[N, N, N, N, N]
Legs: TypeAlias = tuple[Closure[N], Closure[N]]
# Residual (rad), rates along th1A, th2A, th3A (unit 1) and weight (1 / rad^2) of a sensor.
Row: TypeAlias = tuple[N, N, N, N, float]
# Z1k, Z2k, Z3k and Z3k x Z2k of leg B or C after leg A's second joint, and -1 / B_kk (unit 1).
LegVectors: TypeAlias = tuple[Vector[N], Vector[N], Vector[N], Vector[N], N]
# Closure and axes of a leg without a sensor, and the row of a sensor that is left out.
NO_VECTOR = 0.0, 0.0, 0.0
NO_LEG = (0.0, 0.0, 0.0, 0.0, 0.0), (NO_VECTOR, NO_VECTOR, NO_VECTOR, NO_VECTOR, 0.0)
NO_ROW = 0.0, 0.0, 0.0, 0.0, 0.0


def linearise(state: State[N], view: Linkage[N], readings: tuple[N, ...], sensors: UsedSensors,
              g: Geometry, m: Backend[N]) -> tuple[Legs[N], tuple[Row[N], ...]]:
    """
    Linearise the legs B and C and all sensors at a state with its `linkage`.

    `readings` are those of the N mounted sensors, rad; any number for one that is left out.

    Returns
    -------
    legs : tuple of two 5-tuples of numbers
        Fitted active angle less the one that closes leg B or C, rad; rates of the closing angle
        along th1A, th2A, th3A, and B_kk (unit 1). Zeros for a leg without a sensor in use.
    rows : tuple of N 5-tuples of numbers
        Reading less prediction, rad, its rates and its weight, 0 for a sensor that is left out.

    """
    th1a, th2a, th3a, th1b, th1c = state
    c1, s1, leg_b, leg_c = view
    weight_a, weight_b, weight_c, weight_3, weight_3b, weight_3c = sensors.weights
    c2, s2 = m.cos(th2a), m.sin(th2a)
    # The active axes: Z1A after leg A's second joint, the others before it.
    carrier, (b, c) = g.legs[0], g.carried
    first_a = carrier.sin_alpha * s2, carrier.sin_alpha * c2, carrier.cos_alpha
    closure_b, vectors_b = leg_closure(
        c2, s2, first_a, turn_through_link(c1, -s1, b.first), leg_b, carrier, m,
    ) if weight_b or weight_3b else NO_LEG
    closure_c, vectors_c = leg_closure(
        c2, s2, first_a, turn_through_link(c1, -s1, c.first), leg_c, carrier, m,
    ) if weight_c or weight_3c else NO_LEG
    left_b, b1, b2, b3, _ = closure_b
    left_c, d1, d2, d3, _ = closure_c
    rows: tuple[Row[N], ...] = (
        (readings[0] - th1a, 1.0, 0.0, 0.0, weight_a),
        (readings[1] - th1b + left_b, b1, b2, b3, weight_b),
        (readings[2] - th1c + left_c, d1, d2, d3, weight_c),
        (readings[3] - th3a, 0.0, 0.0, 1.0, weight_3))
    if sensors.further:
        rows += third_joints(m.cos(th3a), m.sin(th3a), first_a, vectors_b, vectors_c,
                             (left_b, left_c), readings, sensors, g, m)
    return (closure_b, closure_c), rows


def leg_closure(c2: N, s2: N, first_a: Vector[N], first: Vector[N], leg: View[N], carrier: Leg,
                m: Backend[N]) -> tuple[Closure[N], LegVectors[N]]:
    """Return the closure of leg B or C as of `linearise`, and its axes."""
    (dx, dy, dz), (vx, vy, vz), cos_beta = leg
    ux, uy, uz = first
    ax, ay, az = first_a
    # From before leg A's second joint to after it.
    dx, dy, ux, uy = c2 * dx + s2 * dy, c2 * dy - s2 * dx, c2 * ux + s2 * uy, c2 * uy - s2 * ux
    # A turn of the platform about a unit axis changes Z2k . Z3k at the rate axis . (Z3k x Z2k).
    x, y, z = vy * dz - vz * dy, vz * dx - vx * dz, vx * dy - vy * dx
    # Along the leg's own active angle it changes at the rate B_kk = -Z1k . (Z3k x Z2k).
    along = ux * x + uy * y + uz * z
    reciprocal = m.mode_reciprocal(along)
    return ((-(dx * vx + dy * vy + dz * vz - cos_beta) * reciprocal,
             (ax * x + ay * y + az * z) * reciprocal, z * reciprocal,
             (carrier.cos_beta * z - carrier.sin_beta * y) * reciprocal, -along),
            ((ux, uy, uz), (dx, dy, dz), leg[1], (x, y, z), reciprocal))


def third_joints(c3: N, s3: N, first_a: Vector[N], vectors_b: LegVectors[N],
                 vectors_c: LegVectors[N], corrections: tuple[N, N], readings: tuple[N, ...],
                 sensors: UsedSensors, g: Geometry, m: Backend[N]) -> tuple[Row[N], ...]:
    """
    Rows of the mounted sensors on th3B and th3C; other arguments as of `linearise`.

    `c3` and `s3` are cosine and sine of th3A, `first_a` is Z1A after leg A's second joint, and
    `corrections` are fitted th1B and th1C less those that close their legs, rad.
    """
    _, _, _, _, weight_b, weight_c = sensors.weights
    carrier, leg_b, leg_c = g.legs
    b, c = g.carried
    first = _third_joint(
        first_a, vectors_b, turn_through_link(c3, s3, b.zero), corrections[0], readings[4],
        weight_b, leg_b, carrier, m) if weight_b else NO_ROW
    if sensors.further == 1:
        return (first,)
    return first, _third_joint(
        first_a, vectors_c, turn_through_link(c3, s3, c.zero), corrections[1], readings[5],
        weight_c, leg_c, carrier, m) if weight_c else NO_ROW


def _third_joint(first_a: Vector[N], vectors: LegVectors[N], zero: Vector[N], correction: N,
                 reading: N, weight: float, leg: Leg, carrier: Leg, m: Backend[N]) -> Row[N]:
    """
    Row of the sensor on the third joint of a closed leg; `zero`: where th3k is measured from.

    The rates of th3k are (Z1k x Z2k) . axis / B_kk (unit 1).
    """
    (ux, uy, uz), (dx, dy, dz), (vx, vy, vz), (mx, my, mz), reciprocal = vectors
    ex, ey, ez = zero
    # Z2k is (sin beta sin th3k, sin beta cos th3k, cos beta) in the frame Q_k of the platform.
    sine, cosine = ex * dx + ey * dy + ez * dz, -(ex * mx + ey * my + ez * mz)
    c, s = m.cos(reading), m.sin(reading)
    angle = m.atan2(s * cosine - c * sine, c * cosine + s * sine)
    # A turn of Z2k about Z1k alone changes th3k at the rate (Z2k x Z3k).(Z1k x Z2k) / sin^2 beta.
    rate = ((leg.cos_alpha * leg.cos_beta - vx * ux - vy * uy - vz * uz)
            / (leg.sin_beta * leg.sin_beta))
    x, y, z = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
    ax, ay, az = first_a
    return (angle + rate * correction, (ax * x + ay * y + az * z) * reciprocal, z * reciprocal,
            (carrier.cos_beta * z - carrier.sin_beta * y) * reciprocal, weight)
