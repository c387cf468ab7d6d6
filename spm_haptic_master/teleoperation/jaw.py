# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The law of the jaw: it follows the gripper, with an offset that shrinks to none.

    jaw_cmd = gripper + offset        offset at the start = jaw - gripper

Nothing jumps: the first command is where the jaw is.
"""

from __future__ import annotations

from math import copysign

from spm_haptic_master.timing import SECOND


class FollowingJaw:
    """
    One course of the jaw, from where gripper and jaw are at a stamp.

    Parameters
    ----------
    align_speed
        Speed at which the offset shrinks, rad/s.
    gripper, jaw
        Angles of the master's gripper and of the slave's jaw, rad.
    stamp
        Stamp of the first command, ns.

    """

    def __init__(
        self,
        align_speed: float,
        gripper: float,
        jaw: float,
        stamp: int,
    ) -> None:
        self._align_speed = align_speed
        self._offset = jaw - gripper
        self._stamp = stamp

    def advance(self, gripper: float, stamp: int) -> float:
        """Return the commanded angle of the jaw, rad, for one of the gripper, rad, at a stamp."""
        shrunk = self._align_speed * max(0.0, (stamp - self._stamp) / SECOND)
        self._offset = copysign(max(0.0, abs(self._offset) - shrunk), self._offset)
        self._stamp = max(self._stamp, stamp)
        return gripper + self._offset
