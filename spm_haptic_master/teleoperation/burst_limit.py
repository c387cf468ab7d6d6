# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands of a backlog, by their stamps as far apart as ever, go out hardly faster than time."""

from __future__ import annotations

# Largest backlog (s) of commands that may go out at once beyond the longest step: a computer
# without real time delays that much now and then. Factor at which that time grows back.
BURST = 0.01
GROWTH = 1.25


class BurstLimit:
    """
    Time that commands may still make up for.

    Parameters
    ----------
    longest_step
        Longest time for which one command moves, s.

    """

    def __init__(self, longest_step: float) -> None:
        self._longest_step = longest_step
        self._most = longest_step + BURST  # after a pause, s
        self._left = self._most

    def pass_time(self, dt: float) -> None:
        """Let time pass, s."""
        self._left = min(self._left + GROWTH * dt, self._most)

    def allows(self, step: float) -> bool:
        """Return whether a command may follow a time after the one before, s, and count it."""
        used = min(step, self._longest_step)
        if used > self._left:
            return False
        self._left -= used
        return True
