# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Residuals and rates of all sensors at a state, to first order: kernels of the estimate.

State: the fitted th1A, th2A, th3A, th1B, th1C, rad. Leg A's chain carries the platform: its joints
are coordinates of the orientation. The legs B and C add their closures. A sensor's row has its
residual and its rates along th1A, th2A, th3A, with the closure of its own leg kept.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_kernels import (
    Linkage,
    Turn,
    turn_through_link,
    View,
)
from spm_haptic_master.kinematics.number_backends import Backend, N

TURN = 2.0 * math.pi
State: TypeAlias = tuple[N, N, N, N, N]
# Correction of a leg's active angle (rad), its rates along th1A, th2A, th3A (unit 1), and B_kk.
Closure: TypeAlias = tuple[N, N, N, N, N]
Legs: TypeAlias = tuple[Closure[N], Closure[N]]
# Residual (rad), rates along th1A, th2A, th3A (unit 1) and weight (1 / rad^2) of a sensor.
Row: TypeAlias = tuple[N, N, N, N, float]
# Cosines and sines of th1A, th2A and th3A (unit 1).
Turns: TypeAlias = tuple[Turn[N], Turn[N], Turn[N]]
# The row of a sensor that is left out; closure of a leg without a sensor, and that row.
NO_ROW = 0.0, 0.0, 0.0, 0.0, 0.0
NO_LEG = NO_ROW, NO_ROW


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
    turn_1, turn_3, leg_b, leg_c = view
    weight_a, weight_b, weight_c, weight_3, weight_3b, weight_3c = sensors.weights
    turns = turn_1, (m.cos(th2a), m.sin(th2a)), turn_3
    closure_b, row_b = closed_leg(
        turns, leg_b, g, 1, readings[4] if weight_3b else None, weight_3b, m,
    ) if weight_b or weight_3b else NO_LEG
    closure_c, row_c = closed_leg(
        turns, leg_c, g, 2, readings[5] if weight_3c else None, weight_3c, m,
    ) if weight_c or weight_3c else NO_LEG
    left_b, b1, b2, b3, _ = closure_b
    left_c, d1, d2, d3, _ = closure_c
    rows = (
        (readings[0] - th1a, 1.0, 0.0, 0.0, weight_a),
        (readings[1] - th1b + left_b, b1, b2, b3, weight_b),
        (readings[2] - th1c + left_c, d1, d2, d3, weight_c),
        (readings[3] - th3a, 0.0, 0.0, 1.0, weight_3), row_b, row_c)
    return (closure_b, closure_c), rows[:4 + sensors.further]


def closed_leg(turns: Turns[N], view: View[N], g: Geometry, place: int, reading: N | None,
               weight: float, m: Backend[N]) -> tuple[Closure[N], Row[N]]:
    """
    Linearise leg B or C: its closure, and the row of a sensor on its third joint.

    `place` is 1 or 2, `reading` that of the sensor, rad; None for one that is left out. Returned
    are the elements of `linearise`.
    """
    (c1, s1), (c2, s2), (c3, s3) = turns
    (dx, dy, dz), (vx, vy, vz), cos_beta = view
    carrier, carried = g.legs[0], g.carried[place - 1]
    ux, uy, uz = turn_through_link(c1, -s1, carried.first)
    # Z1A, and Z1k and Z2k from before leg A's second joint to after it.
    ax, ay, az = carrier.sin_alpha * s2, carrier.sin_alpha * c2, carrier.cos_alpha
    dx, dy, ux, uy = c2 * dx + s2 * dy, c2 * dy - s2 * dx, c2 * ux + s2 * uy, c2 * uy - s2 * ux
    # A turn of the platform about a unit axis changes Z2k . Z3k at the rate axis . (Z3k x Z2k).
    x, y, z = vy * dz - vz * dy, vz * dx - vx * dz, vx * dy - vy * dx
    # Along the leg's own active angle it changes at the rate B_kk = -Z1k . (Z3k x Z2k).
    along = ux * x + uy * y + uz * z
    reciprocal = m.mode_reciprocal(along)
    left = -(dx * vx + dy * vy + dz * vz - cos_beta) * reciprocal
    closure = (left, (ax * x + ay * y + az * z) * reciprocal, z * reciprocal,
               (carrier.cos_beta * z - carrier.sin_beta * y) * reciprocal, -along)
    if reading is None:
        return closure, NO_ROW
    # Z2k is (sin beta sin th3k, sin beta cos th3k, cos beta) in the frame Q_k of the platform.
    # As turn_through_link(c3, s3, carried.zero) does, without its call.
    zx, zy, cx, cy, sz, sx, sy, cz = carried.zero
    ex, ey, ez = c3 * zx - s3 * zy, s3 * cx + c3 * cy - sz, s3 * sx + c3 * sy + cz
    sine, cosine = ex * dx + ey * dy + ez * dz, -(ex * x + ey * y + ez * z)
    angle = m.remainder(reading - m.atan2(sine, cosine), TURN)
    # A turn of Z2k about Z1k alone changes th3k at the rate (Z2k x Z3k).(Z1k x Z2k) / sin^2 beta.
    leg = g.legs[place]
    rate = ((leg.cos_alpha * leg.cos_beta - vx * ux - vy * uy - vz * uz)
            / (leg.sin_beta * leg.sin_beta))
    # A turn of the platform changes it at the rate axis . (Z1k x Z2k) / B_kk.
    x, y, z = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
    return closure, (angle + rate * left, (ax * x + ay * y + az * z) * reciprocal, z * reciprocal,
                     (carrier.cos_beta * z - carrier.sin_beta * y) * reciprocal, weight)
