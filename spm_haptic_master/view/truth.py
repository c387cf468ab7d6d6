# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The error of the published orientation of a simulated device, while a story is played."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

from spm_haptic_master.description.three_encoders import angle_of, PoseHistory
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import conjugate, multiply_quaternions


class DeviceError:
    """
    Angle between the published orientation and the simulation's, at equal stamps.

    The published orientation at a stamp is interpolated between the two poses around it, so that a
    truth waits until the pose after it has come.

    Parameters
    ----------
    geometry : Geometry
        The mechanism that is shown.

    """

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        self._poses = PoseHistory()
        # Stamp, ns, and true orientation that wait for the pose after them.
        self._waiting: tuple[int, Quaternion[float]] | None = None

    def add_pose(
        self,
        stamp: int,
        angles: Sequence[float],
    ) -> None:
        """Add the angles of all nine joints, rad, at a stamp, ns."""
        self._poses.add(stamp, angles)

    def error(self, truth: tuple[int, Quaternion[float]] | None) -> float:
        """
        Return the error at the stamp of an earlier truth.

        Parameters
        ----------
        truth : tuple of int and tuple of 4 float, or None
            Stamp, ns, and quaternion x, y, z, w of the newest truth; None if there is no new one.
            It is kept only if no other one waits any longer.

        Returns
        -------
        float
            Angle, rad in 0 .. pi; nan if no truth waits, or if the poses around it are not known.

        """
        waiting = self._waiting
        if waiting is None:
            pose = None
        else:
            pose = self._poses.at(waiting[0])
        begin = self._poses.begin
        is_late = waiting is not None and begin is not None and waiting[0] < begin
        if waiting is None or pose is not None or is_late:
            self._waiting = truth
        if waiting is None or pose is None:
            return nan
        published = pose.orientation(self._geometry)
        return angle_of(multiply_quaternions(conjugate(published), waiting[1]))
