# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Frames in, sets out: the one decoder behind the live bus and the recordings.

What kind of frame it is comes before whose it is: an error frame's identifier is a set of error
bits and may equal an encoder's, and so may a 29-bit one.
"""

from __future__ import annotations

from collections import Counter

import can

from spm_haptic_master.encoders import canopen, error_frames
from spm_haptic_master.encoders.canopen_nodes import CanopenNodes, Handler
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.encoders.set_assembler import SetAssembler
from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.meters import LatencyMeter, RateMeter

# Set in a key for a 29-bit identifier, beyond all of its bits.
WIDE = 1 << 29


class Encoder:
    """
    One encoder as the decoder sees it.

    Attributes
    ----------
    layout : EncoderLayout
        Its frame.
    heard : float or None
        When its latest good frame came, s.
    refused : tuple of (float, str) or None
        When a frame of its own was last rejected, s, and why.
    rejects : collections.Counter
        Its rejected frames by reason.
    frames : RateMeter
        Its good frames.

    """

    def __init__(self, layout: EncoderLayout):
        self.layout = layout
        self.heard: float | None = None
        self.refused: tuple[float, str] | None = None
        self.rejects: Counter[str] = Counter()
        self.frames = RateMeter()
        self._counter: int | None = None

    def check(self, message: can.Message) -> int | None:
        """Return the counts of a frame with this encoder's identifier, None if it is rejected."""
        layout, data = self.layout, message.data
        if len(data) != layout.data_length:
            self.reject(message, f'{len(data)} bytes instead of {layout.data_length}')
            return None
        if not layout.healthy(data):
            self.reject(message, 'status bits report an error')
            return None
        counts = layout.counts(data)
        if counts is None:
            self.reject(message, 'counts beyond a turn')
            return None
        counter = layout.counter(data)
        if counter is not None:
            before, self._counter = self._counter, counter
            if counter == before:
                self.reject(message, 'rolling counter stands still')
                return None
            if before is not None and counter != (before + 1) % layout.counter_modulus:
                self.rejects['rolling counter jumped (frame kept)'] += 1
        self.heard = message.timestamp
        self.frames.count += 1
        return counts

    def reject(self, message: can.Message, reason: str) -> None:
        """Count a frame that is not taken."""
        self.rejects[reason] += 1
        self.refused = message.timestamp, reason


class FrameDecoder:
    """
    Tells frames apart, and hands what is whose to the assembler and the CANopen network.

    Parameters
    ----------
    layouts : tuple of 4 EncoderLayout
        In the order of JOINT_NAMES.
    sync_id : int or None
        11-bit identifier of SYNC; None where the bus has none.
    assembler : SetAssembler
        Puts the sets together.
    network : CanopenNodes or None
        The encoders as CANopen nodes; None where they are not.
    emcy_stops : bool
        No set goes out while an encoder reports an emergency.

    Attributes
    ----------
    counters : collections.Counter
        Frames, and what was rejected by reason.
    encoders : tuple of Encoder
        In the order of the layouts.
    bus_error : str or None
        What the latest error frame said; None once a good encoder frame came after it.
    bus_off : bool
        The controller said that it left the bus, and no encoder was heard since.
    sync_heard : float or None
        When the latest SYNC came, s.
    emcy_stops : bool
        As given; False where there is no network.

    """

    def __init__(self, layouts: tuple[EncoderLayout, ...], sync_id: int | None,
                 assembler: SetAssembler, network: CanopenNodes | None, emcy_stops: bool):
        self.encoders = tuple(map(Encoder, layouts))
        self.sync_id = sync_id
        self.assembler = assembler
        self.network = network
        self.counters: Counter[str] = Counter()
        self.bus_error: str | None = None
        self.bus_off = False
        self.sync_heard: float | None = None
        self.emcy_stops = emcy_stops and network is not None
        self._by_key = {encoder.layout.can_id | WIDE * encoder.layout.extended: (index, encoder)
                        for index, encoder in enumerate(self.encoders)}
        # The nodes that can stop the sets.
        self._stopping = network if emcy_stops else None
        self._network_frames: dict[int, Handler] = network.handlers() if network else {}

    def reset(self) -> None:
        """Forget the cycle under way."""
        self.assembler.reset()

    def feed(self, message: can.Message) -> JointSample | None:
        """Take one frame, its timestamp in s since the epoch; return the set it completes."""
        self.counters['frames'] += 1
        if message.is_error_frame:
            self.counters['rejected: error frame'] += 1
            self.bus_error = error_frames.error_words(message)
            self.bus_off = self.bus_off or error_frames.is_bus_off(message)
            return None
        if message.is_remote_frame:
            self.counters['rejected: remote frame'] += 1
            return None
        if message.is_fd:
            self.counters['rejected: CAN FD frame'] += 1
            return None
        key = message.arbitration_id | WIDE * message.is_extended_id
        if key in self._by_key:
            return self._encoder(*self._by_key[key], message)
        if key == self.sync_id:
            self._sync(message)
        elif key in self._network_frames:
            self._supervise(self._network_frames[key], message)
        elif key ^ WIDE in self._by_key:
            self._by_key[key ^ WIDE][1].reject(message, 'identifier width')
        else:
            self.counters['rejected: foreign identifier'] += 1
        return None

    def is_sync(self, message: can.Message) -> bool:
        """Tell whether a frame is a good SYNC."""
        return message.arbitration_id == self.sync_id and not (
            message.is_error_frame or message.is_remote_frame or message.is_fd
            or message.is_extended_id or len(message.data) > canopen.SYNC_MAXIMUM_LENGTH)

    def open_cycle(self, stamp: float) -> None:
        """Begin a cycle at SYNC's time, s since the epoch."""
        self.sync_heard = stamp
        self.assembler.begin(stamp)

    def silent(self, now: float, timeout: float) -> tuple[int, ...]:
        """Return the indices of the joints with no good frame within `timeout` s before `now`."""
        return tuple(index for index, encoder in enumerate(self.encoders)
                     if not recent(encoder.heard, now, timeout))

    def explain(self, silent: tuple[int, ...], now: float, timeout: float) -> str | None:
        """Return why no sets come although frames may."""
        troubles = {}
        for index in silent:
            encoder = self.encoders[index]
            if encoder.refused and recent(encoder.refused[0], now, timeout):
                trouble = f'frames rejected, {encoder.refused[1]}'
            else:
                trouble = (self.network and self.network.trouble(index, now)) or 'no frames'
            troubles[encoder.layout.joint] = trouble
        if len(troubles) == len(self.encoders) and len(set(troubles.values())) == 1:
            return f'all encoders silent ({trouble})'
        return '; '.join(f'{joint} silent ({trouble})' for joint, trouble in troubles.items()) \
            or self.assembler.cause

    def tally(self) -> Counter[str]:
        """Return all that was counted, by reason; an encoder's rejects with its joint's name."""
        found = self.counters + self.assembler.counters
        for encoder in self.encoders:
            for reason, count in dict(encoder.rejects).items():
                found[f'{encoder.layout.joint} rejected: {reason}'] = count
        return found

    def statistics(self, now: float) -> dict[str, object]:
        """Return counters and figures by name; `now` in s since the epoch."""
        assembler = self.assembler
        found: dict[str, object] = dict(self.tally())
        if assembler.skew.count:
            found['skew p50 / p99 / max (us)'] = _three(assembler.skew)
        if assembler.jitter.count:
            name = 'cycle' if self.sync_id is None else 'SYNC'
            found[f'{name} jitter p50 / p99 / max (us)'] = _three(assembler.jitter)
        for encoder, missed in zip(self.encoders, assembler.missed, strict=True):
            joint = encoder.layout.joint
            found[f'{joint} frame rate (Hz)'] = encoder.frames.rate()
            found[f'{joint} age (ms)'] = \
                'never heard' if encoder.heard is None else 1e3 * (now - encoder.heard)
            found[f'{joint} missed cycles'] = missed
        if self.network:
            found |= self.network.statistics(now)
        return found

    def _encoder(self, index: int, encoder: Encoder, message: can.Message) -> JointSample | None:
        counts = encoder.check(message)
        if counts is None:
            return None
        self.bus_error, self.bus_off = None, False
        return self._gate(self.assembler.answer(
            index, encoder.layout.angle(counts), message.timestamp))

    def _supervise(self, handler: Handler, message: can.Message) -> None:
        if len(message.data) == handler.length:
            handler.take(message)
        else:
            self.counters[f'rejected: {handler.name} of wrong length'] += 1

    def _sync(self, message: can.Message) -> None:
        if self.is_sync(message):
            self.open_cycle(message.timestamp)
        else:
            self.counters['rejected: SYNC of wrong length'] += 1

    def _gate(self, sample: JointSample | None) -> JointSample | None:
        """Hold a set back while an encoder says of itself that something is wrong."""
        if sample is None or self._stopping is None or not self._stopping.emergencies():
            return sample
        self.counters['dropped: emergency'] += 1
        return None


def recent(when: float | None, now: float, span: float) -> bool:
    """Tell whether something happened within `span` s of `now` (a clock set back makes it old)."""
    return when is not None and abs(now - when) < span


def _three(meter: LatencyMeter) -> str:
    return ' / '.join(f'{value:.0f}' for value in meter.percentiles(0.5, 0.99, 1.0) or ())
