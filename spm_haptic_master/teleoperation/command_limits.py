# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A commanded rotation that follows a target within limits of speed, acceleration and jump."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    quaternion_from_vector,
    rotation_between,
)
from spm_haptic_master.kinematics.vectors import added, scaled, subtracted
from spm_haptic_master.teleoperation.braking import braking_speed, closing_speed, ROUNDING
from spm_haptic_master.teleoperation.tilt_cone import TiltCone
from spm_haptic_master.teleoperation.vectors import (
    FloatQuaternion,
    FloatVector,
    moved_toward,
    norm,
    unit_quaternion,
    ZERO,
)


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
    longest_step: float


class Step(NamedTuple):
    """What one step of the command may do."""

    dt: float  # s since the last command
    speed: float  # largest speed, rad/s
    velocity_change: float  # largest change of the velocity, rad/s


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
        self._target = rotation  # at the last step
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
        covered = min(limits.speed * min(dt, limits.longest_step), limits.jump)
        step = Step(
            dt=dt,
            speed=covered / dt,
            velocity_change=limits.acceleration * dt,
        )
        wanted = scaled(1.0 / dt, error)
        target_velocity = scaled(1.0 / dt, rotation_between(self._target, target))
        broken = self._broken_by(wanted, target_velocity, step)
        if broken and not limits.slews:
            return broken
        if broken:
            return self._slew(target, target_velocity, step)
        self._target = target
        self._move_to(target, wanted, dt)
        return ''

    def restart(self) -> None:
        """Take the next target as one to move to from here: what the command is behind is lost."""
        self._target = self.rotation

    def _broken_by(
        self,
        wanted: FloatVector,
        target_velocity: FloatVector,
        step: Step,
    ) -> str:
        """Return which limit a step at the wanted velocity would break; empty if none."""
        if norm(wanted) > (1.0 + ROUNDING) * step.speed:
            return 'speed'
        change = (1.0 + ROUNDING) * step.velocity_change
        if norm(subtracted(wanted, self.velocity)) > change:
            return 'acceleration'
        # Where it has caught up, it must not be faster than the target by too much.
        if norm(subtracted(wanted, target_velocity)) > change:
            return 'acceleration'
        return ''

    def _slew(
        self,
        target: FloatQuaternion,
        target_velocity: FloatVector,
        step: Step,
    ) -> str:
        """Move as far towards the target as the limits allow; return a limit that cannot hold."""
        velocity = self._slewed_velocity(target_velocity, step)
        if norm(velocity) * step.dt > (1.0 + ROUNDING) * self._limits.jump:
            return 'jump'
        self._target = target
        turned = quaternion_from_vector(*scaled(step.dt, velocity))
        moved = multiply_quaternions(turned, self.rotation)
        # A product of unit quaternions: only rounding is taken off.
        self._move_to(unit_quaternion(moved) or self.rotation, velocity, step.dt)
        return ''

    def _slewed_velocity(self, target_velocity: FloatVector, step: Step) -> FloatVector:
        """Return the velocity to the moving target's last place, able to stay with it, rad/s."""
        error = rotation_between(self.rotation, self._target)
        distance = norm(error)
        closing = ZERO
        if distance > 0.0:
            closing = scaled(
                closing_speed(distance, step.dt, step.velocity_change) / distance, error
            )
        wanted = moved_toward(ZERO, added(closing, target_velocity), step.speed)
        velocity = moved_toward(self.velocity, wanted, step.velocity_change)
        if norm(velocity) > (1.0 + ROUNDING) * step.speed:
            # The limit is lower than at the last step where this one is longer: it brakes.
            slower = moved_toward(ZERO, self.velocity, step.speed)
            velocity = moved_toward(self.velocity, slower, step.velocity_change)
        return velocity

    def _move_to(
        self,
        rotation: FloatQuaternion,
        velocity: FloatVector,
        dt: float,
    ) -> None:
        """Take the next rotation, reached at a velocity; the cone may hold it back."""
        if self._cone is not None:
            kept = self._kept_in(self._cone, rotation, dt)
            if kept is not rotation:
                velocity = scaled(1.0 / dt, rotation_between(self.rotation, kept))
                rotation = kept
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
