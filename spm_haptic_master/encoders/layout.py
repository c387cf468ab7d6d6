"""An encoder on the bus: where its counts stand in a frame, and what angle they mean."""

from __future__ import annotations

from dataclasses import dataclass
import math

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
        Where the counts start, and how many bits they have.
    byte_order : str
        'little' or 'big'.
    counts_per_turn, zero_count : int
        Scale, and the counts at joint angle 0.
    direction : int
        +1 where counts grow with the joint angle, else -1.

    """

    joint: str
    can_id: int
    extended: bool
    data_length: int
    byte_offset: int
    bit_length: int
    byte_order: str
    counts_per_turn: int
    direction: int
    zero_count: int

    @property
    def byte_length(self) -> int:
        """Bytes that the counts take in the frame."""
        return (self.bit_length + 7) // 8

    def counts(self, data: bytes | bytearray) -> int | None:
        """
        Return the counts that a frame's data carry, None where no encoder on a shaft can say so.

        A single-turn encoder never reports a turn or more: such a value (all ones, as many devices
        say "error") is no position, and taking it modulo a turn would make it one.
        """
        start = self.byte_offset
        value = int.from_bytes(data[start:start + self.byte_length], self.byte_order)
        value &= (1 << self.bit_length) - 1
        return value if value < self.counts_per_turn else None

    def angle(self, counts: int) -> float:
        """Return the joint angle at `counts`, rad in (-pi, pi]."""
        return angle_from_counts(counts, self.zero_count, self.direction, self.counts_per_turn)

    def data(self, angle: float) -> bytes:
        """Return the frame's data of the encoder at a joint angle in rad."""
        counts = counts_from_angle(angle, self.zero_count, self.direction, self.counts_per_turn)
        data = bytearray(self.data_length)
        start = self.byte_offset
        data[start:start + self.byte_length] = counts.to_bytes(self.byte_length, self.byte_order)
        return bytes(data)
