# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An encoder's frame: its layout, its scale (data, counts, joint angle) and its checks."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
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


def angle_from_counts(counts: int, zero_count: int, direction: int, counts_per_turn: int) -> float:
    """
    Return the joint angle of an absolute encoder without harmonics, rad in (-pi, pi].

    Inverse of counts = zero + direction * angle * counts_per_turn / 2 pi (mod counts_per_turn).
    """
    turns = (direction * (counts - zero_count)) % counts_per_turn
    if 2 * turns > counts_per_turn:
        turns -= counts_per_turn
    return turns * TURN / counts_per_turn


def counts_from_angle(angle: float, zero_count: int, direction: int, counts_per_turn: int) -> int:
    """Return the counts in [0, counts_per_turn) of an encoder at a joint angle in rad."""
    return (zero_count + direction * round(angle * counts_per_turn / TURN)) % counts_per_turn


def lowest_bit(mask: int) -> int:
    """Return the position of the lowest bit set in a mask."""
    return (mask & -mask).bit_length() - 1


@dataclass(frozen=True, slots=True)
class EncoderLayout:
    """Frame and scale of one absolute encoder."""

    joint: str
    can_id: int  # of the frame
    extended: bool  # the identifier has 29 bits; otherwise 11
    data_length: int  # of the frame, bytes
    byte_offset: int  # first byte of the word with the counts
    bit_length: int  # of that word, bits
    byte_order: Literal['little', 'big']  # of that word
    mask: int  # contiguous bits of that word that are the counts; 0 for all
    signed: bool  # the counts are a two's complement number
    counts_per_turn: int
    direction: int  # sign of counts against joint angle, +1 or -1
    zero_count: int  # counts at joint angle 0
    counter_byte: int  # byte of the frame with the rolling counter
    # Contiguous bits of that byte that grow by one with every frame; 0 for no counter.
    counter_mask: int
    status_byte: int  # byte of the frame with the status bits
    status_mask: int  # status bits of that byte; 0 for none
    status_good: int  # value of the status bits without an error
    # Harmonics of the reading; None for a reading that is the joint angle.
    harmonics: Harmonics | None = None

    @property
    def byte_length(self) -> int:
        """Length of the word with the counts, bytes."""
        return (self.bit_length + 7) // 8

    @property
    def position_mask(self) -> int:
        """Bits of the word that are the counts."""
        return self.mask or (1 << self.bit_length) - 1

    @property
    def counter_modulus(self) -> int:
        """Return the number of values of the rolling counter."""
        return (self.counter_mask >> lowest_bit(self.counter_mask)) + 1

    def counts(self, data: bytes | bytearray) -> int | None:
        """
        Return the counts in a frame's data, None for a value beyond a turn.

        A single-turn encoder never reports a turn or more: such a value (all ones: an error of
        many devices) is not a position, and must not be made one modulo a turn. The turns of a
        multi-turn encoder are masked.
        """
        start = self.byte_offset
        value = int.from_bytes(data[start : start + self.byte_length], self.byte_order)
        mask = self.position_mask
        value = (value & mask) >> lowest_bit(mask)
        if self.signed:
            if value >> mask.bit_count() - 1:
                value -= 1 << mask.bit_count()
            # Half a turn in either direction, inclusive: -180.0 and 180.0 deg both occur.
            return value if 2 * abs(value) <= self.counts_per_turn else None
        return value if value < self.counts_per_turn else None

    def healthy(self, data: bytes | bytearray) -> bool:
        """Return whether the frame's status bits, if any, report no error."""
        return (
            not self.status_mask or data[self.status_byte] & self.status_mask == self.status_good
        )

    def counter(self, data: bytes | bytearray) -> int | None:
        """Return the frame's rolling counter, None if it has none."""
        if not self.counter_mask:
            return None
        return (data[self.counter_byte] & self.counter_mask) >> lowest_bit(self.counter_mask)

    def angle(self, counts: int) -> float:
        """Return the joint angle at `counts`, rad in (-pi, pi]."""
        per_turn = self.counts_per_turn
        if self.harmonics is None:
            return angle_from_counts(counts, self.zero_count, self.direction, per_turn)
        turns = (self.direction * (counts - self.zero_count)) % per_turn
        angle = turns * TURN / per_turn + self.harmonics.corrections[turns * KNOTS // per_turn]
        return angle - TURN if angle > math.pi else angle

    def data(self, angle: float, counter: int = 0, healthy: bool = True) -> bytes:
        """Return the data for a joint angle, rad, after `counter` frames; `healthy`: status."""
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
            status = self.status_good if healthy else ~self.status_good & self.status_mask
            data[self.status_byte] |= status
        if self.counter_mask:
            data[self.counter_byte] |= counter % self.counter_modulus << lowest_bit(
                self.counter_mask
            )
        return bytes(data)


class Encoder:
    """Frames of one encoder: their checks and counters."""

    def __init__(self, layout: EncoderLayout):
        self.layout = layout
        # Time of the latest good frame, s since the Unix epoch; None before the first.
        self.heard: float | None = None
        # Time, s since the Unix epoch, and reason of the latest rejection.
        self.refused: tuple[float, str] | None = None
        self.rejects: Counter[str] = Counter()
        self.frames = RateMeter()
        # Numbers that the rolling counter left out before the latest good frame, if it has one.
        self.lost: int | None = None
        self._counter: int | None = None

    def check(self, message: can.Message) -> tuple[float, str | None]:
        """Return the joint angle in a frame of this encoder, rad; if rejected, NaN and why."""
        layout, data = self.layout, message.data
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
        self.frames.count += 1
        return layout.angle(counts), None

    def restart(self) -> None:
        """Take the next value of the rolling counter as the first one."""
        self._counter = None

    def reject(self, message: can.Message, reason: str) -> str:
        """Count a rejected frame; return the reason."""
        self.rejects[reason] += 1
        self.refused = message.timestamp, reason
        return reason

    def _is_unchanged(self, counter: int | None) -> bool:
        """Note the rolling counter, if there is one; return whether it repeats the one before."""
        if counter is None:
            return False
        before, self._counter, self.lost = self._counter, counter, None
        if before is not None and counter != before:
            self.lost = (counter - before - 1) % self.layout.counter_modulus
            if self.lost:
                self.rejects['rolling counter jumped (frame kept)'] += 1
        return counter == before
