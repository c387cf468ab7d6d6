# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A soft wall before the end of the workspace.

The angle gamma between the axes Z1k and Z3k of a leg is at most alpha + beta, where its links are
stretched, and at least |alpha - beta|, where they are folded. The handle reaches such an end of a
leg by tilting or by turning about its own axis. Turning with the angular velocity w changes the
angle by

    d gamma / dt = n . w,        n = Z1k x Z3k / |Z1k x Z3k|

so that a torque along -n or n pushes back. Within `end_stop` of an end, at a depth d,

    torque = min(K, limit / end_stop) max(0, d + LEAD d'),        K = 2 N m/rad

which is a spring with the damping K LEAD that never pulls. Without the damping it is conservative.
A handle that moves towards the end meets it LEAD d' earlier.
"""

from __future__ import annotations

from math import acos, cos, sqrt

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.statics import LegPose, Statics
from spm_haptic_master.force.vectors import NOTHING
from spm_haptic_master.kinematics.geometry import Geometry, Leg
from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.kinematics.vectors import added, dot, scaled

# Stiffness of the wall (N m/rad): a stiffer one would swing at the latency of a sample.
STIFFNESS = 2.0
# Its damping over its stiffness (s): more than the 1.5 ms by which its torque is late, latency and
# half a period at 1 kHz, which gives energy.
LEAD = 5e-3


class EndStop:
    """
    The wall of all legs.

    Parameters
    ----------
    geometry : Geometry
        Link angles.
    limits : ForceLimits
        With `end_stop`, the angle before an end at which the wall begins; 0: there is none.
    statics : Statics
        Of the motors: has the legs in the pose of a sample, and the directions without strength.

    """

    def __init__(self, geometry: Geometry, limits: ForceLimits, statics: Statics) -> None:
        self._statics = statics
        self._begin = limits.end_stop
        self._stiffness = 0.0
        if self._begin:
            self._stiffness = min(STIFFNESS, limits.torque / self._begin)
        # The fastest handle meets the wall this far (rad) from an end.
        far = self._begin + LEAD * limits.speed
        self._ends = [LegEnds(leg, far) for leg in geometry.legs]

    def torque(self, velocity: Vector[float] | None) -> Vector[float]:
        """
        Return the torque of the wall, N m in the base frame, in the pose of the statics.

        `velocity` is the angular velocity of the handle, rad/s; without it there is no torque,
        because nothing could damp it.
        """
        if velocity is None or not self._begin:
            return NOTHING
        torque = NOTHING
        for pose, ends in zip(self._statics.leg_poses, self._ends, strict=True):
            if pose.u < ends.least or pose.u > ends.most:
                torque = added(torque, self._torque_of_leg(pose, ends, velocity))
        return torque

    def _torque_of_leg(
        self,
        pose: LegPose,
        ends: LegEnds,
        velocity: Vector[float],
    ) -> Vector[float]:
        """Return the torque of the two ends of a leg, N m."""
        angle = acos(pose.u)
        normal = scaled(1.0 / sqrt(pose.divisor), pose.normal)
        lead = LEAD * dot(normal, velocity)
        to_stretched = ends.stretched - angle
        to_folded = angle - ends.folded
        stretched = max(0.0, self._begin - to_stretched + lead)
        folded = max(0.0, self._begin - to_folded - lead)
        push = self._stiffness * (folded - stretched)
        if not push:
            return NOTHING
        return scaled(push * self._statics.strength(normal), normal)


class LegEnds:
    """
    The two ends of a leg's reach, and the poses that are far from both.

    Attributes
    ----------
    folded, stretched : float
        Angles between Z1k and Z3k there, rad.
    least, most : float
        Least and largest cosine of the angle between the axes far from both ends.

    """

    def __init__(self, leg: Leg, far: float) -> None:
        alpha = acos(leg.cos_alpha)
        beta = acos(leg.cos_beta)
        self.folded = abs(alpha - beta)
        self.stretched = alpha + beta
        self.least = cos(self.stretched - far)
        self.most = cos(self.folded + far)
