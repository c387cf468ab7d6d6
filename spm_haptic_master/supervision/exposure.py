# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How long ago each sensor was last checked by the others.

A sensor that no other one checks is not in the protection level. It is declared instead: with the
time since it was last checked, which `unchecked_limit` may bound.
"""

from __future__ import annotations

from collections.abc import Collection
from math import inf

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.fkm import Limits
from spm_haptic_master.supervision.parity import WINDOW_SAMPLES
from spm_haptic_master.supervision.symptom import Reason, Symptom, withheld

CAUTION = 1.0  # s unchecked that are a caution: less is a moment on the way through a singularity


class CheckTimes:
    """
    When each sensor was last checked: its part within the alert limit for a whole window.

    Parameters
    ----------
    sensors : int
        Number N of mounted sensors.
    window : int
        Length of the window, ns. Where samples come slowly it is longer: it has `WINDOW_SAMPLES`,
        as that of the parity.

    Attributes
    ----------
    latest : list of int or None, length N
        Stamp at which each sensor was last checked, ns; None before the first time.

    """

    def __init__(self, sensors: int, window: int) -> None:
        self._window = window
        self.latest: list[int | None] = [None] * sensors
        # Number of the latest consistent sample.
        self._samples = 0
        self.interrupt()

    def interrupt(self) -> None:
        """Begin the windows again: a sample was not consistent."""
        # By sensor, stamp (ns) and number of the sample since which its part is within the limit.
        self._within: list[tuple[int, int] | None] = [None] * len(self.latest)

    def note_parts(self, stamp: int, parts: list[float], limit: float) -> tuple[int, ...]:
        """Note the parts of a consistent sample, rad; return the sensors beyond the limit."""
        self._samples += 1
        # Latest begin of a window that ends with this sample: its stamp, ns, and its number.
        latest_stamp = stamp - self._window
        latest_number = self._samples - WINDOW_SAMPLES + 1
        beyond: list[int] = []
        for sensor, part in enumerate(parts):
            first = self._within[sensor]
            if part > limit:
                self._within[sensor] = None
                beyond.append(sensor)
            elif first is None:
                self._within[sensor] = stamp, self._samples
            else:
                first_stamp, first_number = first
                if first_number <= latest_number and first_stamp <= latest_stamp:
                    self.latest[sensor] = stamp
        return tuple(beyond)

    def is_after(self, sensor: int, stamp: int) -> bool:
        """Whether a sensor was checked after a stamp, ns."""
        latest = self.latest[sensor]
        return latest is not None and latest > stamp


class Exposure:
    """
    Time since each sensor was last checked.

    A sensor is checked where its own part of the protection level has been within the alert limit
    for a window of consistent samples.

    Parameters
    ----------
    sensors : int
        Number N of mounted sensors.
    window : float
        The window, s.

    Attributes
    ----------
    hidden : tuple of int
        Sensors that the latest consistent sample could not check; all before the first, and after
        a pause.

    """

    def __init__(self, sensors: int, window: float) -> None:
        self._mounted = tuple(range(sensors))
        self._checks = CheckTimes(sensors, round(window * 1e9))
        # The same without the rivals from before a fault.
        self._checks_after_fault = CheckTimes(sensors, round(window * 1e9))
        # Stamp (ns) of the first consistent sample ever.
        self._first: int | None = None
        self.restart()

    def restart(self) -> None:
        """Begin again after a pause of the samples; what was checked stays that long ago."""
        # Stamp (ns) of the first consistent sample since the last pause.
        self._began: int | None = None
        self.hidden = self._mounted
        self.interrupt()

    def interrupt(self) -> None:
        """Begin the windows again: a sample was not consistent."""
        self._checks.interrupt()
        self._checks_after_fault.interrupt()

    def note_consistent(self, stamp: int, parts: list[float], limit: float) -> None:
        """
        Note which sensors a consistent sample checks.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        parts : list of float, length N
            Part of each sensor in the protection level, rad.
        limit : float
            Alert limit, rad.

        """
        if self._began is None:
            self._began = stamp
            if self._first is None:
                self._first = stamp
        self.hidden = self._checks.note_parts(stamp, parts, limit)

    def note_after_fault(self, stamp: int, parts: list[float], limit: float) -> None:
        """
        Note the parts (rad) of a consistent sample, without the rivals from before the fault.

        A fault ends when its suspects are as before it: a rival that was declared then does not
        count. `limit` is the alert limit, rad.
        """
        self._checks_after_fault.note_parts(stamp, parts, limit)

    def is_cleared(self, sensor: int, stamp: int) -> bool:
        """Whether the others found, after a stamp (ns), that a sensor is as before a fault."""
        return self._checks.is_after(sensor, stamp) or self._checks_after_fault.is_after(
            sensor, stamp
        )

    def times(self, stamp: int) -> tuple[float, ...]:
        """Return the seconds since each sensor was last checked, at a stamp, ns; inf before."""
        return tuple(
            [inf if last is None else (stamp - last) * 1e-9 for last in self._checks.latest]
        )

    def _running(self, stamp: int) -> float:
        """Return the time since the first consistent sample ever, s, at a stamp, ns; 0 before."""
        return 0.0 if self._first is None else (stamp - self._first) * 1e-9

    def _unchecked(self, stamp: int) -> list[float]:
        """Return how long each sensor has been unchecked, s: `_running` if it never was."""
        running = self._running(stamp)
        return [min(time, running) for time in self.times(stamp)]

    def overdue(
        self,
        stamp: int,
        limits: Limits,
        left_out: Collection[int],
    ) -> Symptom | None:
        """
        Return the sensor that has to be checked before an orientation may be published.

        With `start_checked` each sensor in use has to be checked once since the last pause, with
        `unchecked_limit` every so often. A pause does not restart that time.
        """
        began = self._began
        longest = limits.unchecked_limit or inf
        is_due = limits.start_checked or self._running(stamp) > longest
        if began is None or not is_due:
            return None
        for sensor, unchecked in enumerate(self._unchecked(stamp)):
            if sensor in left_out:
                continue
            if limits.start_checked and not self._checks.is_after(sensor, began):
                return withheld(Reason.NOT_CHECKED, 'start_checked', sensor)
            if unchecked > longest:
                detail = f'{unchecked:.0f} s, limit {longest:g}'
                return withheld(Reason.UNCHECKED, detail, sensor)
        return None

    def cautions(self, stamp: int) -> dict[str, str]:
        """Return which sensors are unchecked for more than `CAUTION`, by kind, in words."""
        cautions = {}
        for sensor, unchecked in enumerate(self._unchecked(stamp)):
            if unchecked > CAUTION:
                name = ALL_JOINT_NAMES[sensor]
                is_first = self._checks.latest[sensor] is None
                how_long = 'since the start' if is_first else f'for {unchecked:.0f} s'
                cautions[f'unchecked {name}'] = f'{name} unchecked {how_long}'
        return cautions
