# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How long ago each sensor was last checked by the others."""

from __future__ import annotations

from math import inf


class Exposure:
    """
    Time since each sensor was last checked.

    A sensor is checked where its own part of the protection level has been within the alert limit
    for a window of consistent samples: a fault of it would have been detected.

    Parameters
    ----------
    sensors : int
        Number of sensors.
    window : float
        Time of consistency that is a check, s.

    """

    __slots__ = ('_checked', '_visible', '_window')

    def __init__(self, sensors: int, window: float) -> None:
        self._window = round(window * 1e9)
        self._visible: list[int | None] = [None] * sensors
        self._checked: list[int | None] = [None] * sensors

    def restart(self) -> None:
        """Forget every check: the sensors were not seen for a while."""
        self._visible = [None] * len(self._visible)
        self._checked = [None] * len(self._checked)

    def interrupt(self) -> None:
        """Begin the windows again: a sample was not consistent."""
        self._visible = [None] * len(self._visible)

    def take(self, stamp: int, parts: list[float], limit: float) -> float:
        """
        Note which sensors a consistent sample checks; return the protection level, rad.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        parts : list of float
            Each sensor's part of the protection level, rad.
        limit : float
            Alert limit, rad.

        Returns
        -------
        float
            The largest part within the limit; 0 where there is none.

        """
        level = 0.0
        visible, checked = self._visible, self._checked
        for sensor, part in enumerate(parts):
            if part > limit:
                visible[sensor] = None
                continue
            if part > level:
                level = part
            since = visible[sensor]
            if since is None:
                visible[sensor] = stamp
            elif stamp - since >= self._window:
                checked[sensor] = stamp
        return level

    def times(self, stamp: int) -> tuple[float, ...]:
        """Return the seconds since each sensor was last checked; inf before the first time."""
        return tuple(inf if last is None else (stamp - last) * 1e-9 for last in self._checked)

    def unchecked(self) -> tuple[int, ...]:
        """Return the sensors that have never been checked."""
        return tuple(sensor for sensor, last in enumerate(self._checked) if last is None)
