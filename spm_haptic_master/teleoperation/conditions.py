# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""When the slave may follow: the latest of each input, and what forbids it."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, inf, nan, pi, radians, tau

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    rotation_distance,
)
from spm_haptic_master.supervision.orientation_state import OrientationState
from spm_haptic_master.teleoperation.command_limits import unit_quaternion

# Why it is not engaged, or no longer.
NO_ORIENTATION = 'no orientation'
NO_PRESENCE = 'no presence'
NO_ENABLE = 'waiting for enable'
NOT_ALIGNED = 'not aligned'
# Rounding of times (s).
ROUNDING = 1e-9
# A slave is at rest after this time (s) within this angle (rad). It begins to follow from its
# measured pose: a moving slave would be elsewhere when the command arrives.
REST_ANGLE, REST_TIME = radians(0.5), 0.05


@dataclass(frozen=True, slots=True)
class Conditions:
    """When the slave may follow, and how."""

    # Rotation from the master's to the slave's base frame.
    registration: Quaternion[float]
    # Angular speed at which the offset taken at engaging shrinks to none, rad/s; 0: it stays.
    align_speed: float
    tolerance: float  # largest offset at which it engages, rad; inf: any
    roll: float  # roll of the wrist that is asked for, rad; 0: none
    enable_timeout: float  # time after which an unused enable lapses, s
    # Largest ages of the orientation, of the slave's pose and of the presence (s).
    orientation_timeout: float
    slave_timeout: float
    presence_timeout: float
    protection_limit: float  # largest protection level, rad; inf: any that is published
    tracking_limit: float  # largest angle from the command to the slave, rad; inf: any
    command_rate: float  # Hz; 0: a command with each orientation
    sample_rate: float  # rate of the orientations, Hz


class Inputs:
    """The latest of each input and its age; only a unit quaternion counts as a rotation."""

    def __init__(self, conditions: Conditions) -> None:
        self._conditions = conditions
        self.now = 0.0  # time that has passed, s
        # Times at which rotations and presence came, and the slave came to rest, s.
        self._master_at = self._slave_at = self._rest_at = self.present_at = -inf
        # Rotations of master and slave in the slave's base frame.
        self.master: Quaternion[float] | None = None
        self.slave: Quaternion[float] | None = None
        # Pose near which the slave has stayed; None until its next pose.
        self._rest: Quaternion[float] | None = None
        self.level, self.level_at = nan, -inf  # protection level, rad
        self.present = self.clutch = False
        self.state: OrientationState | None = None
        # Time of the enable in effect at the master, ns (0: none); None while the master does not
        # publish it.
        self.enabling: int | None = None

    def take_master(self, quaternion: Quaternion[float]) -> None:
        """Take the master's rotation in its own base frame."""
        master = unit_quaternion(quaternion)
        self._master_at = self.now
        self.master = (
            None if master is None else multiply_quaternions(self._conditions.registration, master)
        )

    def take_slave(self, quaternion: Quaternion[float]) -> None:
        """Take the slave's measured rotation."""
        self.slave = slave = unit_quaternion(quaternion)
        self._slave_at = self.now
        if slave is not None and (
            self._rest is None or rotation_distance(self._rest, slave) > REST_ANGLE
        ):
            self._rest, self._rest_at = slave, self.now

    def await_rest(self) -> None:
        """Wait for rest again before the slave follows: the last command may still move it."""
        self._rest = None

    def blocking(self) -> str:
        """Return what forbids that the slave follows; empty if nothing does."""
        conditions, now = self._conditions, self.now
        if self.state is None:
            return 'no state of the orientation'
        if not self.state.publishes:
            return self.state.text
        if self.master is None or now - self._master_at > conditions.orientation_timeout:
            return NO_ORIENTATION
        if self.enabling == 0:
            return 'master not enabled'
        if self.slave is None or now - self._slave_at > conditions.slave_timeout:
            return 'no pose of the slave'
        if conditions.protection_limit < inf:
            if now - self.level_at > conditions.orientation_timeout:
                return 'no protection level'
            if not self.level <= conditions.protection_limit:
                return 'protection level above the limit'
        return ''

    @property
    def is_present(self) -> bool:
        """Whether the surgeon is present, by a message that is not too old."""
        return self.present and self.now - self.present_at <= self._conditions.presence_timeout

    @property
    def is_slave_at_rest(self) -> bool:
        """Whether the slave is still where its last pose was."""
        return self._rest is not None and self._slave_at - self._rest_at >= REST_TIME - ROUNDING

    @property
    def is_aligned(self) -> bool:
        """Whether master and slave are within the tolerance."""
        offset = self.offset
        return offset is not None and offset <= self._conditions.tolerance

    @property
    def offset(self) -> float | None:
        """Angle between master and slave, rad; None while one of them is missing."""
        if self.master is None or self.slave is None:
            return None
        return rotation_distance(self.master, self.slave)


class Roll:
    """How far the handle has rolled about its own z axis, to and fro, since the first rotation."""

    def __init__(self) -> None:
        self._first: Quaternion[float] | None = None
        self._angle = self._least = self._largest = 0.0

    @property
    def extent(self) -> float:
        """Return the difference of the largest and the smallest roll, rad."""
        return self._largest - self._least

    def add(self, rotation: Quaternion[float]) -> None:
        """Add a rotation of the handle, as a unit quaternion x, y, z, w."""
        if self._first is None:
            self._first = rotation
            return
        _, _, z, w = multiply_quaternions(conjugate(self._first), rotation)
        # The twist about z of the rotation since the first, on the branch of the last one.
        turn = (2.0 * atan2(z, w) - self._angle) % tau
        self._angle += turn - tau if turn > pi else turn
        self._least = min(self._least, self._angle)
        self._largest = max(self._largest, self._angle)
