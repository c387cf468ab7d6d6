# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A commanded rotation that follows a target within limits of speed, acceleration and jump."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    quaternion_from_vector,
    rotation_between,
)
from spm_haptic_master.kinematics.vectors import added, scaled, subtracted
from spm_haptic_master.teleoperation.braking import braking_speed, closing_speed
from spm_haptic_master.teleoperation.tilt_cone import TiltCone
from spm_haptic_master.teleoperation.vectors import (
    FloatQuaternion,
    FloatVector,
    moved_toward,
    norm,
    ZERO,
)

# Share by which a target may exceed a limit and still be followed exactly (unit 1): rounding.
ROUNDING = 1e-9
# Largest deviation of a pose's squared norm from 1 (unit 1): a controller in single precision
# passes, a quaternion of zeros or of other numbers does not.
NORM_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """Limits of the commanded rotation."""

    speed: float  # rad/s
    acceleration: float  # rad/s^2
    jump: float  # largest rotation from one command to the next, rad
    # Whether the command slews to a target that would break a limit; else it is withheld.
    slews: bool
    # Longest time for which the command catches up in one step, s: after a pause it moves no
    # farther than in this time at `speed`, unless it cannot brake so soon.
    longest: float


class Step(NamedTuple):
    """What one step of the command may do."""

    dt: float  # s since the last command
    speed: float  # largest speed, rad/s
    gain: float  # largest change of the velocity, rad/s


class LimitedRotation:
    """
    A commanded rotation, at rest at first, that follows a target within limits.

    With a cone it also keeps the shaft's tilt: it brakes before the cone, and never leaves it.
    """

    def __init__(
        self,
        limits: CommandLimits,
        rotation: FloatQuaternion,
        cone: TiltCone | None = None,
    ) -> None:
        self._limits = limits
        self._cone = cone
        # Where the target was at the last step; None where the command had reached it.
        self._target: FloatQuaternion | None = None
        self.rotation = rotation  # its sign is continuous
        self.velocity = ZERO  # rad/s, base frame
        # Tilt of the shaft, rad; not used without a cone.
        if cone is None:
            self._tilt = 0.0
        else:
            self._tilt = cone.tilt(rotation)

    def advance(self, target: FloatQuaternion, dt: float) -> str:
        """
        Move towards a target.

        Parameters
        ----------
        target
            Rotation to follow, as a unit quaternion x, y, z, w in the slave's base frame.
        dt
            Time since the last step, above 0, s.

        Returns
        -------
        str
            Empty if the command has moved. Else the limit that would be broken: by the target
            where the command does not slew, by any motion after a pause in which it has become
            too fast for `jump`.

        """
        limits = self._limits
        error = rotation_between(self.rotation, target)
        if not limits.slews and norm(error) > limits.jump:
            return 'jump'
        covered = min(limits.speed * min(dt, limits.longest), limits.jump)
        step = Step(dt, speed=covered / dt, gain=limits.acceleration * dt)
        wanted = scaled(1.0 / dt, error)
        moving = wanted
        if self._target is not None:
            moving = scaled(1.0 / dt, rotation_between(self._target, target))
        broken = self._broken_by(wanted, moving, step)
        if broken and not limits.slews:
            return broken
        if broken:
            return self._slew(target, moving, step)
        self._target = None
        self._move_to(target, wanted, target, dt)
        return ''

    def restart(self) -> None:
        """Take the next target as one to move to from here: what the command is behind is lost."""
        self._target = None

    def _broken_by(
        self,
        wanted: FloatVector,
        moving: FloatVector,
        step: Step,
    ) -> str:
        """Return which limit a step at the wanted velocity would break; empty if none."""
        if norm(wanted) > (1.0 + ROUNDING) * step.speed:
            return 'speed'
        gain = (1.0 + ROUNDING) * step.gain
        if norm(subtracted(wanted, self.velocity)) > gain:
            return 'acceleration'
        # Where it has caught up, it must not be faster than the target by too much.
        if moving is not wanted and norm(subtracted(wanted, moving)) > gain:
            return 'acceleration'
        return ''

    def _slew(
        self,
        target: FloatQuaternion,
        moving: FloatVector,
        step: Step,
    ) -> str:
        """Move as far towards the target as the limits allow; return a limit that cannot hold."""
        velocity = self._slewed_velocity(moving, step)
        if norm(velocity) * step.dt > (1.0 + ROUNDING) * self._limits.jump:
            return 'jump'
        self._target = target
        turned = quaternion_from_vector(*scaled(step.dt, velocity))
        moved = multiply_quaternions(turned, self.rotation)
        # A product of unit quaternions: only rounding is taken off.
        self._move_to(unit_quaternion(moved) or self.rotation, velocity, target, step.dt)
        return ''

    def _slewed_velocity(self, moving: FloatVector, step: Step) -> FloatVector:
        """Return the velocity to the moving target's last place, able to stay with it, rad/s."""
        if self._target is None:
            before = self.rotation
        else:
            before = self._target
        error = rotation_between(self.rotation, before)
        distance = norm(error)
        closing = ZERO
        if distance > 0.0:
            closing = scaled(closing_speed(distance, step.dt, step.gain) / distance, error)
        wanted = moved_toward(ZERO, added(closing, moving), step.speed)
        velocity = moved_toward(self.velocity, wanted, step.gain)
        if norm(velocity) > step.speed:
            # The limit is lower than at the last step where this one is longer: it brakes.
            slower = moved_toward(ZERO, self.velocity, step.speed)
            velocity = moved_toward(self.velocity, slower, step.gain)
        return velocity

    def _move_to(
        self,
        rotation: FloatQuaternion,
        velocity: FloatVector,
        target: FloatQuaternion,
        dt: float,
    ) -> None:
        """Take the next rotation, reached at a velocity; the cone may hold it back."""
        if self._cone is not None:
            kept = self._kept_in(self._cone, rotation, dt)
            if kept is not rotation:
                velocity = scaled(1.0 / dt, rotation_between(self.rotation, kept))
                rotation = kept
                self._target = target
        self.velocity = velocity
        x, y, z, w = rotation
        a, b, c, d = self.rotation
        is_near = x * a + y * b + z * c + w * d >= 0.0
        if is_near:
            self.rotation = rotation
        else:
            self.rotation = (-x, -y, -z, -w)

    def _kept_in(
        self,
        cone: TiltCone,
        rotation: FloatQuaternion,
        dt: float,
    ) -> FloatQuaternion:
        """Return the rotation, or the nearest one whose tilt can still stop at the cone."""
        before = self._tilt
        self._tilt = cone.tilt(rotation)
        if self._tilt <= before:
            return rotation
        outward = braking_speed(cone.largest - before, dt, self._limits.acceleration)
        allowed = before + outward * dt
        if self._tilt <= allowed:
            return rotation
        self._tilt = allowed
        return cone.within(rotation, allowed)


def unit_quaternion(quaternion: FloatQuaternion) -> FloatQuaternion | None:
    """
    Normalise a quaternion that another program sent.

    Parameters
    ----------
    quaternion
        Four numbers x, y, z, w.

    Returns
    -------
    tuple of float, or None
        The quaternion of norm 1; None for one that is not finite or too far from it.

    """
    x, y, z, w = quaternion
    square = x * x + y * y + z * z + w * w
    # Also false where a component is not a number.
    if not abs(square - 1.0) < NORM_TOLERANCE:
        return None
    scale = 1.0 / sqrt(square)
    return scale * x, scale * y, scale * z, scale * w
