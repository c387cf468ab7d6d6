# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
An encoder's frame: its layout, its scale (data, counts, joint angle) and its checks.

Decoding and encoding are both here, so that simulated frames are those of the rig.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
import math
from typing import Literal

import can
from spm_haptic_master.encoders.harmonics import Harmonics, KNOTS
from spm_haptic_master.timing import RateMeter

# Full turn (rad).
TURN = 2.0 * math.pi
# Reasons for rejecting a frame that is an answer without a reading.
STATUS_ERROR = 'status bits report an error'
UNCHANGED = 'rolling counter unchanged'


def angle_from_counts(
    counts: int,
    zero_count: int,
    direction: int,
    counts_per_turn: int,
) -> float:
    """
    Return the joint angle of an absolute encoder without harmonics.

    Inverse of counts = zero + direction * angle * counts_per_turn / 2 pi (mod counts_per_turn).

    Parameters
    ----------
    counts : int
        Counts of the encoder.
    zero_count : int
        Counts at joint angle 0.
    direction : int
        Sign of counts against joint angle, 1 or -1.
    counts_per_turn : int
        Counts in a turn.

    Returns
    -------
    float
        Joint angle, rad in (-pi, pi].

    """
    turns = (direction * (counts - zero_count)) % counts_per_turn
    if 2 * turns > counts_per_turn:
        turns -= counts_per_turn
    return turns * TURN / counts_per_turn


def counts_from_angle(
    angle: float,
    zero_count: int,
    direction: int,
    counts_per_turn: int,
) -> int:
    """
    Return the counts of an absolute encoder without harmonics.

    Parameters
    ----------
    angle : float
        Joint angle, rad.
    zero_count : int
        Counts at joint angle 0.
    direction : int
        Sign of counts against joint angle, 1 or -1.
    counts_per_turn : int
        Counts in a turn.

    Returns
    -------
    int
        Counts in [0, counts_per_turn), rounded.

    """
    counts = round(angle * counts_per_turn / TURN)
    return (zero_count + direction * counts) % counts_per_turn


def lowest_bit(mask: int) -> int:
    """Return the position of the lowest bit set in a mask."""
    return (mask & -mask).bit_length() - 1


@dataclass(frozen=True)
class EncoderLayout:
    """
    Frame and scale of one absolute encoder.

    Attributes
    ----------
    joint : str
        Joint or axis that it measures.
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
        Byte order of that word, 'little' or 'big'.
    mask : int
        Contiguous bits of that word that are the counts; 0 for all.
    signed : bool
        Whether the counts are a two's complement number.
    counts_per_turn : int
        Counts in a turn.
    direction : int
        Sign of counts against joint angle, 1 or -1.
    zero_count : int
        Counts at joint angle 0.
    counter_byte : int
        Byte of the frame with the rolling counter.
    counter_mask : int
        Contiguous bits of that byte that grow by one with every frame; 0 for no counter.
    status_byte : int
        Byte of the frame with the status bits.
    status_mask : int
        Status bits of that byte; 0 for none.
    status_good : int
        Value of the status bits without an error.
    harmonics : Harmonics or None
        Harmonics of the reading; None for a reading that is the joint angle.

    """

    joint: str
    can_id: int
    extended: bool
    data_length: int
    byte_offset: int
    bit_length: int
    byte_order: Literal['little', 'big']
    mask: int
    signed: bool
    counts_per_turn: int
    direction: int
    zero_count: int
    counter_byte: int
    counter_mask: int
    status_byte: int
    status_mask: int
    status_good: int
    harmonics: Harmonics | None = None

    @property
    def byte_length(self) -> int:
        """Length of the word with the counts, bytes."""
        return (self.bit_length + 7) // 8

    @cached_property
    def position_mask(self) -> int:
        """Bits of the word that are the counts."""
        return self.mask or (1 << self.bit_length) - 1

    @cached_property
    def _word(self) -> slice:
        """Bytes of the frame with the counts."""
        return slice(self.byte_offset, self.byte_offset + self.byte_length)

    @cached_property
    def _lowest_bit(self) -> int:
        """Bits of the word below the counts."""
        return lowest_bit(self.position_mask)

    @property
    def counter_modulus(self) -> int:
        """Return the number of values of the rolling counter."""
        return (self.counter_mask >> lowest_bit(self.counter_mask)) + 1

    def counts(self, data: bytes | bytearray) -> int | None:
        """
        Return the counts in a frame's data.

        A single-turn encoder never reports a turn or more: such a value (all ones: an error of
        many devices) is not a position, and must not be made one modulo a turn. The turns of a
        multi-turn encoder are masked.

        Parameters
        ----------
        data : bytes
            Data of `data_length` bytes.

        Returns
        -------
        int or None
            Counts, negative ones if they are signed; None for a value beyond a turn.

        """
        mask = self.position_mask
        value = (int.from_bytes(data[self._word], self.byte_order) & mask) >> self._lowest_bit
        if self.signed:
            if value >> mask.bit_count() - 1:
                value -= 1 << mask.bit_count()
            # Half a turn in either direction, inclusive: -180.0 and 180.0 deg both occur.
            if 2 * abs(value) <= self.counts_per_turn:
                return value
            return None
        return value if value < self.counts_per_turn else None

    def healthy(self, data: bytes | bytearray) -> bool:
        """
        Return whether the frame's status bits, if any, report no error.

        Parameters
        ----------
        data : bytes
            Data of `data_length` bytes.

        """
        return (
            not self.status_mask or data[self.status_byte] & self.status_mask == self.status_good
        )

    def counter(self, data: bytes | bytearray) -> int | None:
        """
        Return the frame's rolling counter.

        Parameters
        ----------
        data : bytes
            Data of `data_length` bytes.

        Returns
        -------
        int or None
            Its value, from 0 to `counter_modulus` - 1; None if the frame has none.

        """
        if not self.counter_mask:
            return None
        bits = data[self.counter_byte] & self.counter_mask
        return bits >> lowest_bit(self.counter_mask)

    def angle(self, counts: int) -> float:
        """
        Return the joint angle, corrected by the harmonics if there are any.

        Parameters
        ----------
        counts : int
            Counts of the encoder.

        Returns
        -------
        float
            Joint angle, rad in (-pi, pi].

        """
        per_turn = self.counts_per_turn
        if self.harmonics is None:
            return angle_from_counts(counts, self.zero_count, self.direction, per_turn)
        turns = (self.direction * (counts - self.zero_count)) % per_turn
        angle = turns * TURN / per_turn + self.harmonics.corrections[turns * KNOTS // per_turn]
        if angle > math.pi:
            return angle - TURN
        return angle

    def data(
        self,
        angle: float,
        counter: int = 0,
        healthy: bool = True,
    ) -> bytes:
        """
        Return the data of a frame, as an encoder sends it.

        Parameters
        ----------
        angle : float
            Joint angle, rad.
        counter : int
            Number of frames before, for the rolling counter.
        healthy : bool
            Whether the status bits report no error.

        Returns
        -------
        bytes
            Data of `data_length` bytes.

        """
        if self.harmonics is not None:
            angle = float(self.harmonics.readings(angle))
        counts = counts_from_angle(angle, self.zero_count, self.direction, self.counts_per_turn)
        if self.signed and 2 * counts >= self.counts_per_turn:
            counts -= self.counts_per_turn
        mask = self.position_mask
        word = (counts << lowest_bit(mask)) & mask
        data = bytearray(self.data_length)
        start = self.byte_offset
        data[start : start + self.byte_length] = word.to_bytes(self.byte_length, self.byte_order)
        if self.status_mask:
            if healthy:
                status = self.status_good
            else:
                status = ~self.status_good & self.status_mask
            data[self.status_byte] |= status
        if self.counter_mask:
            data[self.counter_byte] |= counter % self.counter_modulus << lowest_bit(
                self.counter_mask
            )
        return bytes(data)


class Encoder:
    """
    Frames of one encoder: their checks and counters.

    Parameters
    ----------
    layout : EncoderLayout
        Their layout.

    Attributes
    ----------
    layout : EncoderLayout
        As given.
    heard : float or None
        Time of the latest good frame, s since the Unix epoch; None before the first.
    counts : int or None
        Counts in the latest good frame, as the encoder sends them; None before the first.
    refused : tuple of (float, str), or None
        Time, s since the Unix epoch, and reason of the latest rejection.
    rejects : Counter of str
        Numbers of rejected frames by reason.
    frames : RateMeter
        Number and rate of the good frames.
    lost : int or None
        Numbers that the rolling counter left out before the latest frame; None where that is
        unknown.

    """

    def __init__(self, layout: EncoderLayout):
        self.layout = layout
        self.heard: float | None = None
        self.counts: int | None = None
        self.refused: tuple[float, str] | None = None
        self.rejects: Counter[str] = Counter()
        self.frames = RateMeter()
        self.lost: int | None = None
        self._counter: int | None = None

    def check(self, message: can.Message) -> tuple[float, str | None]:
        """
        Check a frame of this encoder, and decode it.

        Parameters
        ----------
        message : can.Message
            Data frame with its identifier, stamped in s since the Unix epoch.

        Returns
        -------
        angle : float
            Joint angle, rad; NaN for a rejected frame.
        reason : str or None
            Why it is rejected; None for a good frame.

        """
        layout = self.layout
        data = message.data
        if len(data) != layout.data_length:
            return math.nan, self.reject(
                message, f'{len(data)} bytes instead of {layout.data_length}'
            )
        counts = layout.counts(data)
        if counts is None:
            return math.nan, self.reject(message, 'counts beyond a turn')
        if self._is_unchanged(layout.counter(data)):
            return math.nan, self.reject(message, UNCHANGED)
        if not layout.healthy(data):
            return math.nan, self.reject(message, STATUS_ERROR)
        self.heard = message.timestamp
        self.counts = counts
        self.frames.count += 1
        return layout.angle(counts), None

    def restart(self) -> None:
        """Take the next value of the rolling counter as the first one."""
        self._counter = None

    def reject(self, message: can.Message, reason: str) -> str:
        """
        Count a rejected frame.

        Parameters
        ----------
        message : can.Message
            The frame, stamped in s since the Unix epoch.
        reason : str
            Why it is rejected.

        Returns
        -------
        str
            The reason.

        """
        self.rejects[reason] += 1
        self.refused = message.timestamp, reason
        return reason

    def _is_unchanged(self, counter: int | None) -> bool:
        """Note the rolling counter, if there is one; return whether it repeats the one before."""
        if counter is None:
            return False
        before = self._counter
        self._counter = counter
        self.lost = None
        if before is not None and counter != before:
            self.lost = (counter - before - 1) % self.layout.counter_modulus
            if self.lost:
                self.rejects['rolling counter jumped (frame kept)'] += 1
        return counter == before
