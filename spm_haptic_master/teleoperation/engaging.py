# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Whether the slave follows: an explicit state machine of engaging, clutch and what ends both.

    disengaged --(presence and a fresh enable, every condition met)--> engaged
    engaged --(clutch pressed)--> clutched --(released, slave at rest, aligned)--> engaged
    engaged, clutched --(a condition lost, presence gone, a limit broken, disable)--> disengaged

Nothing engages again by itself: what disengages also uses up the `enable`.
"""

from __future__ import annotations

from enum import Enum

from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.kinematics.vectors import subtracted
from spm_haptic_master.supervision.orientation_state import OrientationState
from spm_haptic_master.teleoperation import remote_centre
from spm_haptic_master.teleoperation.burst_limit import BurstLimit
from spm_haptic_master.teleoperation.command import Command, Pose
from spm_haptic_master.teleoperation.command_limits import CommandLimits
from spm_haptic_master.teleoperation.conditions import (
    Conditions,
    Inputs,
    NO_ENABLE,
    NO_ORIENTATION,
    NO_PRESENCE,
    NOT_ALIGNED,
)
from spm_haptic_master.teleoperation.following import Following
from spm_haptic_master.teleoperation.remote_centre import Pivot, RemoteCentre
from spm_haptic_master.teleoperation.vectors import FloatQuaternion, FloatVector, norm
from spm_haptic_master.timing import SECOND, StampGrid


class Phase(Enum):
    """The states of the machine."""

    DISENGAGED = 'disengaged'
    ENGAGED = 'engaged'
    CLUTCHED = 'clutched'


class Teleoperation:
    """
    One master and one slave.

    Call `pass_time` with the time since the last call before each input: an exceeded age is
    noticed before new data can hide it.
    """

    def __init__(self, conditions: Conditions, limits: CommandLimits) -> None:
        self._conditions = conditions
        self._limits = limits
        self.phase = Phase.DISENGAGED
        # Why it was disengaged last; empty before the first time.
        self.last_disengage_reason = ''
        # Why the caller forbids that the slave follows, such as a second publisher; else empty.
        self.external_block = ''
        # How often the slave has begun to follow, by engaging or after the clutch.
        self.starts = 0
        self._inputs = Inputs(conditions)
        # When an enable came that has not been used up.
        self._enabled_at: float | None = None
        # Stamp of the last orientation (ns), and which of them are followed by a command.
        self._stamp: int | None = None
        self._grid = StampGrid(conditions.command_rate, conditions.sample_rate)
        self._burst = BurstLimit(limits.longest_step)
        # The course of the slave; None while it is not engaged.
        self._following: Following | None = None
        # Where the slave pivots; kept while the clutch is pressed, None without a trocar.
        self._pivot: Pivot | None = None

    @property
    def state(self) -> str:
        """Return the state in words: 'disengaged: WHY', 'engaged' or 'clutched'."""
        if self.phase is not Phase.DISENGAGED:
            return str(self.phase.value)
        why = self._blocking() or self._pending()
        if why == NO_ENABLE and self.last_disengage_reason:
            why += f', after: {self.last_disengage_reason}'
        return f'{Phase.DISENGAGED.value}: {why or NO_ENABLE}'

    @property
    def is_blocked(self) -> bool:
        """Return whether it could not be engaged, whatever the surgeon does."""
        return bool(self._blocking())

    @property
    def offset(self) -> float | None:
        """Return the angle between master and slave, rad; None while one of them is missing."""
        return self._inputs.offset

    @property
    def depth(self) -> float | None:
        """Return the measured depth of the tip, m; None without trocar or pose of the slave."""
        trocar = self._inputs.trocar
        slave = self._inputs.slave
        if trocar is None or slave is None:
            return None
        return remote_centre.depth_of(trocar, slave)

    def pass_time(self, dt: float) -> None:
        """Let time pass, s: disengage if an input has become too old."""
        self._inputs.pass_time(dt)
        self._burst.pass_time(dt)
        if self.phase is not Phase.DISENGAGED:
            self._release(self._blocking() or ('' if self._inputs.is_present else NO_PRESENCE))
        elif self._enabled_at is not None and (
            self._inputs.now - self._enabled_at > self._conditions.enable_timeout
            or self._blocking()
        ):
            self._enabled_at = None

    def disengage(self, reason: str = 'disabled') -> None:
        """Disengage, and use up an enable, whatever the state is."""
        if self.phase is not Phase.DISENGAGED:
            self.last_disengage_reason = reason
        self.phase = Phase.DISENGAGED
        self._enabled_at = None
        self._following = None
        self._pivot = None
        self._inputs.await_rest()

    def enable(self) -> str:
        """Take an enable; return why it has no effect, empty if it has one."""
        obstacle = self._blocking()
        if not obstacle and self.phase is Phase.DISENGAGED:
            self._enabled_at = self._inputs.now
        return obstacle

    def take_state(self, state: OrientationState) -> None:
        """Take the state of the orientation: while it is not published, no slave follows."""
        self._inputs.state = state
        self._release(self._blocking())

    def take_enabling(self, number: int, age: float) -> None:
        """
        Take the time of the enable in effect at the master, ns (0: none), and its age, s.

        A new time is a fresh enable, unless it is the first one known, which may be older than
        this machine, or so old that the enable has lapsed.
        """
        before = self._inputs.enabling
        self._inputs.enabling = number
        self._release(self._blocking())
        if (
            number
            and before is not None
            and number != before
            and abs(age) <= self._conditions.enable_timeout
        ):
            self.enable()

    def take_presence(self, pressed: bool) -> None:
        """Take the presence of the surgeon."""
        self._inputs.take_presence(pressed)
        if not pressed:
            self._release(NO_PRESENCE)

    def take_clutch(self, pressed: bool | None) -> None:
        """
        Take the clutch: while it is pressed the slave holds and the master moves freely.

        None: its publisher has gone. If the clutch was pressed, that releases it and disengages.
        """
        if pressed is None and self._inputs.clutch:
            self._release('clutch gone while pressed')
        self._inputs.clutch = bool(pressed)
        if pressed and self.phase is Phase.ENGAGED:
            self.phase = Phase.CLUTCHED
            self._following = None
            self._inputs.await_rest()

    def take_slave(self, pose: Pose | None) -> None:
        """Take the slave's measured pose; None, or a rotation that is none: it has no pose."""
        self._inputs.take_slave(pose)
        self._release(self._blocking())
        slave = self._inputs.slave
        following = self._following
        if slave is None or following is None:
            return
        self._release(self._astray(following.command.pose, slave))

    def _astray(self, commanded: Pose, slave: Pose) -> str:
        """Return how the slave's pose is not where its command leads; empty if it follows."""
        conditions = self._conditions
        if rotation_distance(commanded.rotation, slave.rotation) > conditions.tracking_limit:
            return 'the slave does not follow'
        behind = norm(subtracted(commanded.position, slave.position))
        if behind > conditions.tip_tracking_limit:
            return f'tip {remote_centre.MILLIMETRES * behind:.0f} mm from its command'
        if self._pivot is None:
            return ''
        # Where it is known, the shaft is not always the line from the trocar to the tip.
        shaft = conditions.centre.shaft or self._pivot.shaft
        return remote_centre.off_the_trocar(self._pivot.trocar, slave, shaft)

    def take_slave_obstacle(self, obstacle: str) -> None:
        """Take why the slave's own operating state forbids it to follow; empty if it does not."""
        self._inputs.slave_obstacle = obstacle
        self._release(self._blocking())

    def take_force_fault(self, fault: str) -> None:
        """Take the fault of the force feedback that forbids to follow; empty without one."""
        self._inputs.force_fault = fault
        self._release(self._blocking())

    def take_trocar(self, trocar: FloatVector) -> None:
        """
        Take the trocar about which the slave pivots, in its base frame, m.

        One that moves while the slave follows it, or that comes only then, disengages.
        """
        self._inputs.trocar = trocar
        if self.phase is Phase.DISENGAGED:
            return
        if self._pivot is None:
            self.disengage('a trocar was given')
            return
        moved = norm(subtracted(trocar, self._pivot.trocar))
        if moved > remote_centre.TROCAR_TOLERANCE:
            self.disengage(f'trocar moved by {remote_centre.MILLIMETRES * moved:.0f} mm')

    def take_insertion(self, insertion: float) -> None:
        """Take the insertion of the master, m."""
        self._inputs.take_insertion(insertion)

    def take_level(self, level: float) -> None:
        """Take the protection level of the orientation, rad."""
        self._inputs.take_level(level)
        self._release(self._blocking())

    def take_master(self, stamp: int, quaternion: FloatQuaternion) -> Command | None:
        """
        Take an orientation of the master, sampled at a stamp, ns.

        Parameters
        ----------
        stamp
            Sampling time of the orientation, ns.
        quaternion
            R_base_platform, or as mounted, as x, y, z, w; any other than a unit quaternion is no
            orientation.

        Returns
        -------
        Command or None
            The command of the slave; None while it is not engaged, and between commands.

        """
        if not self._is_next(stamp):
            return None
        self._inputs.take_master(quaternion)
        master = self._inputs.master
        if master is None:
            self._release(self._blocking())
            return None
        if not self._grid.is_due(stamp):
            return None
        if self._following is None:
            self._try_to_engage(stamp, master)
        elif not self._advance(self._following, stamp, master):
            return None
        if self._following is None:
            return None
        return self._following.command

    def _is_next(self, stamp: int) -> bool:
        """Return whether a stamp, ns, is to be used: while it follows, none that is not newer."""
        before = self._stamp
        if self.phase is not Phase.DISENGAGED and before is not None:
            if stamp <= before:
                return False
            # Silence, even if all clocks have stood still meanwhile.
            if stamp - before > self._conditions.orientation_timeout * SECOND:
                self.disengage(NO_ORIENTATION)
        self._stamp = stamp
        return True

    def _advance(
        self,
        following: Following,
        stamp: int,
        master: FloatQuaternion,
    ) -> bool:
        """Move the command, and return whether it has; a limit that it would break disengages."""
        if not self._burst.allows((stamp - following.stamp) / SECOND):
            return False
        broken = following.advance(master, self._inputs.insertion, stamp)
        if broken:
            self.disengage(f'{broken} above the limit')
        return not broken

    def _try_to_engage(self, stamp: int, master: FloatQuaternion) -> None:
        """Begin to follow from where master and slave are now, if every condition is met."""
        inputs = self._inputs
        if self.phase is Phase.CLUTCHED:
            if inputs.clutch or not inputs.is_slave_at_rest:
                return
            obstacle = self._obstacle_from_here()
            if obstacle:
                self.disengage(obstacle)
                return
        elif self._blocking() or self._pending():
            return
        if inputs.slave is None:
            return
        self.phase = Phase.ENGAGED
        self.starts += 1
        self._enabled_at = None
        centre = self._centre(inputs.slave)
        self._pivot = None if centre is None else centre.pivot
        self._following = Following(
            self._limits, self._conditions.align_speed, master, inputs.slave, stamp, centre
        )

    def _centre(self, slave: Pose) -> RemoteCentre | None:
        """Return the remote centre of a course that begins at a pose; None without a trocar."""
        inputs = self._inputs
        if inputs.trocar is None:
            return None
        return RemoteCentre(
            settings=self._conditions.centre,
            trocar=inputs.trocar,
            slave=slave,
            insertion=inputs.insertion,
            known=self._pivot,
        )

    def _release(self, reason: str) -> None:
        """Disengage for a reason, if there is one, from engaged or clutched alone."""
        if reason and self.phase is not Phase.DISENGAGED:
            self.disengage(reason)

    def _blocking(self) -> str:
        """Return what forbids that the slave follows; empty if nothing does."""
        return self.external_block or self._inputs.blocking()

    def _pending(self) -> str:
        """Return what engaging waits for; empty if for nothing."""
        inputs = self._inputs
        if not inputs.is_present:
            return NO_PRESENCE
        if inputs.clutch:
            return 'clutch pressed'
        if self._enabled_at is None:
            return NO_ENABLE
        if not inputs.is_slave_at_rest:
            return 'waiting for the slave to be at rest'
        return self._obstacle_from_here()

    def _obstacle_from_here(self) -> str:
        """Return why the slave cannot begin to follow from where it is; empty if it can."""
        inputs = self._inputs
        if not inputs.is_aligned:
            return NOT_ALIGNED
        if inputs.trocar is None or inputs.slave is None:
            return ''
        return remote_centre.obstacle(
            self._conditions.centre, inputs.trocar, inputs.slave, self._pivot
        )
