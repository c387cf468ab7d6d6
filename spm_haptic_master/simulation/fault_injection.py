# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of simulated encoders: kind, joint, time and size, as given on the command line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
import re

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES

# Kinds of faults: the effect, and the meaning of VALUE, or None for a kind without one.
KINDS = {
    'dropout': ('the encoder does not answer', None),
    'unplug': ('the encoder sends nothing, heartbeats included', None),
    'late': ('each answer comes late; at the end all at once', 's'),
    'loss': ('answers are lost at random', '% of them'),
    'stuck': ('the encoder repeats its counts', None),
    'offset': ('the encoder is off by a constant', 'deg'),
    'jump': ('one answer, the first from START on, is off', 'deg'),
    'noise': ('the encoder has noise on top of its own', 'deg, 1 sigma'),
    'counter': ('the rolling counter stops, if the layout has one', None),
    'emcy': ('the encoder sends EMCY, and error reset at the end', 'error code, such as 0x5000'),
    'reboot': ('the node is off, then boots up into pre-operational', None),
    'silence': ('no node sends anything', None),
    'busoff': ('a bus-off error frame, silence, then a restarted error frame', None),
}
# Kinds of faults of the drives, in the same way.
DRIVE_KINDS = {
    'drive': ('the drive has a fault and sends EMCY', 'error code, such as 0x2310'),
    'drive_unplug': ('the drive neither sends nor hears anything', None),
    'drive_deaf': ('the drive goes on where frames of the master stop', None),
    'drive_torque': ('the torque that the drive reports is off', '% of it'),
}
# Kinds that affect the whole bus.
BUS_WIDE = ('silence', 'busoff')
# Kinds that a simulated source takes while it runs.
SWITCHED = ('stuck', 'offset', 'dropout')
# Syntax of a fault, for help texts and errors.
SYNTAX = 'KIND[:JOINT]@START[+DURATION][=VALUE], times in s from the first answer'
_PATTERN = re.compile(
    r'(?P<kind>\w+)(:(?P<joint>\w+))?@(?P<start>[\d.]+)(\+(?P<duration>[\d.]+))?'
    r'(=(?P<value>\S+))?')


@dataclass(frozen=True, slots=True)
class Fault:
    """
    One fault.

    Attributes
    ----------
    kind : str
        One of KINDS.
    joint : int or None
        Index of the joint in ALL_JOINT_NAMES; None for the whole bus.
    start, end : float
        Time of beginning and end, s from the first answer.
    value : float
        Size or code in the unit of its kind; 0 for a kind without a value.
    text : str
        Text on the command line.

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


def parse_fault(text: str, sensors: int = len(JOINT_NAMES)) -> Fault:
    """
    Return the fault described by a text such as 'offset:joint_3a@5+2=1.5'.

    Without a duration it does not end. The joint is one of those with sensors, of which there are
    as many as `sensors`.

    Raises
    ------
    InputError
        The text does not follow SYNTAX.

    """
    found = _PATTERN.fullmatch(text)
    if not found:
        raise InputError(f"fault '{text}'; expected {SYNTAX}")
    joints = ALL_JOINT_NAMES[:sensors]
    kind, joint, value = found['kind'], found['joint'], found['value']
    kinds = KINDS | DRIVE_KINDS
    if kind not in kinds:
        raise InputError(f"fault '{text}': kind '{kind}'; expected one of {', '.join(kinds)}")
    if kind in BUS_WIDE:
        if joint:
            raise InputError(f"fault '{text}': {kind} affects the whole bus; expected no joint")
    elif joint not in joints:
        raise InputError(f"fault '{text}': joint '{joint}'; "
                         f'expected one of {", ".join(joints)}')
    unit = kinds[kind][1]
    if (unit is None) != (value is None):
        raise InputError(f"fault '{text}'; expected "
                         + (f'=VALUE ({unit})' if unit else f'no value with {kind}'))
    try:
        start = float(found['start'])
        duration = float(found['duration']) if found['duration'] else float('inf')
        number = 0.0 if value is None else _number(kind, value)
    except ValueError as error:
        raise InputError(f"fault '{text}': not a number ({error})") from error
    if duration <= 0.0:
        raise InputError(f"fault '{text}': +{found['duration']}; expected a duration above 0")
    for what, size in (('START', start), ('VALUE', number)):
        if not isfinite(size):
            raise InputError(f"fault '{text}': {what} is {size:g}; expected a finite number")
    if kind == 'noise' and number < 0.0:
        raise InputError(f"fault '{text}': VALUE is {number:g}; expected 0 or more ({unit})")
    if kind == 'late' and number <= 0.0:
        raise InputError(f"fault '{text}': VALUE is {number:g}; expected above 0 ({unit})")
    if kind == 'loss' and not 0.0 < number <= 100.0:
        raise InputError(f"fault '{text}': VALUE is {number:g}; expected above 0, to 100 ({unit})")
    return Fault(kind, joints.index(joint) if joint else None, start, start + duration,
                 number, text)


def parse_switched(text: str, sensors: int = len(JOINT_NAMES)) -> Fault:
    """
    Return a fault that begins now, described by a text such as 'offset:joint_3a=1.5'.

    Raises
    ------
    InputError
        The text is not KIND:JOINT or KIND:JOINT=VALUE with one of SWITCHED.

    """
    name, equals, value = text.partition('=')
    kind = name.partition(':')[0]
    if kind not in SWITCHED or '@' in text:
        raise InputError(f"fault '{text}'; expected KIND:JOINT or offset:JOINT=DEG, KIND one of "
                         f'{", ".join(SWITCHED)}')
    return replace(parse_fault(f'{name}@0{equals}{value}', sensors), text=text)


def _number(kind: str, value: str) -> float:
    return int(value, 0) & 0xFFFF if kind in ('emcy', 'drive') else float(value)
