# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The slave's command while it follows: the law, its alignment, its limits, and no burst."""

from __future__ import annotations

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.teleoperation.command_limits import (
    closing_speed,
    CommandLimits,
    LimitedRotation,
)
from spm_haptic_master.teleoperation.law import Offset
from spm_haptic_master.timing import SECOND

# Time (s) beyond the longest step whose commands may go out at once: what a computer without real
# time delays now and then. How much faster than it passes the time grows back (unit 1).
BURST, GROWTH = 0.01, 1.25
# Offset that is none (rad): far below what any encoder resolves.
ALIGNED = 1e-9


class Budget:
    """
    The time that commands may still make up for.

    Those of a burst, by their stamps as far apart as ever, go out hardly faster than time passes.
    """

    def __init__(self, longest: float) -> None:
        self._most = self._left = longest + BURST  # s

    def pass_time(self, dt: float) -> None:
        """Let time pass, s."""
        self._left = min(self._left + GROWTH * dt, self._most)

    def spend(self, time: float) -> bool:
        """Spend a time, s; return whether it was left."""
        if time > self._left:
            return False
        self._left -= time
        return True


class Following:
    """
    One course of the slave, from where master and slave are at a stamp, ns.

    With an `align_speed` above 0, rad/s, the offset between them shrinks to none.
    """

    def __init__(self, limits: CommandLimits, budget: Budget, align_speed: float,
                 master: Quaternion[float], slave: Quaternion[float], stamp: int) -> None:
        self._limits, self._budget = limits, budget
        self._offset = Offset(master, slave)
        self._command = LimitedRotation(limits, slave)
        self._align_speed = align_speed
        # Speed at which the offset shrinks, rad/s; None where it does not.
        self._closing = 0.0 if align_speed else None
        # Stamp of the last command.
        self._stamp = stamp

    @property
    def rotation(self) -> Quaternion[float]:
        """Return the slave's commanded rotation in its base frame."""
        return self._command.rotation

    @property
    def velocity(self) -> Vector[float]:
        """Return the angular velocity of the command in the slave's base frame, rad/s."""
        return self._command.velocity

    def advance(self, master: Quaternion[float], stamp: int) -> str | None:
        """
        Command what follows from an orientation of the master with a stamp, ns.

        Return '' for a new command, the limit that it would break, None where it comes too early.
        """
        dt = (stamp - self._stamp) / SECOND
        if not self._budget.spend(min(dt, self._limits.longest)):
            return None
        left = self._offset.angle
        if self._closing is not None:
            self._close(self._closing, left, dt)
        broken = self._command.advance(self._offset.command(master), dt)
        if broken:
            return broken
        if self._closing is not None:
            # From where the command is: it may not have followed so fast.
            self._offset = Offset(master, self._command.rotation)
            self._closing = max(0.0, left - self._offset.angle) / dt
        self._stamp = stamp
        return ''

    def _close(self, before: float, left: float, dt: float) -> None:
        """Shrink the offset that is left, rad; the speed was `before`, rad/s."""
        if left <= ALIGNED:
            self._closing = None
            self._offset.shrink(left)
            return
        speed = closing_speed(left, before, self._limits, self._align_speed, dt)
        self._offset.shrink(speed * dt)
        self._command.restart()
