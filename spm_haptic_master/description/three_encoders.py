# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The orientation by three encoders alone: the classic model beside the published one."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
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


class ThreeEncoders:
    """
    The orientation of three encoders, th1A, th1B, th1C, along a motion.

    Near a singularity it continues from its own last pose, as the paper's classic model; clear of
    it, from the published one, so that it does not stay in another assembly mode. `turn` is its
    orientation in the frame of the published platform, quaternion x, y, z, w; None without
    readings.
    """

    _passive: tuple[float, float]  # th2A and th3A of `turn`, rad

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        # Stamps, ns, and the angles of all nine joints, rad.
        self._poses: deque[tuple[int, Sequence[float]]] = deque(maxlen=POSES)
        self._waiting: tuple[int, Sequence[float]] | None = None
        self._solved_at = 0
        self.turn: Quaternion[float] | None = None

    @property
    def error(self) -> float | None:
        """Angle between its orientation and the published one, rad; None without readings."""
        return None if self.turn is None else 2.0 * acos(min(1.0, abs(self.turn[3])))

    def add_pose(self, stamp: int, angles: Sequence[float]) -> None:
        """Take the angles of all nine joints at the published orientation; ns, rad."""
        if self._poses and stamp <= self._poses[-1][0]:
            self._poses.clear()
        self._poses.append((stamp, angles))
        if not 0 <= stamp - self._solved_at < RESULT_TIMEOUT:
            self.turn = None

    def add_readings(self, stamp: int, readings: Sequence[float]) -> None:
        """Take th1A, th1B, th1C as read, rad, at a stamp, ns."""
        if (
            self._waiting is None
            or stamp < self._waiting[0]
            or not self._poses
            or self._poses[0][0] > self._waiting[0]
        ):
            self._waiting = stamp, readings

    def solve(self, dexterity: float | None) -> None:
        """
        Solve for the readings that wait, where the pose at their stamp is known by now.

        `dexterity` is the three encoders', 0 to 1; None if unknown.
        """
        if self._waiting is None:
            return
        stamp, readings = self._waiting
        for (before, low), (after, high) in pairwise(self._poses):
            if before <= stamp <= after:
                share = (stamp - before) / (after - before)
                th1a, th2a, th3a = (
                    one + share * remainder(other - one, 2.0 * pi)
                    for one, other in zip(low[:3], high[:3], strict=True)
                )
                break
        else:
            return
        self._waiting = None
        if not all(map(isfinite, readings)):
            return
        begin = th2a, th3a
        if self.turn is not None and dexterity is not None and dexterity <= CLEAR:
            begin = self._passive
        published = chain_quaternion(th1a, th2a, th3a, self._geometry, FLOATS)
        quaternion, th2a, th3a = continue_mode(readings, *begin, self._geometry)
        self._passive, self._solved_at = (th2a, th3a), stamp
        self.turn = multiply_quaternions(conjugate(published), quaternion)
