# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The law of a slave whose shaft pivots about a trocar (remote centre of motion).

    L_cmd = L_0 + k (d - d_0)
    p_cmd = p_t + L_cmd R_cmd u
    v     = omega x (p_cmd - p_t) + L'_cmd R_cmd u

p_t is the trocar in the slave's base frame, R_cmd the commanded rotation of the tool, u the shaft
in the tool's frame from the trocar to the tip, L the depth of the tip below the trocar, d the
insertion that the master measures, k the insertion scale; 0 is the moment of engaging. The shaft,
the line through p_cmd along R_cmd u, passes through the trocar in every command.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from spm_haptic_master.kinematics.rotations import conjugate
from spm_haptic_master.kinematics.vectors import added, cross, scaled, subtracted
from spm_haptic_master.teleoperation.command import Command, Motion, Pose
from spm_haptic_master.teleoperation.limited_depth import DepthLimits, LimitedDepth
from spm_haptic_master.teleoperation.tilt_cone import TiltCone
from spm_haptic_master.teleoperation.vectors import FloatQuaternion, FloatVector, norm, rotate

# Smallest depth of the tip (m): nearer to the trocar its direction is not that of the shaft.
LEAST_DEPTH = 0.005
# Largest distance from the trocar to the measured shaft at which the slave may follow (m).
SHAFT_TOLERANCE = 0.005
# Largest distance of the tip beyond the ends of the depth's range at which it may follow (m).
RANGE_TOLERANCE = 0.005
# Distance by which a trocar has moved that is no longer the one the slave pivots about (m).
TROCAR_TOLERANCE = 0.002
MILLIMETRES = 1000.0


@dataclass(frozen=True, slots=True)
class RemoteCentreSettings:
    """How a slave pivots about its trocar."""

    scale: float  # k, depth over insertion (unit 1); 0: the depth stays as at engaging
    depth: DepthLimits
    largest_tilt: float  # of the shaft about its direction at engaging, rad; inf: any
    # Shaft in the tool's frame, unit vector from the trocar to the tip; None: that from the trocar
    # to the tip at engaging, which nothing else confirms.
    shaft: FloatVector | None = None


@dataclass(frozen=True, slots=True)
class Pivot:
    """A trocar, and the shaft of the slave through it as engaging, not the clutch, found it."""

    trocar: FloatVector  # p_t in the slave's base frame, m
    shaft: FloatVector  # u in the tool's frame, unit vector
    axis: FloatVector  # direction of the shaft at engaging in the slave's base frame


def depth_of(trocar: FloatVector, slave: Pose) -> float:
    """Return the distance L_0 from the trocar to the tip, m."""
    return norm(subtracted(slave.position, trocar))


def shaft_through(trocar: FloatVector, slave: Pose) -> FloatVector:
    """
    Find the shaft of a slave in its tool's frame: u = R_s0^T (p_s0 - p_t) / L_0.

    Parameters
    ----------
    trocar
        p_t in the slave's base frame, m.
    slave
        Measured pose of the slave, whose tip is not at the trocar.

    Returns
    -------
    tuple of float
        Unit vector from the trocar to the tip, in the tool's frame.

    """
    lever = subtracted(slave.position, trocar)
    return rotate(conjugate(slave.rotation), scaled(1.0 / norm(lever), lever))


def distance_from_shaft(
    point: FloatVector,
    slave: Pose,
    shaft: FloatVector,
) -> float:
    """
    Return the distance from a point to the line of a slave's shaft, m.

    Parameters
    ----------
    point
        Point in the slave's base frame, m, such as the trocar.
    slave
        Pose of the slave: the line passes through its tip.
    shaft
        Direction of the line in the tool's frame, unit vector u.

    """
    return norm(cross(subtracted(point, slave.position), rotate(slave.rotation, shaft)))


def obstacle(
    settings: RemoteCentreSettings,
    trocar: FloatVector,
    slave: Pose,
    known: Pivot | None,
) -> str:
    """
    Return why a slave cannot pivot about a trocar from its measured pose; empty if it can.

    Parameters
    ----------
    settings
        With the shaft in the tool's frame, if it is known.
    trocar
        p_t in the slave's base frame, m.
    slave
        Measured pose of the slave.
    known
        Pivot before the clutch, whose shaft the slave still has; None without one.

    """
    depth = depth_of(trocar, slave)
    if depth < LEAST_DEPTH:
        return (
            f'tip at the trocar: {MILLIMETRES * depth:.0f} mm, '
            f'expected {MILLIMETRES * LEAST_DEPTH:.0f} mm or more'
        )
    shortest = settings.depth.shortest
    deepest = settings.depth.deepest
    if not shortest - RANGE_TOLERANCE <= depth <= deepest + RANGE_TOLERANCE:
        return (
            f'depth {MILLIMETRES * depth:.0f} mm, expected '
            f'{MILLIMETRES * shortest:.0f} to {MILLIMETRES * deepest:.0f} mm'
        )
    shaft = settings.shaft if known is None else known.shaft
    if shaft is None:
        return ''
    return off_the_trocar(trocar, slave, shaft)


def off_the_trocar(
    trocar: FloatVector,
    slave: Pose,
    shaft: FloatVector,
) -> str:
    """
    Return that a slave's shaft passes its trocar too far aside, and how far; empty if it does not.

    Parameters
    ----------
    trocar
        p_t in the slave's base frame, m.
    slave
        Measured pose of the slave.
    shaft
        Direction of the shaft in the tool's frame, unit vector.

    """
    distance = distance_from_shaft(trocar, slave, shaft)
    if distance <= SHAFT_TOLERANCE:
        return ''
    return (
        f'shaft {MILLIMETRES * distance:.0f} mm off the trocar, '
        f'expected {MILLIMETRES * SHAFT_TOLERANCE:.0f} mm or less'
    )


class RemoteCentre:
    """
    One course of a slave about its trocar.

    Parameters
    ----------
    settings
        Scale and limits.
    trocar
        p_t in the slave's base frame, m.
    slave
        Measured pose from which the slave begins to follow: no `obstacle`.
    insertion
        Insertion of the master at that moment, d_0, m.
    known
        Pivot before the clutch, which keeps the shaft of engaging; None at engaging.

    """

    def __init__(
        self,
        settings: RemoteCentreSettings,
        trocar: FloatVector,
        slave: Pose,
        insertion: float,
        known: Pivot | None,
    ) -> None:
        # The line through trocar and tip, about which this course turns: not quite the shaft where
        # that was pushed aside during the clutch.
        self._line = shaft_through(trocar, slave)
        if known is None:
            axis = rotate(slave.rotation, self._line)
            self.pivot = Pivot(trocar, shaft=self._line, axis=axis)
        else:
            self.pivot = replace(known, trocar=trocar)
        self.cone: TiltCone | None = None
        if settings.largest_tilt < inf:
            self.cone = TiltCone(
                shaft=self._line,
                axis=self.pivot.axis,
                largest=settings.largest_tilt,
            )
        self._scale = settings.scale
        self._first_insertion = insertion
        self._first_depth = depth_of(trocar, slave)
        self._depth = LimitedDepth(settings.depth, self._first_depth)

    def advance(self, insertion: float, dt: float) -> str:
        """Let the depth follow an insertion, m, within dt, s; return the limit that it breaks."""
        target = self._first_depth
        if self._scale:
            target += self._scale * (insertion - self._first_insertion)
        return self._depth.advance(target, dt)

    def command(self, rotation: FloatQuaternion, angular: FloatVector) -> Command:
        """Return tip and motion for a commanded rotation and its angular velocity, rad/s."""
        direction = rotate(rotation, self._line)
        lever = scaled(self._depth.depth, direction)
        return Command(
            Pose(rotation, added(self.pivot.trocar, lever)),
            Motion(
                angular=angular,
                lever=lever,
                sliding=scaled(self._depth.rate, direction),
            ),
        )
