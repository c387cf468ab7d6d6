# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""When the slave may follow: the latest of each input, and what forbids it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan, radians

from spm_haptic_master.kinematics.rotations import multiply_quaternions, rotation_distance
from spm_haptic_master.kinematics.vectors import subtracted
from spm_haptic_master.supervision.orientation_state import OrientationState
from spm_haptic_master.teleoperation.command import Pose
from spm_haptic_master.teleoperation.remote_centre import RemoteCentreSettings
from spm_haptic_master.teleoperation.vectors import (
    FloatQuaternion,
    FloatVector,
    norm,
    unit_quaternion,
)

# Why it is not engaged, or no longer.
NO_ORIENTATION = 'no orientation'
NO_PRESENCE = 'no presence'
NO_ENABLE = 'waiting for enable'
NOT_ALIGNED = 'not aligned'
NO_INSERTION = 'insertion missing'
# Rounding of times (s).
ROUNDING = 1e-9
# A slave is at rest after this time (s) within this angle (rad) and distance (m). It begins to
# follow from its measured pose: a moving slave would be elsewhere when the command arrives.
REST_TIME = 0.05
REST_ANGLE = radians(0.5)
REST_DISTANCE = 0.001
# An insertion is missing after this many periods (unit 1), and this time on its way (s).
INSERTION_PERIODS = 3.0
INSERTION_DELAY = 0.01


@dataclass(frozen=True, slots=True)
class Conditions:
    """When the slave may follow, and how."""

    # Rotation from the master's to the slave's base frame.
    registration: FloatQuaternion
    # Angular speed at which the offset taken at engaging shrinks to none, rad/s; 0: it stays.
    align_speed: float
    tolerance: float  # largest offset at which it engages, rad; inf: any
    enable_timeout: float  # time after which an unused enable lapses, s
    # Largest ages of the orientation, of the slave's pose and of the presence (s).
    orientation_timeout: float
    slave_timeout: float
    presence_timeout: float
    protection_limit: float  # largest protection level, rad; inf: any that is published
    tracking_limit: float  # largest angle from the command to the slave, rad; inf: any
    tip_tracking_limit: float  # largest distance from the command to the slave's tip, m; inf: any
    command_rate: float  # Hz; 0: a command with each orientation
    sample_rate: float  # rate of the orientations, Hz
    requires_trocar: bool  # the slave pivots: it does not follow while its trocar is unknown
    centre: RemoteCentreSettings


class Rest:
    """Whether the slave rests, by its poses: it stays near one of them for REST_TIME."""

    def __init__(self) -> None:
        # Pose near which it has stayed, None until its next one; time of this and the latest, s.
        self._place: Pose | None = None
        self._began = self._latest = -inf

    def restart(self) -> None:
        """Wait for rest from its next pose on."""
        self._place = None

    def note(self, pose: Pose, now: float) -> None:
        """Note a pose that has come at a time, s."""
        if self._place is None or not _is_near(self._place, pose):
            self._place = pose
            self._began = now
        self._latest = now

    @property
    def is_reached(self) -> bool:
        """Whether it has stayed for long enough."""
        return self._place is not None and self._latest - self._began >= REST_TIME - ROUNDING


def _is_near(one: Pose, other: Pose) -> bool:
    """Return whether two poses are those of a slave at rest."""
    moved = norm(subtracted(one.position, other.position))
    return moved <= REST_DISTANCE and rotation_distance(one.rotation, other.rotation) <= REST_ANGLE


class Inputs:
    """The latest of each input and its age; only a unit quaternion counts as a rotation."""

    def __init__(self, conditions: Conditions) -> None:
        self._conditions = conditions
        self.now = 0.0  # time that has passed, s
        # Rotation of the master, pose of the slave, in the slave's base frame, and when they came.
        self.master: FloatQuaternion | None = None
        self._master_at = -inf
        self.slave: Pose | None = None
        self._slave_at = -inf
        self._rest = Rest()
        # Protection level, rad, and presence of the surgeon, and when they came.
        self._level = nan
        self._level_at = -inf
        self._is_pressed = False
        self._pressed_at = -inf
        self.clutch = False  # whether it is pressed
        self.state: OrientationState | None = None
        # Time of the enable in effect at the master, ns (0: none); None while the master does not
        # publish it.
        self.enabling: int | None = None
        # Operating state of the slave in words, while that forbids it to follow; else empty.
        self.slave_obstacle = ''
        # Fault of the force feedback in words; empty without one.
        self.force_fault = ''
        self.trocar: FloatVector | None = None  # in the slave's base frame, m
        self.insertion = nan  # of the master, m
        # Time without an insertion, s, in which this process ran.
        self._insertion_age = inf
        period = 1.0 / conditions.sample_rate
        self._insertion_timeout = INSERTION_PERIODS * period + INSERTION_DELAY + ROUNDING
        self._longest_pause = period + INSERTION_DELAY

    def pass_time(self, dt: float) -> None:
        """Let time pass, s."""
        self.now += dt
        # What came while this process did not run is still to be read.
        self._insertion_age += min(dt, self._longest_pause)

    def take_master(self, quaternion: FloatQuaternion) -> None:
        """Take the master's rotation in its own base frame."""
        master = unit_quaternion(quaternion)
        self._master_at = self.now
        if master is None:
            self.master = None
        else:
            self.master = multiply_quaternions(self._conditions.registration, master)

    def take_slave(self, pose: Pose | None) -> None:
        """Take the slave's measured pose; None, or a rotation that is none: no pose."""
        if pose is None:
            rotation = None
        else:
            rotation = unit_quaternion(pose.rotation)
        self._slave_at = self.now
        if pose is None or rotation is None:
            self.slave = None
            return
        self.slave = Pose(rotation, pose.position)
        self._rest.note(self.slave, self.now)

    def take_insertion(self, insertion: float) -> None:
        """Take the insertion of the master, m."""
        self.insertion = insertion
        self._insertion_age = 0.0

    def await_rest(self) -> None:
        """Wait for rest again before the slave follows: the last command may still move it."""
        self._rest.restart()

    def take_presence(self, pressed: bool) -> None:
        """Take whether the surgeon is present."""
        self._is_pressed = pressed
        self._pressed_at = self.now

    def take_level(self, level: float) -> None:
        """Take the protection level of the orientation, rad."""
        self._level = level
        self._level_at = self.now

    def blocking(self) -> str:
        """Return what forbids that the slave follows; empty if nothing does."""
        found = self._obstacle_of_master() or self._obstacle_of_slave()
        if found or self._conditions.protection_limit == inf:
            return found
        return self._obstacle_of_level()

    def _obstacle_of_master(self) -> str:
        """Return what of the master forbids that the slave follows; empty if nothing does."""
        if self.state is None:
            return 'no state of the orientation'
        if not self.state.publishes:
            return self.state.text
        if (
            self.master is None
            or self.now - self._master_at > self._conditions.orientation_timeout
        ):
            return NO_ORIENTATION
        if self.enabling == 0:
            return 'master not enabled'
        return self.force_fault

    def _obstacle_of_level(self) -> str:
        """Return what of the protection level forbids it; empty if nothing does."""
        if self.now - self._level_at > self._conditions.orientation_timeout:
            return 'no protection level'
        is_low = self._level <= self._conditions.protection_limit
        return '' if is_low else 'protection level above the limit'

    def _obstacle_of_slave(self) -> str:
        """Return what of the slave or the insertion forbids it; empty if nothing does."""
        conditions = self._conditions
        if self.slave is None or self.now - self._slave_at > conditions.slave_timeout:
            return 'no pose of the slave'
        if self.slave_obstacle:
            return self.slave_obstacle
        if self.trocar is None:
            return 'no trocar' if conditions.requires_trocar else ''
        if self._insertion_age > self._insertion_timeout and conditions.centre.scale:
            return NO_INSERTION
        return ''

    @property
    def is_present(self) -> bool:
        """Whether the surgeon is present, by a message that is not too old."""
        age = self.now - self._pressed_at
        return self._is_pressed and age <= self._conditions.presence_timeout

    @property
    def is_slave_at_rest(self) -> bool:
        """Whether the slave is still where its last pose was."""
        return self._rest.is_reached

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
        return rotation_distance(self.master, self.slave.rotation)
