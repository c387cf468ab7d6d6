# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether the torque that a drive reports follows its command, despite late status frames."""

from __future__ import annotations

# Deviation of the torque from its command (share of it) that is a fault if it lasts (s). Below a
# quarter of the cap friction and noise of the drive are larger than such a share.
TORQUE_SHARE = 0.2
TORQUE_FLOOR = 0.25
TORQUE_TIME = 0.05


class TorqueWatch:
    """
    Compares reported torques with the commands that they may be of.

    A status frame may be as old as two of its periods: its torque may lie anywhere in the range of
    the commands since the status frame before the last, widened by TORQUE_SHARE.

    Parameters
    ----------
    cap : int
        Largest torque of the drive, per mille of the rated torque.

    """

    def __init__(self, cap: int):
        self._floor = TORQUE_FLOOR * cap
        # Command in force, and the ranges of the commands since the latest status frame and
        # between that one and the one before, per mille.
        self._command = 0
        self._range = (0, 0)
        self._range_before = (0, 0)
        self._reported = 0
        # Time for which the torque was off its command, less that for which it followed, s.
        self._off_time = 0.0

    def clear(self) -> None:
        """Forget the time for which the torque was off its command."""
        self._off_time = 0.0

    def command(self, torque: int) -> None:
        """Note a torque that is sent, per mille."""
        self._command = torque
        low, high = self._range
        self._range = min(low, torque), max(high, torque)

    def report(self, torque: int, elapsed: float) -> None:
        """
        Compare the torque of a status frame with the commands.

        Parameters
        ----------
        torque : int
            Torque that the drive reports, per mille.
        elapsed : float
            Time since the status frame before, s.

        """
        low = min(self._range[0], self._range_before[0])
        high = max(self._range[1], self._range_before[1])
        self._range_before = self._range
        self._range = (self._command, self._command)
        self._reported = torque
        allowed = TORQUE_SHARE * max(abs(low), abs(high), self._floor)
        follows = low - allowed <= torque <= high + allowed
        # A torque that only crosses its command now and then does not follow it.
        self._off_time = max(0.0, self._off_time + (-elapsed if follows else elapsed))

    @property
    def deviation(self) -> str | None:
        """Return in words that the torque has been off its command for too long; else None."""
        if self._off_time <= TORQUE_TIME:
            return None
        return (
            f'torque {self._reported} per mille for a command of {self._command}, off by '
            f'more than {100.0 * TORQUE_SHARE:.0f} % for {1e3 * self._off_time:.0f} ms'
        )
