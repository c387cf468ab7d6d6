# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The orientation by three encoders alone: the classic model beside the published one."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import acos, isfinite, pi, remainder

from spm_haptic_master.kinematics.assembly_modes import continue_mode
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import conjugate, multiply_quaternions

# Poses kept (0.3 s at 60 Hz): readings wait for the pose after them.
POSES = 20
# Time after which the last result is an old one (ns).
RESULT_TIMEOUT = 500_000_000
# Dexterity of three encoders above which four encoders determine its assembly mode (unit 1);
# below, noise of 0.04 deg alone makes an error of up to 3 deg.
CLEAR = 0.1


@dataclass(frozen=True, slots=True)
class LegA:
    """Angles of leg A, which determine the platform's orientation, rad."""

    theta1: float
    theta2: float
    theta3: float

    def orientation(self, geometry: Geometry) -> Quaternion[float]:
        """
        Return the platform's orientation in the base frame, x, y, z, w.

        Parameters
        ----------
        geometry : Geometry
            The mechanism.

        Returns
        -------
        tuple of 4 float
            Unit quaternion of R_base_platform, eq. 6.

        """
        return chain_quaternion(self.theta1, self.theta2, self.theta3, geometry, FLOATS)


@dataclass(frozen=True, slots=True)
class StampedPose:
    """A published pose: its stamp, ns, and the angles of all nine joints, rad."""

    stamp: int
    angles: Sequence[float]


@dataclass(frozen=True, slots=True)
class StampedReadings:
    """th1A, th1B, th1C as read, rad, and their stamp, ns."""

    stamp: int
    angles: Sequence[float]


class PoseHistory:
    """
    The latest published poses, and the one at a time between two of them.

    It holds the last POSES poses. A pose whose stamp is not later than the last one restarts it.
    """

    def __init__(self) -> None:
        self._poses: deque[StampedPose] = deque(maxlen=POSES)

    @property
    def begin(self) -> int | None:
        """Stamp of the oldest pose, ns; None without a pose."""
        if self._poses:
            return self._poses[0].stamp
        return None

    def add(self, stamp: int, angles: Sequence[float]) -> None:
        """Add the angles of all nine joints, rad, at a stamp, ns; an earlier stamp restarts."""
        if self._poses and stamp <= self._poses[-1].stamp:
            self._poses.clear()
        self._poses.append(StampedPose(stamp, angles))

    def at(self, stamp: int) -> LegA | None:
        """
        Return the angles of leg A at a stamp, ns; None if there is no pose before or after.

        Parameters
        ----------
        stamp : int
            Time between two published poses, ns.

        Returns
        -------
        LegA or None
            Each angle interpolated linearly the short way round, rad.

        """
        for before, after in pairwise(self._poses):
            if not before.stamp <= stamp <= after.stamp:
                continue
            share = (stamp - before.stamp) / (after.stamp - before.stamp)
            angles = []
            for joint in range(3):
                first = before.angles[joint]
                turn = remainder(after.angles[joint] - first, 2.0 * pi)
                angles.append(first + share * turn)
            return LegA(*angles)
        return None


class ThreeEncoders:
    """
    The orientation of three encoders, th1A, th1B, th1C, along a motion.

    Near a singularity it continues from its own last pose, as the paper's classic model; clear of
    it, from the published one, so that it does not stay in another assembly mode.

    Parameters
    ----------
    geometry : Geometry
        The mechanism.

    Attributes
    ----------
    turn : tuple of 4 float, or None
        Its orientation in the frame of the published platform, quaternion x, y, z, w; None without
        readings, and after RESULT_TIMEOUT without a new result.

    """

    _passive: tuple[float, float]  # th2A and th3A of `turn`, rad

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        self._poses = PoseHistory()
        self._waiting: StampedReadings | None = None
        self._solved_at = 0
        self.turn: Quaternion[float] | None = None

    @property
    def error(self) -> float | None:
        """Angle between its orientation and the published one, rad; None without readings."""
        if self.turn is None:
            return None
        return angle_of(self.turn)

    def add_pose(self, stamp: int, angles: Sequence[float]) -> None:
        """
        Add the angles of all nine joints at the published orientation; ns, rad.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : sequence of 9 float
            Angles in the order of MECHANISM_JOINT_NAMES, rad.

        """
        self._poses.add(stamp, angles)
        if not 0 <= stamp - self._solved_at < RESULT_TIMEOUT:
            self.turn = None

    def add_readings(self, stamp: int, readings: Sequence[float]) -> None:
        """
        Add th1A, th1B, th1C as read, rad, at a stamp, ns, unless others wait for their pose.

        Parameters
        ----------
        stamp : int
            Time of the readings.
        readings : sequence of 3 float
            Angles of th1A, th1B, th1C; nan: no reading.

        """
        begin = self._poses.begin
        waiting = self._waiting
        is_expected = False
        if waiting is not None and begin is not None:
            is_expected = begin <= waiting.stamp <= stamp
        if not is_expected:
            self._waiting = StampedReadings(stamp, readings)

    def solve(self, dexterity: float | None) -> None:
        """
        Solve for the readings that wait, where the pose at their stamp is known by now.

        Readings that are not finite are dropped.

        Parameters
        ----------
        dexterity : float or None
            Dexterity of the three encoders, 0 to 1. At CLEAR or below, the solution continues from
            the last one, if there is one; else, or if it is not known (None), from the published
            pose.

        """
        waiting = self._waiting
        if waiting is None:
            return
        pose = self._poses.at(waiting.stamp)
        if pose is None:
            return
        self._waiting = None
        if not all(map(isfinite, waiting.angles)):
            return
        begin = pose.theta2, pose.theta3
        is_near_singularity = dexterity is not None and dexterity <= CLEAR
        if self.turn is not None and is_near_singularity:
            begin = self._passive
        quaternion, theta2, theta3 = continue_mode(
            th1=waiting.angles,
            th2a=begin[0],
            th3a=begin[1],
            geometry=self._geometry,
        )
        self._passive = theta2, theta3
        self._solved_at = waiting.stamp
        published = pose.orientation(self._geometry)
        self.turn = multiply_quaternions(conjugate(published), quaternion)


def angle_of(turn: Quaternion[float]) -> float:
    """
    Return the angle of a rotation, quaternion x, y, z, w, rad in 0 .. pi.

    The quaternions q and -q have the same angle.
    """
    half_cosine = abs(turn[3])
    return 2.0 * acos(min(1.0, half_cosine))
