# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the page shows of one device: sentence, chips, figures and a sample of its plots."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import degrees, isfinite, nan
from typing import Any

from spm_haptic_master.kinematics import joints, zxz_angles
from spm_haptic_master.ros.diagnostic_status import CAUTION_KEY, CHECKSUM_KEY
from spm_haptic_master.view.names import SENSOR_NAMES, with_sensor_names
from spm_haptic_master.view.plots import Limits, plots
from spm_haptic_master.view.seen import Seen
from spm_haptic_master.view.sentence import DASH, Sentence, sentence
from spm_haptic_master.view.status import Light, SensorState
from spm_haptic_master.view.status_entries import (
    EncoderDevice,
    ENCODERS,
    ORIENTATION,
    SINGULARITY,
    StatusEntries,
    TIMING,
)

# Dexterity of three sensors at which the bar is full (unit 1).
FULL_DEXTERITY = 0.2
# Share above which further motion improves a calibration little.
ENOUGH = 0.9
# Unit of an encoder that is in no set, and factor of its position for that.
FURTHER_UNITS = {'insertion': ('mm', 1000.0), 'gripper': ('\u00b0', degrees(1.0))}


@dataclass(frozen=True, slots=True)
class Row:
    """
    A figure: its name, its text, and share and colour of a bar, if it has one.

    Attributes
    ----------
    name : str
        Name of the quantity.
    text : str
        Value in words and digits, with its unit; a dash if it is not known.
    share : float or None
        Length of the bar, 1 if it is full: the page limits it to 0 .. 1. None: no bar.
    colour : str
        Colour of the bar in CSS; empty without one.

    """

    name: str
    text: str
    share: float | None = None
    colour: str = ''


@dataclass(frozen=True, slots=True)
class Chip:
    """
    The state of an encoder.

    Attributes
    ----------
    text : str
        Name of the encoder and the sign of its state, or the position of one that is in no set.
    title : str
        Words that a browser shows while the mouse is on the chip.
    colour : str
        Colour of the state in CSS.

    """

    text: str
    title: str
    colour: str


@dataclass(frozen=True, slots=True)
class Figures:
    """
    The numbers of a device, nan where they are not known; angles in deg.

    They are what the rows and the plots have in common.

    Attributes
    ----------
    warn_below, error_below : float
        Limits of the dexterity, as the node `diagnostics` has them (unit 1).
    level : float
        Protection level of the orientation, deg.
    parity : float
        Disagreement of the encoders, standard deviations.
    ghost : float
        Error of three encoders alone, deg.
    rate : float
        Rate of the orientations, Hz.
    p50, p99 : float
        Percentiles of the latency from a sample's stamp to its publication, us.

    """

    warn_below: float  # dexterity
    error_below: float
    level: float
    parity: float
    ghost: float
    rate: float  # Hz
    p50: float  # us
    p99: float


def content(
    seen: Seen,
    entries: StatusEntries,
) -> dict[str, Any]:
    """
    Return what the page shows of a device with its present entries on /diagnostics.

    Parameters
    ----------
    seen : Seen
        What is known of the device.
    entries : StatusEntries
        Its entries on /diagnostics; those older than a few seconds count as missing.

    Returns
    -------
    dict
        Sentence, chips, rows, calibration, plots and one sample of the plots, ready for JSON.

    """
    seen = seen.present()
    figures = _figures(seen, entries)
    limits = Limits(figures.warn_below, figures.error_below, seen.settings.alert_limit)
    return {
        'note': _note(seen, figures.warn_below),
        'chips': [asdict(chip) for chip in _chips(seen)],
        'rows': [asdict(row) for row in _rows(seen, figures, entries)],
        'calibration': _calibration(seen),
        'plots': [asdict(plot) for plot in plots(seen.settings.sensors, limits)],
        'sample': _sample(seen, figures, entries),
    }


def _figures(seen: Seen, entries: StatusEntries) -> Figures:
    """Return the numbers of a device and of its entries."""
    limits = entries.numbers(SINGULARITY)
    timing = entries.numbers(TIMING)
    if seen.orientation is None:
        of_pose = {}
    else:
        of_pose = entries.numbers(ORIENTATION)
    return Figures(
        warn_below=limits.get('warn below', nan),
        error_below=limits.get('error below', nan),
        level=of_pose.get('protection level (deg)', nan),
        parity=of_pose.get('parity (sigma)', nan),
        ghost=nan if seen.ghost is None else degrees(seen.ghost),
        rate=timing.get('orientation rate (Hz)', nan),
        p50=timing.get('latency p50 (us)', nan),
        p99=timing.get('latency p99 (us)', nan),
    )


def _note(
    seen: Seen,
    warn_below: float,
) -> dict[str, Any]:
    """Return the sentence, or that of the story which is played, with its progress."""
    if seen.story is None:
        return {'story': None, **asdict(sentence(seen, warn_below))}
    return {'story': asdict(seen.story), **asdict(Sentence(seen.story.words, False))}


def _chips(seen: Seen) -> list[Chip]:
    """Return the chips of the encoders: name, sign and words of each state."""
    chips = [
        Chip(
            text=f'{sensor} {state.sign}',
            title=f'{sensor} ({joint}): {state.words}',
            colour=state.colour,
        )
        for sensor, joint, state in zip(
            SENSOR_NAMES,
            joints.ALL_JOINT_NAMES,
            seen.states,
            strict=False,
        )
    ]
    for name, position in seen.further.items():
        unit, factor = FURTHER_UNITS[name]
        state = SensorState.MISSING if position is None else SensorState.HEALTHY
        figure = state.sign if position is None else f'{factor * position:.1f} {unit}'
        chips.append(
            Chip(
                text=f'{name} {figure}',
                title=f'{name}: {state.words}',
                colour=state.colour,
            )
        )
    return chips


def _rows(
    seen: Seen,
    figures: Figures,
    entries: StatusEntries,
) -> list[Row]:
    """Return the figures: always the same rows for the same sensors."""
    return [
        *_rows_of_pose(seen, figures, entries),
        *_rows_of_clients(seen, entries),
        *_rows_of_encoders(seen, entries),
        *_rows_of_calibration(seen, entries),
        Row('rate', _known(f'{figures.rate:.0f} Hz', figures.rate)),
        Row(
            'latency',
            _known(f'p50 {figures.p50:.0f} us, p99 {figures.p99:.0f} us', figures.p50),
        ),
        Row('picture', f'{seen.pace:.0f} poses a second'),
    ]


def _rows_of_pose(
    seen: Seen,
    figures: Figures,
    entries: StatusEntries,
) -> list[Row]:
    """Return the figures of the orientation and of its limits."""
    angles = () if seen.orientation is None else zxz_angles(*seen.orientation)
    zxz = ', '.join(
        f'{name} {degrees(angle):.2f}\u00b0'
        for name, angle in zip('\u03c8\u03b8\u03c6', angles, strict=False)
    )
    if seen.orientation is None:
        singularity = None
    else:
        singularity = entries.entry(SINGULARITY)
    limit = seen.settings.alert_limit
    allowed = f' of {limit:g}\u00b0 allowed' if isfinite(limit) else ''
    three, every = seen.dexterities or (nan, nan)
    sensors = seen.settings.sensors
    return [
        Row('orientation', zxz or DASH),
        Row('three encoders', _known(f'{figures.ghost:.2f}\u00b0 off', figures.ghost)),
        Row('protection level', _known(f'{figures.level:.2f}\u00b0{allowed}', figures.level)),
        Row('parity', _known(f'{figures.parity:.1f} sigma', figures.parity)),
        Row('singularity', DASH if singularity is None else singularity.message),
        _dexterity(f'dexterity of {joints.FEWEST_USED}', three, figures),
        _dexterity(f'dexterity of {sensors}', every, figures),
    ]


def _rows_of_clients(seen: Seen, entries: StatusEntries) -> list[Row]:
    """Return what follows the device: slave, CRTK, force; and what fkm cautions of."""
    commanded, rendered = seen.torques
    torque = f'{commanded:.2f} N m, rendered {rendered:.2f} N m'
    caution = entries.texts(ORIENTATION).get(CAUTION_KEY)
    return [
        Row('slave', with_sensor_names(seen.teleop) or DASH),
        Row('CRTK state', seen.crtk or DASH),
        Row('force', seen.force or DASH),
        Row('torque', _known(torque, commanded)),
        Row('caution', with_sensor_names(caution or DASH)),
    ]


def _rows_of_encoders(seen: Seen, entries: StatusEntries) -> list[Row]:
    """Return the source, and each encoder's angle as it was read, with its age."""
    driver = entries.entry(ENCODERS)
    count = seen.settings.sensors
    readings = [*seen.readings, *[nan] * count][:count]
    ages = [*seen.ages, *[nan] * count][:count]
    rows = [
        Row('source', seen.source or 'unknown'),
        Row('encoders', DASH if driver is None else with_sensor_names(driver.message)),
    ]
    devices = entries.encoders()
    names = zip(
        SENSOR_NAMES,
        joints.ALL_JOINT_NAMES,
        readings,
        ages,
        strict=False,
    )
    for name, joint, angle, age in names:
        text = _known(f'{degrees(angle):.3f}\u00b0, {age:.1f} s ago', age)
        rows.append(Row(f'{name} read', text))
        rows.append(Row(f'{name} device', _device(devices.get(joint))))
    return rows


def _device(device: EncoderDevice | None) -> str:
    """Return counts and serial number of an encoder in words; a dash without its driver."""
    if device is None:
        return DASH
    if device.counts is None:
        return 'this source has neither counts nor serials'
    serial = 'no serial on this bus' if device.serial is None else f'serial {device.serial}'
    return f'counts {device.counts}, {serial}'


def _rows_of_calibration(seen: Seen, entries: StatusEntries) -> list[Row]:
    """Return which calibration and mechanism run, and the alert limit."""
    limit = seen.settings.alert_limit
    return [
        Row('calibration', seen.settings.calibration or DASH),
        Row('mechanism', entries.texts(ORIENTATION).get(CHECKSUM_KEY, DASH)),
        Row('alert limit', _known(f'{limit:g}\u00b0', limit)),
    ]


def _dexterity(
    name: str,
    value: float,
    figures: Figures,
) -> Row:
    """Return the row of a dexterity with its bar."""
    light = light_of(value, figures.warn_below, figures.error_below)
    text = _known(f'{value:.3f} {light.sign}', value)
    return Row(
        name=name,
        text=text,
        share=0.0 if value != value else value / FULL_DEXTERITY,
        colour=light.colour,
    )


def light_of(
    dexterity: float,
    warn_below: float,
    error_below: float,
) -> Light:
    """
    Return the state of a dexterity, grey without a limit.

    Parameters
    ----------
    dexterity : float
        A dexterity (unit 1); nan: not known.
    warn_below, error_below : float
        Limits of the dexterity (unit 1); nan: not known.

    Returns
    -------
    Light
        Red below the lower limit, amber between them, green above; grey if the
        dexterity or `warn_below` is not known.

    """
    if dexterity != dexterity or warn_below != warn_below:
        return Light.GREY
    if dexterity < error_below:
        return Light.RED
    return Light.AMBER if dexterity < warn_below else Light.GREEN


def _calibration(seen: Seen) -> dict[str, Any] | None:
    """Return what to do next in a calibration, and how far it is."""
    if seen.calibration is None:
        return None
    covered = [
        (name, share, (Light.GREEN if share >= ENOUGH else Light.AMBER).colour)
        for name, share in seen.calibration.shares.items()
    ]
    return {'text': seen.calibration.text, 'covered': covered}


def _sample(
    seen: Seen,
    figures: Figures,
    entries: StatusEntries,
) -> dict[str, Any]:
    """Return one sample of the plots, by their keys, with what has happened."""
    three, every = seen.dexterities or (nan, nan)
    return {
        't': entries.now,
        'state': seen.banner.event,
        'light': seen.banner.light.name,
        'happened': list(seen.happened),
        'values': {
            'dexterity': [three, every],
            'ghost': [figures.ghost],
            'level': [figures.level],
            'parity': [figures.parity],
            'angles': _angles(seen, entries),
            'torque': list(seen.torques),
            'latency': [figures.p50, figures.p99],
        },
    }


def _angles(seen: Seen, entries: StatusEntries) -> list[float]:
    """Return the angles of the joints with encoders, deg; a joint without a reading has a gap."""
    names = joints.ALL_JOINT_NAMES[: seen.settings.sensors]
    if seen.angles is None:
        return [nan] * len(names)
    by_name = dict(zip(joints.MECHANISM_JOINT_NAMES, seen.angles, strict=True))
    missing = entries.missing_joints()
    return [nan if name in missing else degrees(by_name[name]) for name in names]


def _known(text: str, value: float) -> str:
    """
    Return the text of a value, a dash of nan.

    Parameters
    ----------
    text : str
        The value in words.
    value : float
        The value itself, in any unit.

    Returns
    -------
    str
        The text, or a dash in its place.

    """
    return DASH if value != value else text
