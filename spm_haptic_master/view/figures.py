# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The table of figures of a device, as HTML by name."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from math import degrees

from diagnostic_msgs.msg import DiagnosticStatus
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import zxz_angles
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.ros.diagnostic_status import CAUTION_KEY, MISSING_KEY
from spm_haptic_master.view.liveness import Light
from spm_haptic_master.view.panel import bar
from spm_haptic_master.view.status_entries import StatusEntries

# Colours of the bar of the dexterity, by the level of the singularity.
LEVELS = {DiagnosticStatus.OK: Light.GREEN, DiagnosticStatus.WARN: Light.AMBER,
          DiagnosticStatus.ERROR: Light.RED}
# Dexterity at which the bar is full (unit 1).
FULL_DEXTERITY = 0.2


def of_encoders(source: str, entries: StatusEntries, now: float) -> dict[str, str]:
    """
    Return the rows that hold of a silent device, too.

    Parameters
    ----------
    source : str
        Where the joint angles come from; empty where that is not known.
    entries : StatusEntries
        Entries of the device on /diagnostics.
    now : float
        Time, s.

    """
    rows = {'source': _text(source) or 'unknown'}
    entry = entries.entry('encoder_driver: encoders', now)
    if entry is not None:
        rows['encoders'] = _text(entry.message)
    rows |= dict.fromkeys(missing_joints(entries, now), '&ndash;')
    caution = entries.text('fkm: orientation', CAUTION_KEY, now)
    if caution:
        rows['caution'] = _text(caution)
    return rows


def missing_joints(entries: StatusEntries, now: float) -> list[str]:
    """Return the joints of which the driver has no reading; arguments of `of_encoders`."""
    names = entries.text('encoder_driver: encoders', MISSING_KEY, now).split(', ')
    return [name for name in ALL_JOINT_NAMES if name in names]


def of_orientation(orientation: Quaternion[float], entries: StatusEntries,
                   now: float) -> dict[str, str]:
    """
    Return the rows of an orientation: its angles, protection level and parity.

    Parameters
    ----------
    orientation : tuple of 4 float
        Quaternion x, y, z, w.
    entries, now
        As of `of_encoders`.

    """
    psi, theta, phi = map(degrees, zxz_angles(*orientation))
    rows = {'orientation': f'&psi; {psi:.2f}&deg;, &theta; {theta:.2f}&deg;, '
                           f'&phi; {phi:.2f}&deg;'}
    values = entries.numbers('fkm: orientation', now)
    if 'protection level (deg)' in values:
        rows['protection level'] = f'{values["protection level (deg)"]:.2f}&deg;'
    if 'parity (sigma)' in values:
        rows['parity'] = f'{values["parity (sigma)"]:.1f} sigma'
    return rows


def of_singularity(dexterities: Sequence[float], sensors: int, entries: StatusEntries,
                   now: float) -> dict[str, str]:
    """
    Return the rows on the nearness of a singularity.

    Parameters
    ----------
    dexterities : sequence of 2 float
        Dexterity of three sensors, and of all (0 .. 1).
    sensors : int
        Number of sensors.
    entries, now
        As of `of_encoders`.

    """
    three, every = dexterities
    entry = entries.entry('diagnostics: singularity', now)
    light = LEVELS.get(entry.level, Light.GREY) if entry is not None else Light.GREY
    text = '' if entry is None else _text(entry.message)
    return {'singularity': f'{text}{bar(three / FULL_DEXTERITY, light.value)}',
            'dexterity': f'{three:.3f} (3 sensors), {every:.3f} ({sensors} sensors)'}


def of_timing(entries: StatusEntries, now: float) -> dict[str, str]:
    """Return the rows of rate and latency; parameters as of `of_encoders`."""
    rows, timing = {}, entries.numbers('fkm: timing', now)
    if 'orientation rate (Hz)' in timing:
        rows['rate'] = f'{timing["orientation rate (Hz)"]:.0f} Hz'
    if 'latency p50 (us)' in timing:
        rows['latency'] = (f'p50 {timing["latency p50 (us)"]:.0f} us, '
                           f'p99 {timing["latency p99 (us)"]:.0f} us')
    return rows


def _text(text: str) -> str:
    return escape(text, quote=False)
