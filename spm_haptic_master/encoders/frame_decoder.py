# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Decoder of frames into sets, shared by the live bus and recordings.

The kind of a frame is checked before its identifier: the identifier of an error frame is a set of
error bits and may equal an encoder's, and so may a 29-bit one.
"""

from __future__ import annotations

from collections import Counter
from math import nan

import can
from spm_haptic_master.encoders import canopen, error_frames
from spm_haptic_master.encoders.canopen_nodes import CanopenNodes, Handler
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.encoders.set_assembler import BEHIND, LEAST_READINGS, SetAssembler
from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.encoders.sync_rate import SyncRate
from spm_haptic_master.joints import NUMBER_WORDS
from spm_haptic_master.timing import LatencyMeter, RateMeter

# Reasons for rejecting a frame that is an answer without a reading.
STATUS_ERROR = 'status bits report an error'
UNCHANGED = 'rolling counter unchanged'
# Cure where the encoders send although nobody makes SYNC.
WITHOUT_SYNC = 'the encoders send without SYNC: give -p encoders.sync_id:=0'
# Time for which a surplus answer or a rejected frame is reported (s): a period of /diagnostics at
# least.
CAUTION_HOLD = 2.0
# Time between two checks of the nodes' heartbeats (s): short against a heartbeat's time-out.
NODES_PERIOD = 0.01
# Bit that marks the key of a 29-bit identifier, above all of the identifier's bits.
EXTENDED = 1 << 29


class Encoder:
    """
    Frames of one encoder: their checks and counters.

    Parameters
    ----------
    layout : EncoderLayout
        Layout of its frame.

    Attributes
    ----------
    layout : EncoderLayout
        As given.
    heard : float or None
        Time of the latest good frame, s since the Unix epoch; None before the first.
    refused : tuple of (float, str) or None
        Time, s since the Unix epoch, and reason of the latest rejection; None before the first.
    rejects : collections.Counter
        Number of rejected frames by reason.
    frames : RateMeter
        Rate of good frames, Hz.
    lost : int or None
        Numbers that the rolling counter left out before the latest good frame; None without one.

    """

    def __init__(self, layout: EncoderLayout):
        self.layout = layout
        self.heard: float | None = None
        self.refused: tuple[float, str] | None = None
        self.rejects: Counter[str] = Counter()
        self.frames = RateMeter()
        self.lost: int | None = None
        self._counter: int | None = None

    def check(self, message: can.Message) -> int | None:
        """Return the counts in a frame of this encoder, None if the frame is rejected."""
        layout, data = self.layout, message.data
        if len(data) != layout.data_length:
            self.reject(message, f'{len(data)} bytes instead of {layout.data_length}')
            return None
        counts = layout.counts(data)
        if counts is None:
            self.reject(message, 'counts beyond a turn')
            return None
        counter = layout.counter(data)
        if counter is not None:
            before, self._counter = self._counter, counter
            self.lost = None
            if counter == before:
                self.reject(message, UNCHANGED)
                return None
            if before is not None:
                self.lost = (counter - before - 1) % layout.counter_modulus
                if self.lost:
                    self.rejects['rolling counter jumped (frame kept)'] += 1
        if not layout.healthy(data):
            self.reject(message, STATUS_ERROR)
            return None
        self.heard = message.timestamp
        self.frames.count += 1
        return counts

    def restart(self) -> None:
        """Take the next value of the rolling counter as the first one."""
        self._counter = None

    def reject(self, message: can.Message, reason: str) -> None:
        """Count a rejected frame."""
        self.rejects[reason] += 1
        self.refused = message.timestamp, reason


class FrameDecoder:
    """
    Distributes frames, by identifier, to the assembler and the CANopen nodes.

    Parameters
    ----------
    layouts : tuple of N EncoderLayout
        Layouts of the encoders' frames, in the order of ALL_JOINT_NAMES; N is 4, 5 or 6.
    sync_id : int or None
        11-bit identifier of SYNC, None without SYNC.
    assembler : SetAssembler
        Assembler of the sets.
    network : CanopenNodes or None
        Encoders as CANopen nodes, None if they are not.
    emcy_stops : bool
        Whether four encoders give no set while one of them reports an emergency. Of five or six,
        one with an emergency, a lost heartbeat or a wrong NMT state has no reading.
    sync_rate : SyncRate, optional
        Compares the rate of SYNC with the configured one.

    Attributes
    ----------
    counters : collections.Counter
        Number of frames, and of rejected ones by reason.
    encoders : tuple of N Encoder
        Encoders, in the order of the layouts.
    bus_error : str or None
        Latest error frame in words, None after a good encoder frame.
    bus_off : bool
        Whether the controller reported bus-off, and no good encoder frame came since.
    sync_heard : float or None
        Time of the latest SYNC, s since the Unix epoch; None before the first.

    """

    def __init__(self, layouts: tuple[EncoderLayout, ...], sync_id: int | None,
                 assembler: SetAssembler, network: CanopenNodes | None, emcy_stops: bool,
                 sync_rate: SyncRate | None = None):
        self.encoders = tuple(map(Encoder, layouts))
        self.sync_id = sync_id
        self.assembler = assembler
        self.network = network
        self.counters: Counter[str] = Counter()
        self.bus_error: str | None = None
        self.bus_off = False
        self.sync_heard: float | None = None
        self._sync_rate = sync_rate
        self._by_key = {
            encoder.layout.can_id | EXTENDED * encoder.layout.extended: (index, encoder)
            for index, encoder in enumerate(self.encoders)}
        self._may_spare = len(layouts) > LEAST_READINGS
        self._emcy_stops = emcy_stops
        # Reasons why nodes have no reading, by index; and when that was checked, s.
        self._excluded: dict[int, str] = {}
        self._checked_at = float('-inf')
        self._network_frames: dict[int, Handler] = network.handlers() if network else {}

    @property
    def words(self) -> str:
        """Return the encoders in words, such as 'four encoders'."""
        return f'{NUMBER_WORDS[len(self.encoders)]} encoders'

    @property
    def sends_without_sync(self) -> bool:
        """Whether frames of the encoders came, and no SYNC although one is expected."""
        return self.sync_id is not None and self.sync_heard is None \
            and any(encoder.heard is not None for encoder in self.encoders)

    def reset(self) -> None:
        """Discard the open cycle."""
        self.assembler.reset()

    def feed(self, message: can.Message) -> JointSample | None:
        """Decode a frame, stamped in s since the Unix epoch; return the set that goes out now."""
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
        key = message.arbitration_id | EXTENDED * message.is_extended_id
        if key in self._by_key:
            return self._encoder(*self._by_key[key], message)
        if key == self.sync_id:
            return self._sync(message)
        if key in self._network_frames:
            self._supervise(self._network_frames[key], message)
        elif key ^ EXTENDED in self._by_key:
            self._by_key[key ^ EXTENDED][1].reject(message, 'identifier width')
        else:
            self.counters['rejected: foreign identifier'] += 1
            if self.network:
                self.network.note_other(key)
        return None

    def is_sync(self, message: can.Message) -> bool:
        """Return whether a frame is a valid SYNC."""
        return message.arbitration_id == self.sync_id and not (
            message.is_error_frame or message.is_remote_frame or message.is_fd
            or message.is_extended_id or len(message.data) > canopen.SYNC_MAXIMUM_LENGTH)

    def open_cycle(self, stamp: float) -> JointSample | None:
        """Open a cycle at its SYNC's time, s since the Unix epoch; return as `feed` does."""
        self.sync_heard = stamp
        self._check_nodes(stamp)
        return self.assembler.begin(stamp)

    def silent(self, now: float, timeout: float) -> tuple[int, ...]:
        """Return the indices of the joints without a good frame in the last `timeout` s."""
        return tuple(index for index, encoder in enumerate(self.encoders)
                     if not recent(encoder.heard, now, timeout))

    def explain(self, silent: tuple[int, ...], now: float, timeout: float) -> str | None:
        """Return the reason why no sets come, by silent joint or cycle; None if it is unknown."""
        troubles = {self.encoders[index].layout.joint: self._trouble(index, now, timeout)
                    for index in silent}
        if not troubles:
            return self.assembler.cause
        others = self.network.others_text() \
            if self.network and 'no frames' in troubles.values() else ''
        if len(troubles) == len(self.encoders) and len(set(troubles.values())) == 1:
            return f'all encoders silent ({next(iter(troubles.values()))}){others}'
        return '; '.join(f'{joint} silent ({trouble})'
                         for joint, trouble in troubles.items()) + others

    def _trouble(self, index: int, now: float, timeout: float) -> str:
        """Return the reason why a joint is silent."""
        refused = self.encoders[index].refused
        if refused and recent(refused[0], now, timeout):
            return f'frames rejected, {refused[1]}'
        return (self.network and self.network.trouble(index, now)) or 'no frames'

    def caution(self, now: float) -> str | None:
        """
        Return the problems of encoders although sets come, or None; `now` in s (Unix epoch).

        These are joints without a reading, emergencies, lost heartbeats, surplus answers and
        another rate of SYNC.
        """
        reasons = self.network.cautions(now) if self.network else {}
        # Read once: another thread changes them.
        excluded, late = dict(self._excluded), tuple(self.assembler.late.behind)
        reasons |= excluded | dict.fromkeys(late, BEHIND)
        for index, encoder in enumerate(self.encoders):
            refused = encoder.refused
            if index not in reasons and (
                    index in self.assembler.absent
                    or refused and refused[1] in (STATUS_ERROR, UNCHANGED)
                    and recent(refused[0], now, CAUTION_HOLD)):
                reasons[index] = self._trouble(index, now, CAUTION_HOLD)
        found = [f'{self.encoders[index].layout.joint}: {reasons[index]}'
                 for index in sorted(reasons)]
        if self._sync_rate and recent(self.sync_heard, now, CAUTION_HOLD) \
                and (rate := self._sync_rate.text()):
            found.append(rate)
        surplus = self.assembler.surplus
        if surplus and recent(surplus[0], now, CAUTION_HOLD):
            found.append(surplus[1])
        return '; '.join(found) or None

    def tally(self) -> Counter[str]:
        """
        Return all counters by name; rejects of an encoder begin with its joint.

        Another thread may be counting: each counter is copied in one step of the interpreter.
        """
        found = Counter(dict(self.counters)) + Counter(dict(self.assembler.counters))
        for encoder in self.encoders:
            for reason, count in dict(encoder.rejects).items():
                found[f'{encoder.layout.joint} rejected: {reason}'] = count
        return found

    def statistics(self, now: float) -> dict[str, object]:
        """Return counters and figures by name; `now` in s since the Unix epoch."""
        assembler = self.assembler
        found: dict[str, object] = dict(self.tally())
        if assembler.skew.count:
            found['skew p50 / p99 / max (us)'] = _percentiles(assembler.skew)
        if assembler.jitter.count:
            name = 'cycle' if self.sync_id is None else 'SYNC'
            found[f'{name} jitter p50 / p99 / max (us)'] = _percentiles(assembler.jitter)
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
        counts, stamp = encoder.check(message), message.timestamp
        if counts is None:
            return self._refused(index, encoder, stamp)
        self.bus_error, self.bus_off = None, False
        if self.sync_id is None:
            self._check_nodes(stamp)
        if index in self._excluded:
            return self.assembler.answer(
                index, nan, stamp, encoder.lost,
                f'{encoder.layout.joint}: {self._excluded[index]}')
        return self.assembler.answer(index, encoder.layout.angle(counts), stamp, encoder.lost)

    def _refused(self, index: int, encoder: Encoder, stamp: float) -> JointSample | None:
        """Take a rejected frame, if it is the answer of its cycle: there is none to wait for."""
        # The frame was rejected: there is a reason.
        _, reason = encoder.refused  # type: ignore[misc]
        if reason not in (STATUS_ERROR, UNCHANGED) \
                or reason == UNCHANGED and self.assembler.has_answered(index):
            return None
        return self.assembler.answer(
            index, nan, stamp, encoder.lost, f'{encoder.layout.joint}: {reason}')

    def _check_nodes(self, now: float) -> None:
        """Find, now and then, the nodes that have no reading although they answer."""
        network = self.network
        if network is None or abs(now - self._checked_at) <= NODES_PERIOD:
            return
        self._checked_at = now
        self._excluded = network.unfit(now) if self._may_spare \
            else network.emergencies() if self._emcy_stops else {}

    def _supervise(self, handler: Handler, message: can.Message) -> None:
        if len(message.data) == handler.length:
            handler.take(message)
            self._checked_at = float('-inf')
            self._check_nodes(message.timestamp)
            for index in self.network.down() if self.network else ():
                self.encoders[index].restart()
        else:
            self.counters[f'rejected: {handler.name} of wrong length'] += 1

    def _sync(self, message: can.Message) -> JointSample | None:
        if self.is_sync(message):
            if self._sync_rate:
                self._sync_rate.heard(message.timestamp)
            return self.open_cycle(message.timestamp)
        self.counters['rejected: SYNC of wrong length'] += 1
        return None


def recent(when: float | None, now: float, span: float) -> bool:
    """Return whether `when` is within `span` s of `now`; after a clock was set back it is not."""
    return when is not None and abs(now - when) < span


def _percentiles(meter: LatencyMeter) -> str:
    return ' / '.join(f'{value:.0f}' for value in meter.percentiles(0.5, 0.99, 1.0) or ())
