# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The figures, plots and events of one device, as the page has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import degrees, nan
from typing import Any

from spm_haptic_master.description.colours import LEGS
from spm_haptic_master.joints import (
    ALL_JOINT_NAMES,
    MECHANISM_JOINT_NAMES,
    NUMBER_WORDS,
    SHORT_NAMES,
)
from spm_haptic_master.kinematics import zxz_angles
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.ros.diagnostic_status import CAUTION_KEY
from spm_haptic_master.view.liveness import Banner, Light
from spm_haptic_master.view.sensor_states import missing_joints, SensorState
from spm_haptic_master.view.status_entries import StatusEntries

# What has no value.
DASH = '\u2013'
# Dexterity at which its bar is full (unit 1).
FULL_DEXTERITY = 0.2
# Colours of three encoders alone, of all, and of limits.
GHOST, ALL, LIMIT = '#b0379b', '#2b6cb0', '#b42318'
# Error of three encoders clear of the singularity that noise does not explain (deg).
WRONG_SIDE = 3.0
# Share above which a motion of a calibration has little left to give.
ENOUGH = 0.9


@dataclass(slots=True)
class Seen:
    """
    What is known of a device.

    Attributes
    ----------
    banner : Banner
        Its banner.
    sensors : int
        Number of sensors.
    states : list of SensorState
        State of each.
    source, force : str
        Where the joint angles come from, and the state of the force feedback; empty: not known.
    alert_limit : float
        Largest protection level of a published orientation, deg.
    angles : sequence of 9 float or None
        Joint angles, rad; None of a device that is not alive, as of the next two.
    orientation : quaternion x, y, z, w or None
        Of the platform in the base frame.
    ghost : float or None
        Error of three encoders alone, rad.
    dexterities : sequence of 2 float or None
        Dexterity of three encoders, and of all (0 .. 1).
    pace : float
        Poses drawn per second.
    story : str
        What the simulation plays, in words; empty: nothing.
    happened : list of str
        Events since the last time.
    calibration : tuple of str and dict, or None
        What to do next, and shares 0 .. 1 of what is needed.

    """

    banner: Banner
    sensors: int
    states: list[SensorState]
    source: str = ''
    force: str = ''
    alert_limit: float = nan
    angles: Sequence[float] | None = None
    orientation: Quaternion[float] | None = None
    ghost: float | None = None
    dexterities: Sequence[float] | None = None
    pace: float = 0.0
    story: str = ''
    happened: list[str] = field(default_factory=list)
    calibration: tuple[str, dict[str, float]] | None = None


def content(seen: Seen, entries: StatusEntries, now: float) -> dict[str, Any]:
    """
    Return what the page shows of a device.

    Parameters
    ----------
    seen : Seen
        What is known of it.
    entries : StatusEntries
        Its entries on /diagnostics.
    now : float
        Time, s.

    """
    limits = entries.numbers('diagnostics: singularity', now)
    warn, error = limits.get('warn below', nan), limits.get('error below', nan)
    three, every = seen.dexterities or (nan, nan)
    note, warns = _note(seen, three, every, warn)
    orientation = entries.numbers('fkm: orientation', now)
    timing = entries.numbers('fkm: timing', now)
    level, parity = orientation.get('protection level (deg)'), orientation.get('parity (sigma)')
    ghost = nan if seen.ghost is None else degrees(seen.ghost)
    if seen.angles is None:
        level = parity = None
    quantiles = [timing.get(f'latency {each} (us)', nan) for each in ('p50', 'p99')]
    return {
        'note': seen.story or note, 'warns': warns and not seen.story,
        'rows': _rows(seen, entries, now, ghost, level, parity),
        'chips': [(SHORT_NAMES[k], f'{ALL_JOINT_NAMES[k]}: {state.value.words}',
                   state.value.colour) for k, state in enumerate(seen.states)],
        'calibration': _calibration(seen),
        'plots': [
            _plot('dexterity', 'dexterity', [('3 encoders', GHOST),
                                             (f'{seen.sensors} encoders', ALL)],
                  [(warn, Light.AMBER.value), (error, LIMIT)]),
            _plot('ghost', 'three encoders alone: error, deg', [('error', GHOST)]),
            _plot('level', 'protection level, deg', [('level', ALL)],
                  [(seen.alert_limit, LIMIT)]),
            _plot('angles', 'joint angles, deg', [
                (name, LEGS['ABC'.index(name[1])], name[0] == '3')
                for name in SHORT_NAMES[:seen.sensors]], zero=False),
            _plot('parity', 'parity, sigma', [('parity', ALL)], zero=False),
            _plot('latency', 'latency, us', [('p50', ALL), ('p99', GHOST)])],
        'sample': {
            't': now, 'state': seen.banner.text, 'colour': seen.banner.light.value,
            'happened': seen.happened, 'values': {
                'dexterity': [three, every], 'ghost': [ghost],
                'level': [nan if level is None else level],
                'parity': [nan if parity is None else parity],
                'angles': _angles(seen, entries, now), 'latency': quantiles}}}


def _plot(key: str, title: str, series: Sequence[Sequence[Any]],
          limits: Sequence[tuple[float, str]] = (), zero: bool = True) -> dict[str, Any]:
    """Return a plot: name, colour and whether dashed of each quantity; limits with colours."""
    return {'key': key, 'title': title, 'series': series, 'zero': zero,
            'limits': [each for each in limits if each[0] == each[0]]}


def _angles(seen: Seen, entries: StatusEntries, now: float) -> list[float]:
    """Return the angles that have a reading, deg; the others nan."""
    missing = missing_joints(entries, now)
    return [nan if seen.angles is None or name in missing
            else degrees(seen.angles[MECHANISM_JOINT_NAMES.index(name)])
            for name in ALL_JOINT_NAMES[:seen.sensors]]


def _note(seen: Seen, three: float, every: float, warn: float) -> tuple[str, bool]:
    """Return which encoders determine the pose, in a sentence, and whether that is a warning."""
    if seen.orientation is None:
        return 'No orientation: the picture is not the present pose.', True
    if three != three or warn != warn:
        return DASH, False
    lost = sum(state in (SensorState.MISSING, SensorState.EXCLUDED) for state in seen.states)
    number = NUMBER_WORDS.get(seen.sensors - lost, 'the')
    if min(three, every) >= warn and seen.ghost is not None and degrees(seen.ghost) > WRONG_SIDE:
        return ('Three encoders alone came out of the singularity on its wrong side. With '
                f'{number} the device did not.', True)
    if min(three, every) >= warn:
        return (f'Three encoders determine this pose. With {number} they check one another.',
                False)
    if every < warn:
        return f'Not even {number} encoders determine this pose.', True
    return (f'Singularity: three encoders do not determine this pose; {number} do. The violet '
            'ghost is what three alone would report.', True)


def _rows(seen: Seen, entries: StatusEntries, now: float, ghost: float, level: float | None,
          parity: float | None) -> list[tuple[Any, ...]]:
    """Return name, text, and share and colour of a bar, if any: the same rows at any time."""
    driver = entries.entry('encoder_driver: encoders', now)
    near = entries.entry('diagnostics: singularity', now)
    timing = entries.numbers('fkm: timing', now)
    limits = entries.numbers('diagnostics: singularity', now)
    alive = seen.orientation is not None
    angles = map(degrees, zxz_angles(*seen.orientation)) if seen.orientation is not None else ()
    rate, p50, p99 = (timing.get(key) for key in (
        'orientation rate (Hz)', 'latency p50 (us)', 'latency p99 (us)'))
    return [
        ('source', seen.source or 'unknown'),
        ('encoders', DASH if driver is None else driver.message),
        ('orientation', ', '.join(f'{name} {angle:.2f}\u00b0' for name, angle in zip(
            '\u03c8\u03b8\u03c6', angles, strict=False)) or DASH),
        ('three encoders', f'{ghost:.2f}\u00b0 off' if ghost == ghost else DASH),
        ('protection level', DASH if level is None else f'{level:.2f}\u00b0'),
        ('parity', DASH if parity is None else f'{parity:.1f} sigma'),
        ('singularity', DASH if near is None or not alive else near.message),
        *((f'dexterity of {count}', DASH, 0.0, Light.GREY.value) if seen.dexterities is None else
          (f'dexterity of {count}', f'{seen.dexterities[k]:.3f}',
           seen.dexterities[k] / FULL_DEXTERITY, _light(seen.dexterities[k], limits).value)
          for k, count in enumerate((3, seen.sensors))),
        ('rate', DASH if rate is None else f'{rate:.0f} Hz'),
        ('latency', DASH if p50 is None or p99 is None
         else f'p50 {p50:.0f} us, p99 {p99:.0f} us'),
        ('force', seen.force or DASH),
        ('caution', entries.text('fkm: orientation', CAUTION_KEY, now) or DASH),
        ('picture', f'{seen.pace:.0f} poses a second')]


def _light(dexterity: float, limits: dict[str, float]) -> Light:
    """Return the colour of a dexterity, grey without its limits."""
    if not limits:
        return Light.GREY
    if dexterity < limits.get('error below', nan):
        return Light.RED
    return Light.AMBER if dexterity < limits.get('warn below', nan) else Light.GREEN


def _calibration(seen: Seen) -> dict[str, Any] | None:
    if seen.calibration is None:
        return None
    text, covered = seen.calibration
    return {'text': text, 'covered': [
        (name, share, (Light.GREEN if share >= ENOUGH else Light.AMBER).value)
        for name, share in covered.items()]}
