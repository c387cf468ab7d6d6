# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An encoder on the bus: where its counts stand in a frame, and what angle they mean."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Literal

TURN = 2.0 * math.pi


def angle_from_counts(counts: int, zero_count: int, direction: int, counts_per_turn: int) -> float:
    """
    Return the joint angle of an absolute encoder, rad in (-pi, pi].

    It inverts counts = zero + direction * angle * counts_per_turn / 2 pi (mod counts_per_turn).
    """
    turns = (direction * (counts - zero_count)) % counts_per_turn
    if 2 * turns > counts_per_turn:
        turns -= counts_per_turn
    return turns * TURN / counts_per_turn


def counts_from_angle(
        angle: float, zero_count: int, direction: int, counts_per_turn: int) -> int:
    """Return the counts in [0, counts_per_turn) of an encoder at a joint angle in rad."""
    return (zero_count + direction * round(angle * counts_per_turn / TURN)) % counts_per_turn


def lowest_bit(mask: int) -> int:
    """Return the place of a mask's lowest bit that is set."""
    return (mask & -mask).bit_length() - 1


@dataclass(frozen=True, slots=True)
class EncoderLayout:
    """
    One absolute encoder's frame and scale.

    Attributes
    ----------
    joint : str
        Name of the joint it measures.
    can_id : int
        Identifier of the frame that carries its counts.
    extended : bool
        The identifier has 29 bits (else 11).
    data_length : int
        Bytes of that frame; one with another length is rejected.
    byte_offset, bit_length : int
        Where the word with the counts starts, and how many bits it has.
    byte_order : str
        'little' or 'big'.
    mask : int
        Which bits of that word are the counts, in one piece; 0 for all of them.
    signed : bool
        The counts are a two's complement number.
    counts_per_turn, zero_count : int
        Scale, and the counts at joint angle 0.
    direction : int
        +1 where counts grow with the joint angle, else -1.
    counter_byte, counter_mask : int
        Byte of the frame, and its bits, that grow by one with every frame; mask 0 for none.
    status_byte, status_mask, status_good : int
        Byte of the frame, its bits that tell the encoder's health, and what they say when it is
        well; mask 0 for none.

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

    @property
    def byte_length(self) -> int:
        """Bytes that the word with the counts takes in the frame."""
        return (self.bit_length + 7) // 8

    @property
    def position_mask(self) -> int:
        """The bits of the word that are the counts."""
        return self.mask or (1 << self.bit_length) - 1

    @property
    def counter_modulus(self) -> int:
        """How many values the rolling counter has."""
        return (self.counter_mask >> lowest_bit(self.counter_mask)) + 1

    def counts(self, data: bytes | bytearray) -> int | None:
        """
        Return the counts that a frame's data carry, None where no encoder on a shaft can say so.

        A single-turn encoder never reports a turn or more: such a value (all ones, as many devices
        say "error") is no position, and taking it modulo a turn would make it one. A multi-turn
        encoder's turns are masked away.
        """
        start = self.byte_offset
        value = int.from_bytes(data[start:start + self.byte_length], self.byte_order)
        mask = self.position_mask
        value = (value & mask) >> lowest_bit(mask)
        if self.signed:
            if value >> mask.bit_count() - 1:
                value -= 1 << mask.bit_count()
            # Half a turn to either side, both ends included: -180.0 and 180.0 deg both occur.
            return value if 2 * abs(value) <= self.counts_per_turn else None
        return value if value < self.counts_per_turn else None

    def healthy(self, data: bytes | bytearray) -> bool:
        """Tell whether the frame's status bits say that the encoder is well."""
        return not self.status_mask \
            or data[self.status_byte] & self.status_mask == self.status_good

    def counter(self, data: bytes | bytearray) -> int | None:
        """Return the frame's rolling counter, None where it has none."""
        if not self.counter_mask:
            return None
        return (data[self.counter_byte] & self.counter_mask) >> lowest_bit(self.counter_mask)

    def angle(self, counts: int) -> float:
        """Return the joint angle at `counts`, rad in (-pi, pi]."""
        return angle_from_counts(counts, self.zero_count, self.direction, self.counts_per_turn)

    def data(self, angle: float, counter: int = 0, healthy: bool = True) -> bytes:
        """
        Return the frame's data of the encoder at a joint angle in rad.

        Parameters
        ----------
        angle : float
            Joint angle, rad.
        counter : int
            Frames sent before this one; the rolling counter is taken from it, where there is one.
        healthy : bool
            What the status bits say, where there are any.

        """
        counts = counts_from_angle(angle, self.zero_count, self.direction, self.counts_per_turn)
        if self.signed and 2 * counts >= self.counts_per_turn:
            counts -= self.counts_per_turn
        mask = self.position_mask
        word = (counts << lowest_bit(mask)) & mask
        data = bytearray(self.data_length)
        start = self.byte_offset
        data[start:start + self.byte_length] = word.to_bytes(self.byte_length, self.byte_order)
        if self.status_mask:
            status = self.status_good if healthy else ~self.status_good & self.status_mask
            data[self.status_byte] |= status
        if self.counter_mask:
            data[self.counter_byte] |= \
                counter % self.counter_modulus << lowest_bit(self.counter_mask)
        return bytes(data)
