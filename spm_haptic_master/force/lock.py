# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A locked orientation: a spring to it whose centre moves there slowly."""

from __future__ import annotations

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    quaternion_from_vector,
    rotation_between,
    rotation_distance,
)
from spm_haptic_master.kinematics.vectors import scaled

# Speed of the spring's centre (rad/s). A spring of 1 N m/rad that begins 30 deg away from the
# handle would turn a free one at 5 rad/s.
LOCK_SPEED = 0.5


class Lock:
    """
    The spring of a locked orientation.

    It begins at the handle's orientation, without torque.

    Parameters
    ----------
    stiffness : float
        N m/rad.

    """

    def __init__(self, stiffness: float) -> None:
        self._stiffness = stiffness
        self._centre: Quaternion[float] | None = None  # R_base_platform

    def release(self) -> None:
        """Forget where the centre is: the next lock begins at the handle's orientation."""
        self._centre = None

    def torque(
        self,
        target: Quaternion[float],
        quaternion: Quaternion[float],
        dt: float,
    ) -> Vector[float]:
        """
        Return the torque towards the centre, and move it towards its target.

        Parameters
        ----------
        target, quaternion : tuple of four float
            Locked orientation and that of the handle, R_base_platform, x, y, z, w.
        dt : float
            Time since the last sample, s.

        Returns
        -------
        tuple of three float
            N m in the base frame.

        """
        start = quaternion if self._centre is None else self._centre
        self._centre = _turned(start, target, LOCK_SPEED * dt)
        return scaled(self._stiffness, rotation_between(quaternion, self._centre))


def _turned(
    start: Quaternion[float],
    target: Quaternion[float],
    step: float,
) -> Quaternion[float]:
    """Return the orientation on the way from start to target, a step (rad) away, or the target."""
    distance = rotation_distance(target, start)
    if distance <= step:
        return target
    way = rotation_between(start, target)
    return multiply_quaternions(quaternion_from_vector(*scaled(step / distance, way)), start)
