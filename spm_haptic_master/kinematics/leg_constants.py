# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Constants of the legs that the formulas take from a geometry: frames, and axes through links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from spm_haptic_master.kinematics.checks import ThreeAxes
from spm_haptic_master.kinematics.number_backends import Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    rotation_from_quaternion,
)

# x, y, c x, c y, s z, s x, s y, c z of an axis (x, y, z) and a link with cosine c and sine s.
LinkTurn = tuple[float, float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Leg:
    """Constants of one leg: links' angles (unit 1), axes and frames."""

    cos_alpha: float
    sin_alpha: float
    cos_beta: float
    sin_beta: float
    first: Vector[float]  # Z1k in the base frame
    second: ThreeAxes  # p, q, r of Z2k = p + q cos th1k + r sin th1k, in the base frame
    third: Vector[float]  # Z3k in the platform frame
    base_frame: Rotation[float]  # B_k, row by row; its third column is Z1k
    platform_frame: Rotation[float]  # Q_k, row by row; its third column is Z3k


@dataclass(frozen=True, slots=True)
class Carried:
    """Constants of leg B or C seen from leg A, which carries the platform."""

    cos_beta: float  # cosine of the distal link's angle (unit 1)
    first: LinkTurn  # of Z1k from leg A's frame B_A through its proximal link: Rx(-alpha)
    # p, q, r of `Leg.second`, in leg A's frame B_A; cosine and sine of leg A's alpha.
    second: tuple[float, float, float, float, float, float, float, float, float, float, float]
    third: Vector[float]  # Z3k in leg A's frame Q_A, i.e. after its third joint
    # Through leg A's distal link, Rx(beta), of `third`, and of the direction from which th3k is
    # measured, the first axis of Q_k.
    before_distal: LinkTurn
    zero: LinkTurn


def leg_frame(turn: Quaternion[float], axis: Sequence[float]) -> Quaternion[float]:
    """Turn a leg's frame N_k by the smallest rotation that takes its z to an axis."""
    tx, ty, tz, tw = turn
    rows = rotation_from_quaternion(-tx, -ty, -tz, tw)
    x, y, z = (sum(rows[3 * i + j] * axis[j] for j in range(3)) for i in range(3))
    sine = math.hypot(x, y)
    half = 0.5 * math.atan2(sine, z)
    scale = math.sin(half) / sine if sine > 0.0 else 0.0
    return multiply_quaternions(turn, (-scale * y, scale * x, 0.0, math.cos(half)))


def leg_constants(alpha: float, beta: float, base: Quaternion[float],
                  platform: Quaternion[float]) -> Leg:
    """Return the constants of a leg from its link angles and its frames B_k and Q_k."""
    in_base, in_platform = rotation_from_quaternion(*base), rotation_from_quaternion(*platform)
    ca, sa = math.cos(alpha), math.sin(alpha)
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = in_base[:3], in_base[3:6], in_base[6:]
    return Leg(
        ca, sa, math.cos(beta), math.sin(beta), (zx, zy, zz),
        ((ca * zx, ca * zy, ca * zz), (-sa * yx, -sa * yy, -sa * yz),
         (sa * xx, sa * xy, sa * xz)),
        (in_platform[2], in_platform[5], in_platform[8]), in_base, in_platform)


def carried_constants(leg: Leg, carrier: Leg) -> Carried:
    """Return the constants of leg B or C from those of leg A."""
    def into(frame: Rotation[float], axis: tuple[float, ...]) -> Vector[float]:
        x, y, z = (sum(frame[3 * i + j] * axis[i] for i in range(3)) for j in range(3))
        return x, y, z

    p, q, r = (into(carrier.base_frame, axis) for axis in leg.second)
    third = into(carrier.platform_frame, leg.third)
    zero = into(carrier.platform_frame, leg.platform_frame[::3])
    return Carried(
        leg.cos_beta,
        _link_turn(into(carrier.base_frame, leg.first), carrier.cos_alpha, -carrier.sin_alpha),
        (*p, *q, *r, carrier.cos_alpha, carrier.sin_alpha), third,
        _link_turn(third, carrier.cos_beta, carrier.sin_beta),
        _link_turn(zero, carrier.cos_beta, carrier.sin_beta))


def _link_turn(axis: Vector[float], cosine: float, sine: float) -> LinkTurn:
    """Return the constants of Rx(link) Rz(t) axis, from cosine and sine of the link's angle."""
    x, y, z = axis
    return x, y, cosine * x, cosine * y, sine * z, sine * x, sine * y, cosine * z
