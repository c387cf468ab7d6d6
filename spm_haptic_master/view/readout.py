# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The figures and plots of one device, and when they are shown."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, nan

from spm_haptic_master.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.view import figures
from spm_haptic_master.view.panel import Panel
from spm_haptic_master.view.periodic import Periodic
from spm_haptic_master.view.sampled_topic import SampledTopic
from spm_haptic_master.view.status_entries import StatusEntries
from std_msgs.msg import Float64MultiArray

# Positions of the joints with the first four sensors in `joint_states`.
MEASURED = tuple(MECHANISM_JOINT_NAMES.index(name)
                 for name in ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a'))
# Period of figures and angles, and that of what comes once a second, where it does not come (s).
FIGURES_PERIOD, SLOW_PERIOD = 0.3, 1.5


class Readout:
    """
    What stands and is plotted on the panel of a device.

    Parameters
    ----------
    panel : Panel
        Panel of the device.
    entries : StatusEntries
        Entries of the device on /diagnostics.
    dexterity : SampledTopic
        Topic with the dexterity of three sensors, and of all.
    now : float
        Time, s.

    """

    def __init__(self, panel: Panel, entries: StatusEntries,
                 dexterity: SampledTopic[Float64MultiArray], now: float) -> None:
        self._panel, self._entries, self._dexterity_in = panel, entries, dexterity
        self._dexterity: tuple[float, ...] | None = None
        # Whether the figures of timing have come since they were plotted.
        self._timed = False
        # Whether the plot of the angles, and those of what is slow, go on from where they are.
        self._angles_unbroken = self._slow_unbroken = False
        self._figures, self._slow = Periodic(FIGURES_PERIOD), Periodic(SLOW_PERIOD)
        # Poses drawn since the figures were shown, and when that was (s).
        self._drawn, self._shown_at = 0, now

    def count_drawn(self) -> None:
        """Count a pose that is drawn."""
        self._drawn += 1

    def note_timing(self) -> None:
        """Note that the figures of timing have come."""
        self._timed = True

    def show(self, now: float, source: str, sensors: int, angles: Sequence[float] | None,
             orientation: Quaternion[float] | None) -> None:
        """
        Show what is due.

        Parameters
        ----------
        now : float
            Time, s.
        source : str
            Where the joint angles come from; empty where that is not known.
        sensors : int
            Number of sensors.
        angles : sequence of 9 float, optional
            Joint angles, rad; None of a device that is not alive.
        orientation : tuple of 4 float, optional
            Quaternion x, y, z, w of the platform; None of a device that is not alive.

        """
        if self._figures.is_due(now):
            if angles is not None:
                self._angles_unbroken = True
                missing = figures.missing_joints(self._entries, now)
                self._panel.angles.add(now, [
                    nan if MECHANISM_JOINT_NAMES[k] in missing else degrees(angles[k])
                    for k in MEASURED])
            self._panel.show_angles(now)
            self._show_figures(now, source, sensors, orientation)
        if self._timed or self._slow.is_due(now):
            self._slow.begin(now)
            self._add_slow(now, angles is not None)
            self._timed = False

    def break_off(self, now: float, watched: bool) -> None:
        """Break the plots where nothing is drawn: they must not join before and after."""
        if self._angles_unbroken:
            self._angles_unbroken = False
            self._panel.angles.add(now, None)
        if self._slow_unbroken and not watched:
            self._slow_unbroken = False
            self._panel.parity.add(now, None)
            self._panel.latency.add(now, None)

    def _show_figures(self, now: float, source: str, sensors: int,
                      orientation: Quaternion[float] | None) -> None:
        pace = self._drawn / max(now - self._shown_at, FIGURES_PERIOD)
        self._drawn, self._shown_at = 0, now
        rows = figures.of_encoders(source, self._entries, now)
        if orientation is not None:
            rows |= figures.of_orientation(orientation, self._entries, now)
            dexterity = self._dexterity_in.take()
            if dexterity is not None:
                numbers = dexterity.data
                self._dexterity = tuple(numbers) if len(numbers) == 2 else None
            if self._dexterity is not None:
                rows |= figures.of_singularity(self._dexterity, sensors, self._entries, now)
        rows |= figures.of_timing(self._entries, now)
        self._panel.show_figures(rows | {'picture': f'{pace:.0f} poses a second'})

    def _add_slow(self, now: float, alive: bool) -> None:
        """Continue the plots of what comes once a second; with a gap where it did not come."""
        values = self._entries.numbers('fkm: orientation', now)
        timing = self._entries.numbers('fkm: timing', now)
        self._slow_unbroken = True
        self._panel.parity.add(
            now, [values.get('parity (sigma)', nan), values.get('protection level (deg)', nan)]
            if alive and self._timed else None)
        self._panel.latency.add(
            now, [timing.get('latency p50 (us)', nan), timing.get('latency p99 (us)', nan)]
            if self._timed else None)
        self._panel.show_slow(now)
