# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One screen of what a device reports: state and remedy, encoders, calibration, slave, motors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.axes import AXES, INSERTION
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, WARN

# Columns of the names.
NAMES = 15
# Words of the levels in front of a line.
WORDS = {OK: 'ok   ', WARN: 'WARN ', ERROR: 'ERROR'}
BLANK = ' ' * len(WORDS[OK])
# Entries on /diagnostics and the name of their line, in the order of the screen.
LINES = (
    ('fkm: orientation', 'state'),
    ('encoder_driver: encoders', 'bus'),
    *((f'encoder_driver: {axis}', axis) for axis in AXES),
    ('diagnostics: singularity', 'singularity'),
    ('teleop: teleop', 'teleop'),
    ('fkm: force', 'force'),
    ('fkm: timing', 'machine'),
)
ORIENTATION = LINES[0][0]
ENCODERS = LINES[1][0]
FORCE = 'fkm: force'
# Value of an entry that has none.
NONE = 'none'


@dataclass(frozen=True, slots=True)
class Entry:
    """
    An entry on /diagnostics.

    Values are texts by key, as on /diagnostics.
    """

    level: bytes  # OK, WARN or ERROR
    message: str  # the state in words, with its remedy
    values: Mapping[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class Device:
    """What the nodes of one namespace report."""

    namespace: str  # without slashes at its ends; empty for none
    entries: dict[str, Entry] = field(default_factory=dict)  # by 'NODE: ASPECT'
    states: dict[str, str] = field(default_factory=dict)  # texts of the state topics, by topic
    # Parameters of the nodes, as words; None: the node does not answer.
    limits: dict[str, str | None] = field(default_factory=dict)

    def is_well(self) -> bool:
        """
        Return whether orientations are published and no entry warns of anything.

        Returns
        -------
        bool
            False as well without an entry of `fkm`.

        """
        if ORIENTATION not in self.entries:
            return False
        return all(entry.level == OK for entry in self.entries.values())


def screen(device: Device) -> list[str]:
    """
    Return the lines of a device.

    Parameters
    ----------
    device : Device
        What its nodes report.

    Returns
    -------
    list of str
        One line for each entry, with its level, and lines of what it consists of.

    """
    lines = []
    for name, title in LINES:
        entry = device.entries.get(name)
        if entry is None:
            if name in (ORIENTATION, ENCODERS):
                node, _, _ = name.partition(':')
                lines.append(_line(WORDS[ERROR], title, f'no {node} answers'))
            continue
        text = entry.message + _position(title, entry)
        lines.append(_line(WORDS[entry.level], title, text))
        if name == ENCODERS:
            lines += _encoders(device)
            lines.append(_line(BLANK, 'calibration', _calibration(device)))
            lines += _limits(device)
        if name == FORCE:
            lines += _drives(entry)
    lines += _others(device)
    for topic, text in device.states.items():
        title = topic.removesuffix('_text').replace('_', ' ')
        lines.append(_line(BLANK, title, text))
    return lines


def _line(
    level: str,
    title: str,
    text: str,
) -> str:
    """Return a line: level, name and value."""
    return f'{level} {title:<{NAMES}} {text}'.rstrip()


def _encoders(device: Device) -> list[str]:
    """Return a line for each encoder: what driver and fkm report of it."""
    lines = []
    for joint in ALL_JOINT_NAMES:
        words = []
        for name in (ENCODERS, ORIENTATION):
            entry = device.entries.get(name)
            if entry is not None:
                words += _of_joint(entry.values, joint)
        if words:
            lines.append(_line(BLANK, f'  {joint}', ', '.join(words)))
    return lines


def _position(title: str, entry: Entry) -> str:
    """Return the position and the age of an axis's latest reading; empty of other entries."""
    if title not in AXES:
        return ''
    unit = 'm' if title == INSERTION else 'rad'
    position = entry.values.get('position', NONE)
    age = entry.values.get('age (ms)', NONE)
    return f', position {position} {unit}, age (ms) {age}'


def _of_joint(values: Mapping[str, str], joint: str) -> list[str]:
    """
    Return the values of an entry that are about a joint, without its name.

    Parameters
    ----------
    values : mapping
        Values of an entry by key.
    joint : str
        Name of a joint, with which the keys begin.

    Returns
    -------
    list of str
        Rest of each key, and the value.

    """
    words = []
    for key, value in values.items():
        if key.startswith(joint):
            name = key.removeprefix(joint).strip(' :')
            words.append(f'{name} {value}')
    return words


def _calibration(device: Device) -> str:
    """Return name and date of the calibration, the mechanism, and unverified directions."""
    values = device.entries[ENCODERS].values
    name = values.get('calibration', NONE)
    mechanism = values.get('mechanism', 'unknown')
    words = [name, f'mechanism {mechanism}']
    unverified = values.get('directions not verified', NONE)
    if unverified != NONE:
        words.append(f'directions not verified: {unverified}')
    return ', '.join(words)


def _limits(device: Device) -> list[str]:
    """Return a line of the limits of each node that was asked."""
    lines = []
    for node, text in device.limits.items():
        if text:
            words = f'{node}: {text}'
        else:
            words = f'unknown: {node} does not answer'
        lines.append(_line(BLANK, 'limits', words))
    return lines


def _drives(entry: Entry) -> list[str]:
    """Return a line for each drive that the entry of the force feedback has values of."""
    lines = []
    for key, value in entry.values.items():
        if key.startswith('drive'):
            lines.append(_line(BLANK, '  drives', f'{key}: {value}'))
    return lines


def _others(device: Device) -> Sequence[str]:
    """Return the entries of other nodes of the namespace."""
    known = {name for name, _ in LINES}
    lines = []
    for name, entry in sorted(device.entries.items()):
        if name not in known:
            node, _, _ = name.partition(':')
            lines.append(_line(WORDS[entry.level], node, entry.message))
    return lines
