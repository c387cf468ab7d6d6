# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Faults of simulated encoders: kind, joint, time and size, as given on the command line.

`Faults` knows which of them are present; their effect is in the simulated devices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import isfinite
import re
from typing import NamedTuple

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES


class Kind(NamedTuple):
    """A kind of fault or quirk: its effect, and the unit of VALUE; None for one without."""

    effect: str
    unit: str | None = None


# Kinds of faults of the encoders and their bus.
KINDS = {
    'dropout': Kind('the encoder does not answer'),
    'unplug': Kind('the encoder sends nothing, heartbeats included'),
    'late': Kind('each answer comes late; at the end all at once', unit='s'),
    'loss': Kind('answers are lost at random', unit='% of them'),
    'stuck': Kind('the encoder repeats its counts'),
    'offset': Kind('the encoder is off by a constant', unit='deg'),
    'jump': Kind('one answer, the first from START on, is off', unit='deg'),
    'noise': Kind('the encoder has noise on top of its own', unit='deg, 1 sigma'),
    'counter': Kind('the rolling counter stops, if the layout has one'),
    'emcy': Kind(
        'the encoder sends EMCY, and error reset at the end',
        unit='error code, such as 0x5000',
    ),
    'reboot': Kind('the node is off, then boots up into pre-operational'),
    'silence': Kind('no node sends anything'),
    'busoff': Kind('a bus-off error frame, silence, then a restarted error frame'),
}
# Kinds of faults of the drives, in the same way.
DRIVE_KINDS = {
    'drive': Kind(
        'the drive has a fault and sends EMCY',
        unit='error code, such as 0x2310',
    ),
    'drive_unplug': Kind('the drive neither sends nor hears anything'),
    'drive_deaf': Kind('the drive goes on where frames of the master stop'),
    'drive_torque': Kind('the torque that the drive reports is off', unit='% of it'),
}
# Kinds that affect the whole bus.
BUS_WIDE = ('silence', 'busoff')
# Kinds that a simulated source takes while it runs.
SWITCHED = ('stuck', 'offset', 'dropout')
# Values that a kind takes, in words; any finite number of the others.
RANGES: dict[str, tuple[Callable[[float], bool], str]] = {
    'noise': (lambda value: value >= 0.0, '0 or more'),
    'late': (lambda value: value > 0.0, 'above 0'),
    'loss': (lambda value: 0.0 < value <= 100.0, 'above 0, to 100'),
}
# Syntax of a fault, for help texts and errors.
SYNTAX = 'KIND[:JOINT]@START[+DURATION][=VALUE], times in s from the first answer'
_PATTERN = re.compile(
    r'(?P<kind>\w+)(:(?P<joint>\w+))?@(?P<start>[\d.]+)(\+(?P<duration>[\d.]+))?'
    r'(=(?P<value>\S+))?'
)


@dataclass(frozen=True, slots=True)
class Fault:
    """
    One fault of an encoder, a drive or the whole bus.

    Attributes
    ----------
    kind : str
        One of KINDS or DRIVE_KINDS.
    joint : int or None
        Index in ALL_JOINT_NAMES, the axes behind them; None for the whole bus.
    start, end : float
        Times of beginning and end, s from the first answer; an end of inf: it does not end.
    value : float
        Size or code in the unit of its kind; 0 for a kind without a value.
    text : str
        Its text on the command line.

    """

    kind: str
    joint: int | None
    start: float
    end: float
    value: float
    text: str

    def active(self, t: float) -> bool:
        """Return whether the fault is present at `t`, s from the first answer."""
        return self.start <= t < self.end


class Faults:
    """
    Faults over time.

    Parameters
    ----------
    faults : iterable of Fault
        All of them, whenever they begin.

    Attributes
    ----------
    present : list of Fault
        Those that have begun and have not ended at the latest `update`.

    """

    def __init__(self, faults: Iterable[Fault]):
        self._faults = tuple(faults)
        self._news: list[str] = []
        self.present: list[Fault] = []

    def update(self, t: float) -> list[tuple[Fault, bool]]:
        """
        Let time go on.

        Parameters
        ----------
        t : float
            Time, s from the first answer.

        Returns
        -------
        list of (Fault, bool)
            Faults that begin (True) or end (False) by that time.

        """
        changed = []
        for fault in self._faults:
            begins = fault not in self.present
            if fault.active(t) != begins:
                continue
            if begins:
                self.present.append(fault)
                change = 'begins'
            else:
                self.present.remove(fault)
                change = 'ends'
            self._news.append(f'{fault.text} {change}')
            changed.append((fault, begins))
        return changed

    def take_news(self) -> tuple[str, ...]:
        """Return, in words, which have begun or ended since the last call."""
        news = tuple(self._news)
        self._news = []
        return news


def parse_fault(
    text: str,
    sensors: int = len(JOINT_NAMES),
    axes: tuple[str, ...] = (),
) -> Fault:
    """
    Return the fault of a text of the command line.

    Without a duration it does not end.

    Parameters
    ----------
    text : str
        Such as 'offset:joint_3a@5+2=1.5'; see SYNTAX.
    sensors : int
        Number of encoders, which are those of the first joints.
    axes : tuple of str
        Names of further encoders, behind the joints.

    Raises
    ------
    InputError
        The text does not follow SYNTAX, or its value is out of the range of its kind.

    """
    found = _PATTERN.fullmatch(text)
    if not found:
        raise _wrong(text, f'; expected {SYNTAX}')
    joints = (*ALL_JOINT_NAMES[:sensors], *axes)
    kind = found['kind']
    joint = found['joint']
    unit = _unit(text, kind)
    if kind in BUS_WIDE and joint:
        raise _wrong(text, f': {kind} affects the whole bus; expected no joint')
    if kind not in BUS_WIDE and joint not in joints:
        raise _wrong(text, f": joint '{joint}'; expected one of {', '.join(joints)}")
    if (unit is None) != (found['value'] is None):
        expected = f'=VALUE ({unit})' if unit else f'no value with {kind}'
        raise _wrong(text, f'; expected {expected}')
    start, duration, number = _numbers(text, found)
    fits, words = RANGES.get(kind, (isfinite, ''))
    if not fits(number):
        raise _wrong(text, f': VALUE is {number:g}; expected {words} ({unit})')
    index = None
    if joint:
        index = joints.index(joint)
    return Fault(
        kind=kind,
        joint=index,
        start=start,
        end=start + duration,
        value=number,
        text=text,
    )


def _unit(text: str, kind: str) -> str | None:
    """Return the unit of a kind's value, None for a kind without one; refuse an unknown kind."""
    kinds = KINDS | DRIVE_KINDS
    if kind not in kinds:
        raise _wrong(text, f": kind '{kind}'; expected one of {', '.join(kinds)}")
    return kinds[kind].unit


def _numbers(text: str, found: re.Match[str]) -> tuple[float, float, float]:
    """Return start and duration, s, and value of a fault's text."""
    whole = found['kind'] in ('emcy', 'drive')
    try:
        start = float(found['start'])
        duration = float(found['duration'] or 'inf')
        value = found['value']
        if whole:
            number = float(int(value, 0) & 0xFFFF)
        else:
            number = float(value or 0.0)
    except ValueError as error:
        raise _wrong(text, f': not a number ({error})') from error
    if duration <= 0.0:
        raise _wrong(text, f': +{found["duration"]}; expected a duration above 0')
    _check_finite(text, 'START', start)
    _check_finite(text, 'VALUE', number)
    return start, duration, number


def _check_finite(
    text: str,
    what: str,
    size: float,
) -> None:
    """Raise InputError where a number of a fault's text is not finite."""
    if not isfinite(size):
        raise _wrong(text, f': {what} is {size:g}; expected a finite number')


def _wrong(text: str, what: str) -> InputError:
    """Return the error for a text, with what is wrong and what was expected."""
    return InputError(f"fault '{text}'{what}")


def parse_switched(text: str, sensors: int = len(JOINT_NAMES)) -> Fault:
    """
    Return a fault that begins now and does not end.

    Parameters
    ----------
    text : str
        KIND:JOINT or KIND:JOINT=VALUE with one of SWITCHED, such as 'offset:joint_1a=1.5'.
    sensors : int
        Number of encoders, which are those of the first joints.

    Raises
    ------
    InputError
        The text is not of this form.

    """
    name, equals, value = text.partition('=')
    kind = name.partition(':')[0]
    if kind not in SWITCHED or '@' in text:
        raise InputError(
            f"fault '{text}'; expected KIND:JOINT or offset:JOINT=DEG, KIND one of "
            f'{", ".join(SWITCHED)}'
        )
    switched = parse_fault(f'{name}@0{equals}{value}', sensors)
    return replace(switched, text=text)
