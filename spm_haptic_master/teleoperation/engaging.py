# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Whether the slave follows: an explicit state machine of engaging, clutch and what ends both.

    disengaged --(presence and a fresh enable, every condition met)--> engaged
    engaged <--(clutch)--> clutched
    engaged, clutched --(a condition lost, presence gone, a limit broken, disable)--> disengaged

Nothing engages again by itself: what disengages also uses up the `enable`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import inf, nan, radians

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import multiply_quaternions, rotation_distance
from spm_haptic_master.orientation_state import OrientationState
from spm_haptic_master.teleoperation.command_limits import (
    closing_speed,
    CommandLimits,
    LimitedRotation,
)
from spm_haptic_master.teleoperation.law import Offset, unit_quaternion
from spm_haptic_master.teleoperation.roll import Roll
from spm_haptic_master.timing import SECOND, StampGrid

# Why it is not engaged. Obstacles: an enable given meanwhile has no effect.
NO_ORIENTATION = 'no orientation'
NO_STATE = 'no state of the orientation'
NOT_ENABLED = 'master not enabled'
NO_SLAVE = 'no pose of the slave'
NO_LEVEL = 'no protection level'
HIGH_LEVEL = 'protection level above the limit'
# What is waited for.
NO_PRESENCE = 'no presence'
CLUTCH = 'clutch pressed'
CLUTCH_GONE = 'clutch gone while pressed'
NO_ENABLE = 'waiting for enable'
NO_ROLL = 'waiting for a roll of the wrist'
SLAVE_MOVES = 'waiting for the slave to be at rest'
NOT_ALIGNED = 'not aligned'
# The slave is elsewhere than commanded: it would jump if it took the next command.
NOT_FOLLOWING = 'the slave does not follow'
# Rounding of times (s).
ROUNDING = 1e-9
# Time (s) beyond the longest step whose commands may go out at once: what a computer without real
# time delays now and then. How much faster than it passes the time grows back (unit 1).
BURST, GROWTH = 0.01, 1.25
# A slave is at rest that has stayed within this angle (rad) for this time (s). It begins to follow
# from the pose that it has said to have: one that moves is elsewhere when the command arrives.
REST_ANGLE, REST_TIME = radians(0.5), 0.05
# Offset that is none (rad): far below what any encoder resolves.
ALIGNED = 1e-9
# A command from outside.
DISABLED = 'disabled'


class Phase(Enum):
    """The states of the machine."""

    DISENGAGED = 'disengaged'
    ENGAGED = 'engaged'
    CLUTCHED = 'clutched'


@dataclass(frozen=True, slots=True)
class Conditions:
    """
    When the slave may follow, and how.

    Attributes
    ----------
    registration : tuple of four float
        Unit quaternion x, y, z, w of the rotation from the master's to the slave's base frame.
    absolute : bool
        Whether the offset taken at engaging shrinks to none, so that the slave meets the master.
    align_speed : float
        Angular speed at which it shrinks, rad/s.
    tolerance : float
        Largest offset at which it engages, rad; inf: any.
    roll : float
        Roll of the wrist that is asked for, rad; 0: none.
    enable_timeout : float
        Time after which an enable lapses that has not led to engaging, s.
    orientation_timeout, slave_timeout, presence_timeout : float
        Largest age of the orientation, of the slave's pose and of the presence, s.
    protection_limit : float
        Largest protection level, rad; inf: any that is published.
    tracking_limit : float
        Largest angle from the command to the slave, rad; inf: any.
    command_rate : float
        Rate of the commands, Hz; 0: with each orientation.
    sample_rate : float
        Rate of the orientations, Hz.

    """

    registration: Quaternion[float] = (0.0, 0.0, 0.0, 1.0)
    absolute: bool = False
    align_speed: float = 0.2
    tolerance: float = inf
    roll: float = 0.0
    enable_timeout: float = 10.0
    orientation_timeout: float = 0.05
    slave_timeout: float = 0.1
    presence_timeout: float = inf
    protection_limit: float = inf
    tracking_limit: float = inf
    command_rate: float = 200.0
    sample_rate: float = 1000.0


class Teleoperation:
    """
    One master and one slave.

    Each input comes by a call, after `pass_time` with the time since the last one: an age that is
    exceeded is then noticed before new data can hide it.

    Parameters
    ----------
    conditions : Conditions
        When the slave may follow.
    limits : CommandLimits
        Limits of the command.

    Attributes
    ----------
    phase : Phase
        State of the machine.
    cause : str
        What disengaged it last; empty before the first time.
    hindrance : str
        What else forbids that the slave follows, such as a second publisher; empty if nothing.
    starts : int
        How often the slave has begun to follow, by engaging or after the clutch.

    """

    def __init__(self, conditions: Conditions, limits: CommandLimits) -> None:
        self._conditions = conditions
        self._limits = limits
        # Time that has passed (s).
        self._now = 0.0
        self.phase = Phase.DISENGAGED
        self.cause = ''
        self.hindrance = ''
        self.starts = 0
        # The latest of each input, and when it came; None before the first.
        self._master: Quaternion[float] | None = None
        self._master_at = -inf
        self._slave: Quaternion[float] | None = None
        self._slave_at = -inf
        # Pose near which the slave has stayed, and since when; None while it is led.
        self._rest: Quaternion[float] | None = None
        self._rest_at = -inf
        self._level = nan
        self._level_at = -inf
        self._present = False
        self._present_at = -inf
        self._clutch = False
        self._state: OrientationState | None = None
        # Time of the enable that the master is in effect by, 0 while it has none; None where it
        # is not known, because the master does not publish it.
        self._enabling: int | None = None
        # When an enable came that has not been used up.
        self._enabled_at: float | None = None
        self._roll = Roll()
        # Stamp of the last orientation (ns), and which of them are followed by a command.
        self._stamp: int | None = None
        self._grid = StampGrid(conditions.command_rate, conditions.sample_rate)
        # Stamp of the last command, and the time that commands may still make up for (s): those of
        # a burst, by their stamps as far apart as ever, go out hardly faster than time passes.
        self._commanded = 0
        self._most = self._credit = limits.longest + BURST
        # Offset and command while engaged.
        self._offset: Offset | None = None
        self._command: LimitedRotation | None = None
        # Speed at which the offset shrinks, rad/s; None where it does not.
        self._closing: float | None = None

    @property
    def state(self) -> str:
        """Return the state in words: 'disengaged: WHY', 'engaged' or 'clutched'."""
        if self.phase is not Phase.DISENGAGED:
            return str(self.phase.value)
        why = self._obstacle() or self._awaited()
        if why == NO_ENABLE and self.cause:
            why += f', after: {self.cause}'
        return f'{Phase.DISENGAGED.value}: {why or NO_ENABLE}'

    @property
    def is_hindered(self) -> bool:
        """Return whether it could not be engaged, whatever the surgeon does."""
        return bool(self._obstacle())

    @property
    def velocity(self) -> Vector[float]:
        """Return the angular velocity of the command in the slave's base frame, rad/s."""
        return (0.0, 0.0, 0.0) if self._command is None else self._command.velocity

    @property
    def offset(self) -> float | None:
        """Return the angle between master and slave, rad; None while one of them is missing."""
        if self._master is None or self._slave is None:
            return None
        return Offset(self._master, self._slave).angle

    def pass_time(self, dt: float) -> None:
        """Let time pass, s: disengage if an input has become too old."""
        self._now += dt
        self._credit = min(self._credit + GROWTH * dt, self._most)
        if self.phase is Phase.DISENGAGED:
            if self._enabled_at is not None and (
                    self._now - self._enabled_at > self._conditions.enable_timeout
                    or self._obstacle()):
                self._enabled_at = None
            return
        cause = self._obstacle()
        if not cause and self._now - self._present_at > self._conditions.presence_timeout:
            cause = NO_PRESENCE
        if cause:
            self.disengage(cause)

    def disengage(self, cause: str = DISABLED) -> None:
        """Disengage, and use up an enable, whatever the state is."""
        if self.phase is not Phase.DISENGAGED:
            self.cause = cause
        self.phase = Phase.DISENGAGED
        self._enabled_at = None
        self._offset = self._command = self._rest = None
        self._roll = Roll()

    def enable(self) -> str:
        """Take an enable; return why it has no effect, empty if it has one."""
        obstacle = self._obstacle()
        if not obstacle and self.phase is Phase.DISENGAGED:
            self._enabled_at = self._now
            self._roll = Roll()
        return obstacle

    def take_state(self, state: OrientationState) -> None:
        """Take the state of the orientation: while it is not published, no slave follows."""
        self._state = state
        self._check()

    def take_enabling(self, number: int, age: float) -> None:
        """
        Take the enable that the master is in effect by.

        Another one than before is a fresh enable; the first one known is not, because it may be
        older than this machine, and one that has come late is not: it would have lapsed.

        Parameters
        ----------
        number : int
            Its time, ns; 0 while there is none.
        age : float
            Time since then, s.

        """
        before, self._enabling = self._enabling, number
        self._check()
        if number and before is not None and number != before \
                and abs(age) <= self._conditions.enable_timeout:
            self.enable()

    def take_presence(self, pressed: bool) -> None:
        """Take the presence of the surgeon."""
        self._present = pressed
        self._present_at = self._now
        if pressed:
            return
        self._roll = Roll()
        if self.phase is not Phase.DISENGAGED:
            self.disengage(NO_PRESENCE)

    def take_clutch(self, pressed: bool | None) -> None:
        """
        Take the clutch: while it is pressed the slave holds and the master moves freely.

        None: its publisher has gone. A clutch that was pressed is released by that, but the slave
        does not follow by it: that disengages.
        """
        if pressed is None and self._clutch and self.phase is not Phase.DISENGAGED:
            self.disengage(CLUTCH_GONE)
        self._clutch = bool(pressed)
        if pressed and self.phase is Phase.ENGAGED:
            self.phase = Phase.CLUTCHED
            self._offset = self._command = self._rest = None

    def take_slave(self, quaternion: Quaternion[float]) -> None:
        """Take the slave's measured rotation; one that is no unit quaternion is none."""
        self._slave = slave = unit_quaternion(quaternion)
        self._slave_at = self._now
        if slave is not None and (self._rest is None or rotation_distance(
                self._rest, slave) > REST_ANGLE):
            self._rest, self._rest_at = slave, self._now
        self._check()
        limit = self._conditions.tracking_limit
        if limit < inf and slave is not None and self._command is not None \
                and rotation_distance(self._command.rotation, slave) > limit:
            self.disengage(NOT_FOLLOWING)

    def take_level(self, level: float) -> None:
        """Take the protection level of the orientation, rad."""
        self._level = level
        self._level_at = self._now
        self._check()

    def take_master(self, stamp: int, quaternion: Quaternion[float]) -> Quaternion[float] | None:
        """
        Take an orientation of the master.

        Parameters
        ----------
        stamp : int
            Time at which it was sampled, ns.
        quaternion : tuple of four float
            Unit quaternion x, y, z, w.

        Returns
        -------
        tuple of four float or None
            The slave's commanded rotation; None while it is not engaged, and between commands.

        """
        before, self._stamp = self._stamp, stamp
        if self.phase is not Phase.DISENGAGED and before is not None:
            if stamp <= before:
                self._stamp = before
                return None
            # Silence, even if all clocks have stood still meanwhile.
            if stamp - before > self._conditions.orientation_timeout * SECOND:
                self.disengage(NO_ORIENTATION)
        master = unit_quaternion(quaternion)
        if master is None:
            self._master = None
            self._check()
            return None
        self._master = multiply_quaternions(self._conditions.registration, master)
        self._master_at = self._now
        if self._enabled_at is not None and self._present:
            self._roll.add(self._master)
        if not self._grid.is_due(stamp):
            return None
        if self.phase is not Phase.ENGAGED:
            self._try_to_engage(stamp)
            return None if self._command is None else self._command.rotation
        return self._follow(stamp)

    def _try_to_engage(self, stamp: int) -> None:
        """Begin to follow from where master and slave are now, if every condition is met."""
        if self.phase is Phase.CLUTCHED:
            if self._clutch or not self._is_slave_at_rest():
                return
            if not self._is_aligned():
                self.disengage(NOT_ALIGNED)
                return
        elif self._obstacle() or self._awaited():
            return
        if self._master is None or self._slave is None:
            return
        self.phase = Phase.ENGAGED
        self.starts += 1
        self._enabled_at = None
        self._offset = Offset(self._master, self._slave)
        self._command = LimitedRotation(self._limits, self._slave)
        self._closing = 0.0 if self._conditions.absolute else None
        self._commanded = stamp

    def _follow(self, stamp: int) -> Quaternion[float] | None:
        """Return the command of the law, within the limits; None where it broke one."""
        if self._offset is None or self._command is None or self._master is None:
            return None
        dt = (stamp - self._commanded) / SECOND
        used = min(dt, self._limits.longest)
        if used > self._credit:
            return None
        self._credit -= used
        left = self._offset.angle
        if self._closing is not None:
            self._close(self._closing, left, dt)
        broken = self._command.advance(self._offset.command(self._master), dt)
        if broken:
            self.disengage(f'{broken} above the limit')
            return None
        if self._closing is not None:
            # From where the command is: it may not have followed so fast.
            self._offset = Offset(self._master, self._command.rotation)
            self._closing = max(0.0, left - self._offset.angle) / dt
        self._commanded = stamp
        return self._command.rotation

    def _close(self, before: float, left: float, dt: float) -> None:
        """Shrink the offset, rad, that is left; the speed was `before`, rad/s."""
        if self._offset is None or self._command is None:
            return
        if left <= ALIGNED:
            self._closing = None
            self._offset.shrink(left)
            return
        speed = closing_speed(left, before, self._limits, self._conditions.align_speed, dt)
        self._offset.shrink(speed * dt)
        self._command.restart()

    def _check(self) -> None:
        """Disengage if what has just come is an obstacle."""
        if self.phase is not Phase.DISENGAGED:
            obstacle = self._obstacle()
            if obstacle:
                self.disengage(obstacle)

    def _obstacle(self) -> str:
        """Return what forbids that the slave follows; empty if nothing does."""
        conditions, now = self._conditions, self._now
        if self.hindrance:
            return self.hindrance
        if self._state is None:
            return NO_STATE
        if not self._state.publishes:
            return self._state.text
        if self._master is None or now - self._master_at > conditions.orientation_timeout:
            return NO_ORIENTATION
        if self._enabling == 0:
            return NOT_ENABLED
        if self._slave is None or now - self._slave_at > conditions.slave_timeout:
            return NO_SLAVE
        if conditions.protection_limit < inf:
            if now - self._level_at > conditions.orientation_timeout:
                return NO_LEVEL
            if not self._level <= conditions.protection_limit:
                return HIGH_LEVEL
        return ''

    def _awaited(self) -> str:
        """Return what engaging waits for; empty if for nothing."""
        if not self._present \
                or self._now - self._present_at > self._conditions.presence_timeout:
            return NO_PRESENCE
        if self._clutch:
            return CLUTCH
        if self._enabled_at is None:
            return NO_ENABLE
        if self._roll.extent < self._conditions.roll:
            return NO_ROLL
        if not self._is_slave_at_rest():
            return SLAVE_MOVES
        return '' if self._is_aligned() else NOT_ALIGNED

    def _is_slave_at_rest(self) -> bool:
        """Return whether the slave's pose is still the one that it has said to have."""
        return self._rest is not None and self._slave_at - self._rest_at >= REST_TIME - ROUNDING

    def _is_aligned(self) -> bool:
        """Return whether master and slave are within the tolerance."""
        if self._conditions.tolerance == inf:
            return True
        offset = self.offset
        return offset is not None and offset <= self._conditions.tolerance
