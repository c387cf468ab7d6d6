# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scan of a bus: the frames and nodes heard, in lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median
from types import MappingProxyType

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_errors import error_words
from spm_haptic_master.encoders.encoder_layout import EncoderLayout


@dataclass(slots=True)
class HeardFrame:
    """Frames received with one identifier."""

    first: float  # receive time of the first, s
    last: float  # receive time of the latest, s
    count: int = 0
    # Number of frames by data length, bytes.
    lengths: Counter[int] = field(default_factory=Counter)
    # Numbers of SYNCs before the first and before the latest.
    first_cycle: int = 0
    last_cycle: int = 0

    @property
    def rate(self) -> float:
        """Mean rate from the first to the latest frame, Hz."""
        return (self.count - 1) / (self.last - self.first) if self.last > self.first else 0.0


@dataclass(slots=True)
class HeardNode:
    """State and identity of a CANopen node, from its own messages."""

    state: int | None = None  # NMT state by its latest heartbeat
    boot_ups: int = 0
    # Number of EMCY messages by their words.
    emergencies: Counter[str] = field(default_factory=Counter)
    # Values read by SDO, by index and subindex.
    objects: dict[tuple[int, int], int] = field(default_factory=dict)

    @property
    def profile(self) -> int | None:
        """Return the number of its CiA device profile, None if it is not known."""
        device = self.objects.get(canopen.DEVICE_TYPE)
        return None if device is None else device & 0xFFFF

    def words(self) -> str:
        """Return state, identity and emergencies in one line."""
        parts = [canopen.state_word(self.state) if self.state is not None else 'no heartbeat']
        if self.boot_ups:
            parts.append(f'booted {self.boot_ups} x')
        for key, name in canopen.IDENTITY.items():
            if (value := self.objects.get(key)) is None:
                continue
            if key == canopen.DEVICE_TYPE:
                kind = {canopen.ENCODER_PROFILE: ', encoder', canopen.DRIVE_PROFILE: ', drive'}
                parts.append(f'{name} 0x{value:08X} (CiA {value & 0xFFFF}'
                             f'{kind.get(value & 0xFFFF, "")})')
            else:
                parts.append(f'{name} 0x{value:X}')
        parts += [f'{words} ({count} x)' for words, count in self.emergencies.items()]
        return ', '.join(parts)


class BusScan:
    """Collects the frames received on a bus, but for those of the scanning program itself."""

    def __init__(self, sync_id: int | None = canopen.SYNC_ID) -> None:
        self.sync_id = sync_id
        # By (extended, identifier), and by node id.
        self.frames: dict[tuple[bool, int], HeardFrame] = {}
        self.nodes: dict[int, HeardNode] = {}
        # Number of error frames by their words, and of remote frames.
        self.errors: Counter[str] = Counter()
        self.remote = 0
        # SYNCs that the scanning program sent, nodes that it started, and number of frames that
        # the interface refused to send, by its error.
        self.own_sync: HeardFrame | None = None
        self.started: set[int] = set()
        self.unsent: Counter[str] = Counter()
        # Number of SYNCs, of a master and own, and times between a master's, s.
        self._cycles = 0
        self._sync_intervals: list[float] = []

    @property
    def master_sync(self) -> HeardFrame | None:
        """Return the SYNCs of a master on the bus, None if there is none."""
        return None if self.sync_id is None else self.frames.get((False, self.sync_id))

    @property
    def master_rate(self) -> float:
        """
        Rate that the master of SYNC is set to, Hz; 0 before it is known.

        Of a busy machine some SYNCs are lost or late: each time between two counts as the number
        of typical times that it is nearest to.
        """
        typical = median(self._sync_intervals) if self._sync_intervals else 0.0
        if typical <= 0.0:
            return 0.0
        cycles = sum(round(each / typical) for each in self._sync_intervals)
        return cycles / sum(self._sync_intervals)

    def sent_sync(self, now: float) -> None:
        """Record a SYNC that the scanning program sent at `now`, s."""
        if self.own_sync is None:
            self.own_sync = HeardFrame(now, now)
        self.own_sync.last = now
        self.own_sync.count += 1
        self._cycles += 1

    def feed(self, message: can.Message) -> None:
        """Record a frame."""
        if message.is_error_frame:
            self.errors[error_words(message)] += 1
            return
        if message.is_remote_frame:
            self.remote += 1
            return
        identifier, now = message.arbitration_id, message.timestamp
        if not message.is_extended_id:
            base = identifier & ~0x7F
            self._node_frame(base, identifier & 0x7F, message.data)
            if base in (canopen.SDO_ANSWER_BASE, canopen.SDO_REQUEST_BASE):
                return  # mostly caused by this scan; the answers are listed with the nodes
            if identifier == self.sync_id:
                self._cycles += 1
                if (before := self.master_sync) is not None:
                    self._sync_intervals.append(now - before.last)
        heard = self.frames.setdefault((message.is_extended_id, identifier),
                                       HeardFrame(now, now, first_cycle=self._cycles))
        heard.last, heard.last_cycle = now, self._cycles
        heard.count += 1
        heard.lengths[len(message.data)] += 1

    def lines(self, layouts: tuple[EncoderLayout, ...],
              others: Mapping[int, str] = MappingProxyType({})) -> list[str]:
        """
        Return the scan in lines: one for each identifier, node and kind of error.

        `others` are names of frames that are not of the encoders, by identifier.
        """
        joints = {(layout.extended, layout.can_id): layout.joint for layout in layouts} \
            | {(False, identifier): name for identifier, name in others.items()}
        found = []
        for (extended, identifier), heard in sorted(self.frames.items()):
            name = 'SYNC' if not extended and identifier == self.sync_id \
                else joints.get((extended, identifier)) or frame_name(extended, identifier)
            lengths = '/'.join(str(length) for length in sorted(heard.lengths))
            width = 8 if extended else 3
            found.append(f'  0x{identifier:0{width}X}  {heard.rate:8.1f} Hz  {lengths:>3} bytes  '
                         f'{heard.count:7} frames  {name}')
        found += [f'  node {node_id:3}: {node.words()}'
                  for node_id, node in sorted(self.nodes.items())]
        found += [f'  error frames: {count} x {words}' for words, count in self.errors.items()]
        if self.remote:
            found.append(f'  remote frames: {self.remote}')
        if self.own_sync is not None:
            found.append(f'  sent from here: {self.own_sync.count} x SYNC 0x{self.sync_id:X}, '
                         f'{self.own_sync.rate:.1f} Hz')
        if self.started:
            found.append('  sent from here: NMT start to node '
                         + ', '.join(map(str, sorted(self.started))))
        found += [f'  not sent: {count} frames, {words}' for words, count in self.unsent.items()]
        return found

    def _node_frame(self, base: int, node_id: int, data: bytes | bytearray) -> None:
        if node_id == 0:
            return
        if base == canopen.HEARTBEAT_BASE and len(data) == canopen.HEARTBEAT_LENGTH:
            node = self.nodes.setdefault(node_id, HeardNode())
            node.state = data[0] & 0x7F
            node.boot_ups += node.state == canopen.BOOT_UP
        elif base == canopen.EMCY_BASE and len(data) == canopen.EMCY_LENGTH:
            node = self.nodes.setdefault(node_id, HeardNode())
            node.emergencies[canopen.emcy_words(data)] += 1
        elif base == canopen.SDO_ANSWER_BASE and len(data) == canopen.SDO_LENGTH:
            node = self.nodes.setdefault(node_id, HeardNode())
            value = canopen.sdo_value(data)
            if value is not None:
                node.objects[canopen.sdo_object(data)] = value


def frame_name(extended: bool, identifier: int) -> str:
    """Return the name of an identifier in CANopen's predefined connection set."""
    if extended:
        return '29-bit frame'
    return canopen.frame_name(identifier) or 'foreign'
