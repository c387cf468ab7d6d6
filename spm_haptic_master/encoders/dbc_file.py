# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Encoders' frames as a DBC file describes them: the lines for rig.yaml.

Signals are recognised by their names; a remark reports whatever is uncertain.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from pathlib import Path
import re
from typing import Any

from spm_haptic_master.encoders.encoder_layout import lowest_bit
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES

# What the names of signals with a position, a rolling counter and status bits contain.
POSITION = re.compile(r'pos|angle|count(?!er)|winkel|encoder', re.IGNORECASE)
COUNTER = re.compile(r'counter|alive|rolling|sequence|_cnt|msgcnt', re.IGNORECASE)
STATUS = re.compile(r'status|state|error|fault|valid|warn', re.IGNORECASE)
# Words of a value of a status signal that stand for health.
GOOD = re.compile(r'^(ok|okay|good|valid|no.?err.*|no.?fault.*|healthy|normal)$', re.IGNORECASE)
# Least length of a position (bits): a coarser one is of no use here.
LEAST_BITS = 8
# Size of a turn in the units of a signal.
TURNS = {
    'deg': 360.0,
    'degree': 360.0,
    'degrees': 360.0,
    '°': 360.0,
    'mdeg': 360e3,
    'rad': 2.0 * pi,
    'mrad': 2e3 * pi,
    'turn': 1.0,
    'turns': 1.0,
    'rev': 1.0,
}
# Largest relative deviation of a scale from a whole number of counts per turn (unit 1).
SCALE_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class DescribedFrame:
    """
    A frame with a position, in the settings of one encoder.

    Attributes
    ----------
    name, signal : str
        Names of the frame and of its position signal in the file.
    can_id : int
        Identifier of the frame.
    extended : bool
        Whether that has 29 bits; otherwise 11.
    data_length : int
        Length of the data, bytes.
    byte_offset : int
        First byte of the word with the counts.
    bit_length : int
        Length of that word, bits.
    byte_order : str
        'little' or 'big'.
    mask : int
        Bits of the word that are the counts; 0 for all.
    signed : bool
        Whether the counts are a two's complement number.
    counts_per_turn : int
        Counts in a turn, as far as the file has them.
    counter_byte, counter_mask : int
        Byte and bits of the rolling counter; a mask of 0: none.
    status_byte, status_mask, status_good : int
        Byte and bits of the status, and their value without an error; a mask of 0: none.
    remarks : tuple of str
        What is to be compared with the data sheet.

    """

    name: str
    signal: str
    can_id: int
    extended: bool
    data_length: int
    byte_offset: int
    bit_length: int
    byte_order: str
    mask: int
    signed: bool
    counts_per_turn: int
    counter_byte: int
    counter_mask: int
    status_byte: int
    status_mask: int
    status_good: int
    remarks: tuple[str, ...]


def read_dbc(path: str) -> list[DescribedFrame]:
    """
    Return the frames with a position in a DBC file.

    Parameters
    ----------
    path : str
        The file, in any format that cantools reads.

    Returns
    -------
    list of DescribedFrame
        At least one frame, in the order of the file.

    Raises
    ------
    InputError
        The file cannot be read, no signal in it is a position, or cantools is not installed.

    """
    if not Path(path).is_file():
        raise InputError(f'{path}: no such file; expected a DBC file')
    cantools = import_cantools()
    try:
        database = cantools.database.load_file(path)
        frames = database.messages
    except Exception as error:  # of the reader of each format that the library knows
        reason = ' '.join(str(error).split())[:200]
        raise InputError(f'{path}: not a readable DBC file ({reason})') from error
    found = [described for frame in frames if (described := _described(frame)) is not None]
    if not found:
        names = ', '.join(signal.name for frame in frames for signal in frame.signals)
        raise InputError(
            f'{path}: no signal with a position in it (signals: {names or "none"}); expected one '
            f'of {LEAST_BITS} bits or more, named like position, angle or counts'
        )
    return found


def import_cantools() -> Any:
    """Return the library cantools; raise InputError if it is not installed."""
    try:
        import cantools
    except ImportError as error:
        raise InputError(
            'a DBC file needs cantools (sudo apt install python3-cantools; in a virtual '
            f"environment: pip install '.[dbc]'): {error}"
        ) from error
    return cantools


def _described(frame: Any) -> DescribedFrame | None:
    """Return the settings of a frame with a position, None for another frame."""
    signals = [signal for signal in frame.signals if not signal.is_float]
    position = _position(signals)
    if position is None:
        return None
    others = [signal for signal in signals if signal is not position]
    counter = _first(others, COUNTER)
    status = _first([signal for signal in others if signal is not counter], STATUS)
    offset, bits, mask = _word(position)
    counts, remarks = _counts_per_turn(position)
    counter_byte, counter_mask = _byte_and_mask(counter, remarks)
    status_byte, status_mask = _byte_and_mask(status, remarks)
    return DescribedFrame(
        name=frame.name,
        signal=position.name,
        can_id=frame.frame_id,
        extended=frame.is_extended_frame,
        data_length=frame.length,
        byte_offset=offset,
        bit_length=bits,
        byte_order='little' if position.byte_order == 'little_endian' else 'big',
        mask=mask,
        signed=position.is_signed,
        counts_per_turn=counts,
        counter_byte=counter_byte,
        counter_mask=counter_mask,
        status_byte=status_byte,
        status_mask=status_mask,
        status_good=_good_value(status, status_mask, remarks),
        remarks=tuple(remarks),
    )


def _position(signals: list[Any]) -> Any:
    """Return the longest signal that is named like a position, None without one."""
    positions = [
        signal
        for signal in signals
        if signal.length >= LEAST_BITS and POSITION.search(signal.name)
    ]
    return max(positions, key=lambda signal: signal.length, default=None)


def _first(signals: list[Any], name: re.Pattern[str]) -> Any:
    """Return the first signal with such a name, None without one."""
    return next((signal for signal in signals if name.search(signal.name)), None)


def _word(signal: Any) -> tuple[int, int, int]:
    """
    Return first byte, length in bits and mask of the word with a signal; mask 0 for all bits.

    A DBC file numbers bit n of byte b as 8 b + n. A little-endian signal begins with its lowest
    bit, a big-endian one with its highest.
    """
    first, bit = divmod(signal.start, 8)
    before = bit if signal.byte_order == 'little_endian' else 7 - bit
    size = -(-(before + signal.length) // 8)
    if signal.byte_order == 'little_endian':
        shift = before
    else:
        shift = 8 * size - before - signal.length
    mask = ((1 << signal.length) - 1) << shift
    return first, 8 * size, 0 if signal.length == 8 * size else mask


def _counts_per_turn(signal: Any) -> tuple[int, list[str]]:
    """Return the counts per turn by scale and unit of a signal, and what is not certain."""
    unit = (signal.unit or '').strip().lower()
    most = 1 << signal.length
    if unit in TURNS and signal.scale:
        counts = TURNS[unit] / abs(signal.scale)
        if counts <= most and abs(counts - round(counts)) <= SCALE_TOLERANCE * counts:
            return round(counts), []
    if signal.maximum and signal.scale and not signal.is_signed:
        raw = (signal.maximum - signal.offset) / signal.scale
        if 1 < raw < most:
            return round(raw) + 1, ['counts_per_turn is from the maximum: compare the data sheet']
    return most, ['counts_per_turn is 2 to the number of bits: compare the data sheet']


def _byte_and_mask(signal: Any, remarks: list[str]) -> tuple[int, int]:
    """Return the byte of a signal and its bits there; 0, 0 without one, or where it has more."""
    if signal is None:
        return 0, 0
    first, length, mask = _word(signal)
    if length > 8:
        remarks.append(f'{signal.name} is in more than one byte, and not used')
        return 0, 0
    return first, mask or 0xFF


def _good_value(
    signal: Any,
    mask: int,
    remarks: list[str],
) -> int:
    """Return the bits of a status signal in health, at their place in the byte."""
    if signal is None or not mask:
        return 0
    for value, word in (signal.choices or {}).items():
        if GOOD.match(str(word)):
            return int(value) << lowest_bit(mask)
    remarks.append(f'status_good: the file does not say which value of {signal.name} is good')
    return 0


def rig_lines(frames: list[DescribedFrame], path: str) -> list[str]:
    """
    Return the lines for rig.yaml.

    Parameters
    ----------
    frames : list of DescribedFrame
        Frames of the encoders, in the order of the file.
    path : str
        The file, for a comment.

    Returns
    -------
    list of str
        Lines of YAML; the order of the joints is left to the reader.

    """
    count = len(frames)
    lines = [f'# frames of {path}: put the lists into the order of the joints, as they are wired']
    if not len(JOINT_NAMES) <= count <= len(ALL_JOINT_NAMES):
        lines.append(
            f'# frames with a position: {count}, expected {len(JOINT_NAMES)} to '
            f'{len(ALL_JOINT_NAMES)}: complete or shorten the lists'
        )
    lines += [
        '/**:',
        '  ros__parameters:',
        '    source: can',
        *([f'    sensors: {count}'] if count in (5, 6) else []),
        '    can: {protocol: raw}   # delete it if they are CANopen nodes',
        '    encoders:',
        f'      # {", ".join(f"{each.name}.{each.signal}" for each in frames)}',
    ]
    for name in DescribedFrame.__dataclass_fields__:
        if name in ('name', 'signal', 'remarks'):
            continue
        shown = ', '.join(_yaml(name, getattr(each, name)) for each in frames)
        lines.append(f'      {"id" if name == "can_id" else name}: [{shown}]')
    return lines + [f'# {each.name}: {remark}' for each in frames for remark in each.remarks]


def _yaml(name: str, value: object) -> str:
    """Return a value in YAML: identifiers and masks are hexadecimal."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, int) and (name == 'can_id' or name.endswith('mask')):
        return f'0x{value:X}'
    return str(value)
