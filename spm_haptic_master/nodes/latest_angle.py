# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The latest angle of a joint on a topic, while it is not too old."""

from __future__ import annotations

from math import isfinite, nan
import time

from sensor_msgs.msg import JointState


class LatestAngle:
    """
    Keeps the first position of the latest JointState.

    Parameters
    ----------
    timeout
        Age at which an angle is none any more, s.

    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        # Angle, rad, and when it came, s, monotonic: one value, as two threads share it.
        self._latest = nan, -1.0

    def take(self, message: JointState) -> None:
        """
        Take a message; one without a finite position changes nothing.

        Parameters
        ----------
        message : JointState
            Angle of one joint, rad.

        """
        if len(message.position) and isfinite(message.position[0]):
            self._latest = float(message.position[0]), time.monotonic()

    def at(self, now: float) -> float | None:
        """
        Return the angle at a time, s, monotonic, in rad; None if it is too old.

        Parameters
        ----------
        now : float
            Present time.

        """
        angle, came_at = self._latest
        if came_at >= 0.0 and now - came_at <= self._timeout:
            return angle
        return None
