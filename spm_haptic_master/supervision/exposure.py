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


class Sight:
    """
    When each sensor was last within a limit for a window of consistent samples.

    Where samples come slowly the window is longer: it has `WINDOW_SAMPLES`, as that of the parity.

    Parameters
    ----------
    sensors : int
        Number N of mounted sensors.
    window : int
        Least time without interruption after which it counts, ns.

    Attributes
    ----------
    last : list of int or None, length N
        Stamp of the latest sample at which it was so, ns; None before the first.

    """

    def __init__(self, sensors: int, window: int) -> None:
        self._window = window
        self._sensors = sensors
        self.last: list[int | None] = [None] * sensors
        # Number of consistent samples so far.
        self._samples = 0
        self.interrupt()

    def interrupt(self) -> None:
        """Begin the windows again: a sample was not consistent."""
        # Stamp (ns) and number of the first consistent sample since which each is so.
        self._visible: list[tuple[int, int] | None] = [None] * self._sensors

    def note_parts(
        self,
        stamp: int,
        parts: list[float],
        limit: float,
    ) -> tuple[int, ...]:
        """Note the parts of a consistent sample, rad; return the sensors beyond the limit."""
        visible = self._visible
        self._samples += 1
        # Of a window that ends with this sample: its latest beginning, ns, and first sample.
        latest = stamp - self._window
        first_sample = self._samples - WINDOW_SAMPLES + 1
        hidden: list[int] = []
        for sensor, part in enumerate(parts):
            first = visible[sensor]
            if part > limit:
                visible[sensor] = None
                hidden.append(sensor)
            elif first is None:
                visible[sensor] = stamp, self._samples
            else:
                began, number = first
                if number <= first_sample and began <= latest:
                    self.last[sensor] = stamp
        return tuple(hidden)

    def since(self, sensor: int, stamp: int) -> bool:
        """Whether a sensor was within the limit for a window after a stamp, ns."""
        last = self.last[sensor]
        return last is not None and last > stamp


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
    all : tuple of int
        Every mounted sensor.
    hidden : tuple of int
        Sensors that the latest consistent sample could not check; all before the first, and after
        a pause.

    """

    def __init__(self, sensors: int, window: float) -> None:
        self.all = tuple(range(sensors))
        self._checks = Sight(sensors, round(window * 1e9))
        # The same without the rivals from before a fault.
        self._sights = Sight(sensors, round(window * 1e9))
        # Stamp (ns) of the first consistent sample of all.
        self._first: int | None = None
        self.restart()

    def restart(self) -> None:
        """Begin again after a pause of the samples; what was checked stays that long ago."""
        # Stamp (ns) of the first consistent sample since.
        self._began: int | None = None
        self.hidden: tuple[int, ...] = self.all
        self.interrupt()

    def interrupt(self) -> None:
        """Begin the windows again: a sample was not consistent."""
        self._checks.interrupt()
        self._sights.interrupt()

    def note_consistent(
        self,
        stamp: int,
        parts: list[float],
        limit: float,
        level: float,
    ) -> float:
        """
        Note which sensors a consistent sample checks; return its protection level.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        parts : list of float, length N
            Part of each sensor in the protection level, rad.
        limit : float
            Alert limit, rad.
        level : float
            What noise and bias of healthy sensors do, rad.

        Returns
        -------
        float
            Largest part within the alert limit, and at least `level`, rad. What is beyond the
            limit is unchecked, and not in it.

        """
        if self._began is None:
            self._began = stamp
            if self._first is None:
                self._first = stamp
        self.hidden = self._checks.note_parts(stamp, parts, limit)
        for part in parts:
            if level < part <= limit:
                level = part
        return level

    def note_after_fault(
        self,
        stamp: int,
        parts: list[float],
        limit: float,
    ) -> None:
        """
        Note the parts (rad) of a consistent sample, without the rivals from before the fault.

        A fault ends when its suspects are as before it: a rival that was declared then does not
        count.
        """
        self._sights.note_parts(stamp, parts, limit)

    def has_seen(self, sensor: int, stamp: int) -> bool:
        """Whether the others have seen, after a stamp (ns), that a sensor is as before a fault."""
        return self._checks.since(sensor, stamp) or self._sights.since(sensor, stamp)

    def times(self, stamp: int) -> tuple[float, ...]:
        """Return the seconds since each sensor was last checked, at a stamp, ns; inf before."""
        return tuple(inf if last is None else (stamp - last) * 1e-9 for last in self._checks.last)

    def overdue(
        self,
        stamp: int,
        limits: Limits,
        left_out: Collection[int],
    ) -> Symptom | None:
        """
        Return the sensor that has to be checked before an orientation may be published.

        With `start_checked` each sensor in use has to be checked once since the last pause, with
        `unchecked_limit` every so often. The time counts from the first consistent sample of all,
        so that a pause does not restart it.
        """
        began = self._began
        if self._first is None or began is None:
            return None
        running = (stamp - self._first) * 1e-9
        if not limits.start_checked and running <= (limits.unchecked_limit or inf):
            return None
        for sensor, time in enumerate(self.times(stamp)):
            unchecked = min(time, running)
            symptom = self._overdue_sensor(sensor, unchecked, began, limits)
            if symptom is not None and sensor not in left_out:
                return symptom
        return None

    def _overdue_sensor(
        self,
        sensor: int,
        unchecked: float,
        began: int,
        limits: Limits,
    ) -> Symptom | None:
        """
        Return why a sensor has to be checked first, which has been unchecked for a time, s.

        `began` is the stamp of the first consistent sample since the last pause, ns.
        """
        if limits.start_checked and not self._checks.since(sensor, began):
            return withheld(Reason.NOT_CHECKED, 'start_checked', sensor)
        longest = limits.unchecked_limit or inf
        if unchecked > longest:
            detail = f'{unchecked:.0f} s, limit {longest:g}'
            return withheld(Reason.UNCHECKED, detail, sensor)
        return None

    def cautions(self, stamp: int) -> dict[str, str]:
        """Return which sensors are unchecked for more than `CAUTION`, by kind, in words."""
        first = stamp if self._first is None else self._first
        return {
            f'unchecked {name}': f'{name} unchecked '
            + ('since the start' if time == inf else f'for {time:.0f} s')
            for name, time in zip(ALL_JOINT_NAMES, self.times(stamp), strict=False)
            if min(time, (stamp - first) * 1e-9) > CAUTION
        }
