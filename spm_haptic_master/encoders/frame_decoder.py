# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Decoder of frames into sets, shared by the live bus and recordings.

The kind of a frame is checked before its identifier: the identifier of an error frame is a set of
error bits and may equal an encoder's, and so may a 29-bit one.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from math import nan

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.can_bus import BUS_OFF, error_words
from spm_haptic_master.encoders.canopen_nodes import CanopenNodes, Node
from spm_haptic_master.encoders.encoder_layout import (
    Encoder,
    EncoderLayout,
    STATUS_ERROR,
    UNCHANGED,
)
from spm_haptic_master.encoders.set_assembler import BEHIND, SetAssembler
from spm_haptic_master.encoders.single_axis import AxisReading, SingleAxis
from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.encoders.sync import percentiles_text, SyncRate
from spm_haptic_master.kinematics.joints import NUMBER_WORDS

# Remedy where the encoders send without a producer of SYNC.
WITHOUT_SYNC = 'the encoders send without SYNC: give -p encoders.sync_id:=0'
# Time for which a surplus answer or a rejected frame is reported (s): a period of /diagnostics at
# least.
CAUTION_HOLD = 2.0
# Readings of axes that are kept for a reader that is late.
READINGS_KEPT = 1000
# Takes a frame, stamped in s since the Unix epoch; returns the set that goes out with it.
Taker = Callable[[can.Message], JointSample | None]
# Bit that marks the key of a 29-bit identifier, above all of the identifier's bits.
EXTENDED = 1 << 29


def recent(
    when: float | None,
    now: float,
    span: float,
) -> bool:
    """Return whether `when` is within `span` s of `now`; after a clock was set back it is not."""
    return when is not None and abs(now - when) < span


class FrameDecoder:
    """
    Distributes frames, by identifier, to the assembler, the CANopen nodes and the axes.

    Parameters
    ----------
    layouts : tuple of N EncoderLayout
        Four, five or six encoders, in the order of ALL_JOINT_NAMES.
    sync_id : int or None
        Identifier of SYNC; None where there is none.
    period : float
        Nominal time from cycle to cycle, s.
    window : float
        As of SetAssembler, s.
    network : CanopenNodes or None
        Nodes of the encoders; None if they are no CANopen nodes.
    emcy_stops : bool
        Whether an encoder that reports an error, whose heartbeat is lost or whose NMT state is
        wrong has no reading: of four encoders there is then no set.
    axes : tuple of SingleAxis
        Encoders beside the set.

    Attributes
    ----------
    encoders : tuple of N Encoder
        Checks and counters of each encoder.
    words : str
        The number of encoders in words, for texts.
    assembler : SetAssembler
        What makes sets of the answers.
    counters : Counter of str
        Number of frames, and of rejected ones by reason.
    bus_error : str or None
        Latest error frame in words; a good answer ends it.
    bus_off : bool
        Whether an error frame reported bus-off; a good answer ends it.
    sync_heard : float or None
        Time of the latest SYNC, s since the Unix epoch; None before the first.
    readings : deque of AxisReading
        Readings of the axes that nobody has taken yet.

    """

    def __init__(
        self,
        layouts: tuple[EncoderLayout, ...],
        sync_id: int | None,
        period: float,
        window: float,
        network: CanopenNodes | None,
        emcy_stops: bool,
        axes: tuple[SingleAxis, ...] = (),
    ):
        self.layouts = layouts
        self.encoders = tuple(map(Encoder, layouts))
        self.words = f'{NUMBER_WORDS[len(layouts)]} encoders'
        self.sync_id = sync_id
        self.assembler = SetAssembler(
            joints=tuple(layout.joint for layout in layouts),
            synchronised=sync_id is not None,
            window=window,
            period=period,
        )
        self.network = network
        self.counters: Counter[str] = Counter()
        self.bus_error: str | None = None
        self.bus_off = False
        self.sync_heard: float | None = None
        self._sync_rate = SyncRate(period)
        self._encoder_by_key = {_key(encoder.layout): encoder for encoder in self.encoders}
        # Encoders beside the set, and their readings that nobody has taken yet.
        self.axes = axes
        self.readings: deque[AxisReading] = deque(maxlen=READINGS_KEPT)
        self._period = period
        self._emcy_stops = emcy_stops
        self._takers = self._make_takers()

    @property
    def sends_without_sync(self) -> bool:
        """Whether frames of the encoders came, and no SYNC although one is expected."""
        if self.sync_id is None or self.sync_heard is not None:
            return False
        return any(encoder.heard is not None for encoder in self.encoders)

    def feed(self, message: can.Message) -> JointSample | None:
        """
        Decode a frame.

        Parameters
        ----------
        message : can.Message
            Frame of any kind, stamped in s since the Unix epoch.

        Returns
        -------
        JointSample or None
            The set that goes out with this frame, if there is one.

        """
        self.counters['frames'] += 1
        if kind := _other_kind(message):
            self.counters[f'rejected: {kind}'] += 1
            if message.is_error_frame:
                self.bus_error = error_words(message)
                self.bus_off |= bool(message.arbitration_id & BUS_OFF)
            return None
        key = message.arbitration_id | EXTENDED * message.is_extended_id
        take = self._takers.get(key)
        if take is not None:
            return take(message)
        if key ^ EXTENDED in self._encoder_by_key:
            self._encoder_by_key[key ^ EXTENDED].reject(message, 'identifier width')
            return None
        self.counters['rejected: foreign identifier'] += 1
        if self.network:
            self.network.note_other(key)
        return None

    def _make_takers(self) -> dict[int, Taker]:
        """Return what takes a frame, by its key: an encoder before SYNC, axes and nodes."""
        takers: dict[int, Taker] = {}
        if self.network is not None:
            takers |= dict.fromkeys(self.network.senders, self._take_node)
        for axis in self.axes:
            takers[_key(axis.layout)] = partial(self._take_axis, axis)
        if self.sync_id is not None:
            takers[self.sync_id] = self._begin
        for index, encoder in enumerate(self.encoders):
            takers[_key(encoder.layout)] = partial(self._answer, index, encoder)
        return takers

    def _begin(self, message: can.Message) -> JointSample | None:
        """Take a SYNC; return the set of the cycle that it ends."""
        if not self.is_sync(message):
            self.counters['rejected: SYNC of wrong length'] += 1
            return None
        self.sync_heard = message.timestamp
        self._sync_rate.heard(message.timestamp)
        return self.assembler.begin(message.timestamp)

    def _take_node(self, message: can.Message) -> None:
        """Take the frame of a node; the counters of nodes that are down restart."""
        if self.network is None:
            return
        if wrong := self.network.take(message):
            self.counters[f'rejected: {wrong} of wrong length'] += 1
            return
        for index in self.network.by_joint(Node.down):
            self.encoders[index].restart()

    def _take_axis(self, axis: SingleAxis, message: can.Message) -> None:
        """Take the frame of an axis, which is sampled at the SYNC before it."""
        stamp = message.timestamp
        if self.sync_heard is not None and 0.0 <= stamp - self.sync_heard < self._period:
            stamp = self.sync_heard
        if (reading := axis.take(message, stamp)) is not None:
            self.readings.append(reading)

    def silent_nodes(self, now: float, timeout: float) -> tuple[int, ...]:
        """Return the places of the silent nodes, joints and axes, in CanopenNodes.every."""
        found = list(self.silent(now, timeout))
        nodes = [axis for axis in self.axes if axis.node is not None]
        for place, axis in enumerate(nodes):
            if not recent(axis.encoder.heard, now, timeout):
                found.append(len(self.encoders) + place)
        return tuple(found)

    def is_sync(self, message: can.Message) -> bool:
        """Return whether a frame is a valid SYNC."""
        return message.arbitration_id == self.sync_id and not (
            _other_kind(message)
            or message.is_extended_id
            or len(message.data) > canopen.SYNC_MAXIMUM_LENGTH
        )

    def silent(self, now: float, timeout: float) -> tuple[int, ...]:
        """Return the indices of the joints without a good frame in the last `timeout` s."""
        found = []
        for index, encoder in enumerate(self.encoders):
            if not recent(encoder.heard, now, timeout):
                found.append(index)
        return tuple(found)

    def explain(self, now: float, timeout: float) -> str | None:
        """
        Return the reason why no sets come.

        Parameters
        ----------
        now : float
            Time, s since the Unix epoch.
        timeout : float
            Time without a good frame after which a joint is silent, s.

        Returns
        -------
        str or None
            The reason, by silent joint or of the latest cycle; None if it is unknown.

        """
        troubles = {}
        for index in self.silent(now, timeout):
            joint = self.encoders[index].layout.joint
            troubles[joint] = self._trouble(index, now, timeout)
        if not troubles:
            return self.assembler.cause
        others = ''
        if self.network and 'no frames' in troubles.values():
            others = self.network.others_text()
        kinds = set(troubles.values())
        if len(troubles) == len(self.encoders) and len(kinds) == 1:
            return f'all encoders silent ({kinds.pop()}){others}'
        words = [f'{joint} silent ({trouble})' for joint, trouble in troubles.items()]
        return '; '.join(words) + others

    def caution(self, now: float) -> str | None:
        """
        Return the problems of encoders and SYNC although sets come.

        Parameters
        ----------
        now : float
            Time, s since the Unix epoch.

        Returns
        -------
        str or None
            The problems in words; None without any.

        """
        reasons = self._cautions_by_joint(now)
        found = []
        for index in sorted(reasons):
            joint = self.encoders[index].layout.joint
            found.append(f'{joint}: {reasons[index]}')
        if recent(self.sync_heard, now, CAUTION_HOLD):
            rate = self._sync_rate.text()
            if rate:
                found.append(rate)
        if self.assembler.surplus:
            since, words = self.assembler.surplus
            if recent(since, now, CAUTION_HOLD):
                found.append(words)
        return '; '.join(found) or None

    def _cautions_by_joint(self, now: float) -> dict[int, str]:
        """Return what is wrong with the encoders of joints, by index, at a time, s."""
        reasons: dict[int, str] = {}
        if self.network:
            reasons = self.network.by_joint(lambda node: self._concern(node, now))
        # Copied in one step: another thread changes it.
        for index in tuple(self.assembler.late.behind):
            reasons[index] = BEHIND
        for index in range(len(self.encoders)):
            if index not in reasons and self._is_without_reading(index, now):
                reasons[index] = self._trouble(index, now, CAUTION_HOLD)
        return reasons

    def _is_without_reading(self, index: int, now: float) -> bool:
        """Return whether a joint is silent, or its frames say that they are no readings."""
        if index in self.assembler.absent:
            return True
        refused = self.encoders[index].refused
        if refused is None:
            return False
        refused_at, reason = refused
        return reason in (STATUS_ERROR, UNCHANGED) and recent(refused_at, now, CAUTION_HOLD)

    def tally(self) -> Counter[str]:
        """Return all counters by name; rejects of an encoder begin with its joint."""
        # Another thread may be counting: each counter is copied in one step of the interpreter.
        found = Counter(dict(self.counters)) + Counter(dict(self.assembler.counters))
        for encoder in self.encoders:
            for reason, count in dict(encoder.rejects).items():
                found[f'{encoder.layout.joint} rejected: {reason}'] = count
        return found

    def statistics(self, now: float) -> dict[str, object]:
        """Return counters and figures by name; `now` in s since the Unix epoch."""
        assembler = self.assembler
        found: dict[str, object] = dict(self.tally())
        cycle = 'cycle' if self.sync_id is None else 'SYNC'
        meters = {
            'skew': assembler.skew,
            f'{cycle} jitter': assembler.jitter,
        }
        for name, meter in meters.items():
            text = percentiles_text(meter)
            if text:
                found[f'{name} p50 / p99 / max (us)'] = text
        for encoder, missed in zip(self.encoders, assembler.missed, strict=True):
            joint = encoder.layout.joint
            age: float | str = 'never heard'
            if encoder.heard is not None:
                age = 1e3 * (now - encoder.heard)
            counts: int | str = 'none yet'
            if encoder.counts is not None:
                counts = encoder.counts
            found[f'{joint} frame rate (Hz)'] = encoder.frames.rate()
            found[f'{joint} age (ms)'] = age
            found[f'{joint} counts'] = counts
            found[f'{joint} missed cycles'] = missed
        if self.network:
            for node in self.network.every:
                found |= node.statistics(now)
        return found

    def _trouble(
        self,
        index: int,
        now: float,
        timeout: float,
    ) -> str:
        """Return why a joint is silent: rejected frames, what its node reports, or no frames."""
        refused = self.encoders[index].refused
        if refused and recent(refused[0], now, timeout):
            return f'frames rejected, {refused[1]}'
        trouble = None
        if self.network:
            trouble = self.network.nodes[index].trouble(now)
        return trouble or 'no frames'

    def _answer(
        self,
        index: int,
        encoder: Encoder,
        message: can.Message,
    ) -> JointSample | None:
        """Take an encoder's frame; one without a reading also ends the wait for its answer."""
        stamp = message.timestamp
        angle, reason = encoder.check(message)
        if reason is None:
            self.bus_error = None
            self.bus_off = False
            reason = self._unfit(index, stamp)
        elif (
            reason not in (STATUS_ERROR, UNCHANGED)
            or reason == UNCHANGED
            and self.assembler.has_answered(index)
        ):
            return None
        if reason:
            return self.assembler.answer(
                index, nan, stamp, encoder.lost, f'{encoder.layout.joint}: {reason}'
            )
        return self.assembler.answer(index, angle, stamp, encoder.lost)

    def _unfit(self, index: int, now: float) -> str | None:
        """Return why an answer of a joint's node is not a reading, None if it is one."""
        if self.network is None:
            return None
        if self._emcy_stops:
            return self.network.nodes[index].unfit(now)
        return None

    def _concern(self, node: Node, now: float) -> str | None:
        """Return what is wrong with a node although sets come."""
        return (self._emcy_stops and node.unfit(now)) or node.caution_with_sync(now)


def _key(layout: EncoderLayout) -> int:
    """Return the key of an encoder's frames: their identifier, marked if it has 29 bits."""
    return layout.can_id | EXTENDED * layout.extended


def _other_kind(message: can.Message) -> str | None:
    """Return the kind of a frame, None for a classical data frame."""
    if message.is_error_frame:
        return 'error frame'
    if message.is_remote_frame:
        return 'remote frame'
    return 'CAN FD frame' if message.is_fd else None
