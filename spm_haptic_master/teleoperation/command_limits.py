# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The law of the command, and its limits: it follows its target exactly within them.

    R_cmd = R_m (R_m0^T R_s0)

R_m is the master's rotation now, R_m0 and R_s0 are master's and slave's when the offset was taken,
all in the slave's base frame. A turn of the master turns the slave by the same angle about the
same axis in space; a rotation is never scaled.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    quaternion_from_vector,
    vector_from_quaternion,
)
from spm_haptic_master.timing import SECOND

# Share by which a target may exceed a limit and still be followed exactly (unit 1): rounding.
ROUNDING = 1e-9
# Longest time in which a twist ends, whatever the acceleration (s): nobody leads it by then.
FADE_LONGEST = 0.1
# Largest deviation of a pose's squared norm from 1 (unit 1): a controller in single precision
# passes, a quaternion of zeros or of other numbers does not.
NORM_TOLERANCE = 1e-3
# Offset that counts as none (rad): far below the resolution of any encoder.
ALIGNED = 1e-9
ZERO: Vector[float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """Limits of the command."""

    speed: float  # rad/s
    acceleration: float  # rad/s^2
    jump: float  # largest rotation from one command to the next, rad
    # Whether the command slews to a target that would break a limit; else it is withheld.
    slews: bool
    # Longest time for which the command catches up in one step, s: after a pause it moves no
    # farther than in this time at `speed`, unless it cannot brake so soon.
    longest: float


class LimitedRotation:
    """A commanded rotation, at rest at first, that follows a target within limits."""

    def __init__(self, limits: CommandLimits, rotation: Quaternion[float]) -> None:
        self._limits = limits
        # Where the target was at the last step; None where the command had reached it.
        self._target: Quaternion[float] | None = None
        self.rotation = rotation  # its sign is continuous
        self.velocity = ZERO  # rad/s, base frame

    def advance(self, target: Quaternion[float], dt: float) -> str:
        """
        Move towards a target, `dt` > 0 (s) after the last step; return '' if it has moved.

        Else the limit that would be broken: by the target where the command does not slew, by any
        motion after a pause in which it has become too fast for `jump`.
        """
        limits = self._limits
        error = _between(self.rotation, target)
        distance = norm(error)
        if not limits.slews and distance > limits.jump:
            return 'jump'
        used = min(dt, limits.longest)
        speed = min(limits.speed * used, limits.jump) / dt
        wanted = _scaled(error, 1.0 / dt)
        gain = limits.acceleration * dt
        # The target's own velocity: that of the command, where it was there before.
        before = self._target
        moving = wanted if before is None else _scaled(_between(before, target), 1.0 / dt)
        if distance > (1.0 + ROUNDING) * speed * dt:
            broken = 'speed'
        # Also where it has caught up, but would then be faster than the target by too much.
        elif (
            max(norm(_difference(wanted, self.velocity)), norm(_difference(wanted, moving)))
            > (1.0 + ROUNDING) * gain
        ):
            broken = 'acceleration'
        else:
            self._target = None
            self.velocity = wanted
            (x, y, z, w), (a, b, c, d) = target, self.rotation
            is_near = x * a + y * b + z * c + w * d >= 0.0
            self.rotation = target if is_near else (-x, -y, -z, -w)
            return ''
        if not limits.slews:
            return broken
        velocity = self._slewed(
            self.rotation if before is None else before, moving, dt, speed, gain
        )
        if norm(velocity) * dt > (1.0 + ROUNDING) * limits.jump:
            return 'jump'
        self.velocity = x, y, z = velocity
        moved = multiply_quaternions(quaternion_from_vector(dt * x, dt * y, dt * z), self.rotation)
        # A product of unit quaternions: only rounding is taken off.
        self.rotation = unit_quaternion(moved) or self.rotation
        self._target = target
        return ''

    def restart(self) -> None:
        """Take the next target as one to move to from here: what the command is behind is lost."""
        self._target = None

    def _slewed(
        self,
        target: Quaternion[float],
        moving: Vector[float],
        dt: float,
        limit: float,
        gain: float,
    ) -> Vector[float]:
        """
        Return the velocity to where a target was that moves (rad/s), able to stay with it.

        `limit` and `gain`, rad/s, are the largest speed in this step where the command can brake
        to it, and the largest change of the velocity.
        """
        error = _between(self.rotation, target)
        distance = norm(error)
        # The largest speed beyond the target's from which steps of `dt`, each slower by `gain`,
        # end at it: that many full ones, and what is left.
        full = int(0.5 * (sqrt(1.0 + 8.0 * distance / (gain * dt)) - 1.0))
        closing = 0.5 * gain * full + distance / ((full + 1) * dt)
        x, y, z = _scaled(error, closing / distance if distance > 0.0 else 0.0)
        wanted = x + moving[0], y + moving[1], z + moving[2]
        velocity = _toward(self.velocity, _toward(ZERO, wanted, limit), gain)
        if norm(velocity) > limit:
            # The limit is lower than at the last step where this one is longer: it brakes.
            velocity = _toward(self.velocity, _toward(ZERO, self.velocity, limit), gain)
        return velocity


class Following:
    """
    One course of the slave, from where master and slave are at a stamp, ns.

    With an `align_speed` above 0, rad/s, the offset between them shrinks to none.
    """

    def __init__(
        self,
        limits: CommandLimits,
        align_speed: float,
        master: Quaternion[float],
        slave: Quaternion[float],
        stamp: int,
    ) -> None:
        self._limits = limits
        # The offset R_m0^T R_s0, from the master's handle to the slave's instrument.
        self._offset = multiply_quaternions(conjugate(master), slave)
        self._command = LimitedRotation(limits, slave)
        self._align_speed = align_speed
        # Speed at which the offset shrinks, rad/s; None where it does not.
        self._closing = 0.0 if align_speed else None
        # Stamp of the last command, ns.
        self.stamp = stamp

    @property
    def rotation(self) -> Quaternion[float]:
        """Return the slave's commanded rotation in its base frame."""
        return self._command.rotation

    @property
    def velocity(self) -> Vector[float]:
        """Return the angular velocity of the command in the slave's base frame, rad/s."""
        return self._command.velocity

    def advance(self, master: Quaternion[float], stamp: int) -> str:
        """Command what follows from an orientation of a stamp, ns; return the limit it breaks."""
        dt = (stamp - self.stamp) / SECOND
        left = norm(vector_from_quaternion(*self._offset))
        if self._closing is not None:
            self._shrink_offset(self._closing, left, dt)
        broken = self._command.advance(multiply_quaternions(master, self._offset), dt)
        if broken:
            return broken
        if self._closing is not None:
            # From where the command is: it may not have followed so fast.
            self._offset = multiply_quaternions(conjugate(master), self._command.rotation)
            self._closing = max(0.0, left - norm(vector_from_quaternion(*self._offset))) / dt
        self.stamp = stamp
        return ''

    def _shrink_offset(self, before: float, left: float, dt: float) -> None:
        """Shrink the offset that is left, rad; it shrank at the speed `before`, rad/s."""
        angle = left
        if left <= ALIGNED:
            self._closing = None
        else:
            a = self._limits.acceleration
            # After this step there is enough left to stop in: c dt + c^2 / 2a = left.
            braking = a * (sqrt(dt * dt + 2.0 * left / a) - dt)
            angle = min(self._align_speed, before + a * dt, braking) * dt
            self._command.restart()
        if left <= angle:
            self._offset = (0.0, 0.0, 0.0, 1.0)
            return
        part = 1.0 - angle / left
        x, y, z = vector_from_quaternion(*self._offset)
        self._offset = quaternion_from_vector(part * x, part * y, part * z)


def unit_quaternion(quaternion: Quaternion[float]) -> Quaternion[float] | None:
    """Return a quaternion of norm 1; None for one that is not finite or too far from it."""
    x, y, z, w = quaternion
    square = x * x + y * y + z * z + w * w
    # Also false where a component is not a number.
    if not abs(square - 1.0) < NORM_TOLERANCE:
        return None
    scale = 1.0 / sqrt(square)
    return scale * x, scale * y, scale * z, scale * w


class FadingTwist:
    """The angular velocity for a slave that is driven by rates: it fades to zero, and stops."""

    def __init__(self, acceleration: float, zeros: int) -> None:
        # Largest one, rad/s^2; at the end more, where `FADE_LONGEST` needs it.
        self._acceleration = acceleration
        # Number of zero velocities before the end: one may get lost.
        self._zeros = zeros
        self._left = 0
        self._velocity = ZERO
        # Deceleration of the end, rad/s^2; 0 while there is a command.
        self._fading = 0.0

    def follow(self, velocity: Vector[float], dt: float) -> Vector[float]:
        """Return the velocity of the command, or the nearest one within reach in `dt`, s."""
        velocity = self._velocity = _toward(
            self._velocity, velocity, (1.0 + ROUNDING) * self._acceleration * dt
        )
        self._left, self._fading = self._zeros, 0.0
        return velocity

    def fade(self, dt: float) -> Vector[float] | None:
        """Return the velocity after a further time `dt` without a command, s; None at the end."""
        if not self._left:
            return None
        speed = norm(self._velocity)
        self._fading = self._fading or max(self._acceleration, speed / FADE_LONGEST)
        slower = speed - self._fading * dt
        if slower > 0.0:
            self._velocity = _scaled(self._velocity, slower / speed)
        else:
            self._velocity = ZERO
            self._left -= 1
        return self._velocity


def _between(one: Quaternion[float], other: Quaternion[float]) -> Vector[float]:
    """Return the rotation vector in the base frame from one rotation to the other, rad."""
    return vector_from_quaternion(*multiply_quaternions(other, conjugate(one)))


def _toward(before: Vector[float], wanted: Vector[float], gain: float) -> Vector[float]:
    """Return the vector nearest to the wanted one that differs from the last by the gain."""
    change = _difference(wanted, before)
    size = norm(change)
    if size <= gain:
        return wanted
    part = gain / size
    x, y, z = (now + part * more for now, more in zip(before, change, strict=True))
    return x, y, z


def norm(vector: Vector[float]) -> float:
    """Return the length of a vector."""
    x, y, z = vector
    return sqrt(x * x + y * y + z * z)


def _scaled(vector: Vector[float], scale: float) -> Vector[float]:
    x, y, z = vector
    return scale * x, scale * y, scale * z


def _difference(a: Vector[float], b: Vector[float]) -> Vector[float]:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
