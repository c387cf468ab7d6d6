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
from spm_haptic_master.encoders import canopen, error_frames
from spm_haptic_master.encoders.encoder_layout import EncoderLayout

# Names of the frames that a node sends in the predefined connection set, by base identifier.
NODE_FRAMES = {
    canopen.EMCY_BASE: 'EMCY', 0x180: 'TPDO1', 0x280: 'TPDO2', 0x380: 'TPDO3', 0x480: 'TPDO4',
    canopen.SDO_ANSWER_BASE: 'SDO answer', canopen.HEARTBEAT_BASE: 'heartbeat'}
# Objects that identify a node.
IDENTITY = (canopen.DEVICE_TYPE, canopen.VENDOR_ID, canopen.PRODUCT_CODE, canopen.REVISION,
            canopen.SERIAL_NUMBER)


@dataclass(slots=True)
class HeardFrame:
    """
    Frames received with one identifier.

    Attributes
    ----------
    first : float
        Receive time of the first, s.
    last : float
        Receive time of the latest, s.
    count : int
        Number of frames.
    lengths : collections.Counter
        Number of frames by data length, bytes.
    first_cycle, last_cycle : int
        Number of SYNCs before the first and before the latest.

    """

    first: float
    last: float
    count: int = 0
    lengths: Counter[int] = field(default_factory=Counter)
    first_cycle: int = 0
    last_cycle: int = 0

    @property
    def rate(self) -> float:
        """Mean rate from the first to the latest frame, Hz."""
        return (self.count - 1) / (self.last - self.first) if self.last > self.first else 0.0


@dataclass(slots=True)
class HeardNode:
    """
    State and identity of a CANopen node, from its own messages.

    Attributes
    ----------
    state : int or None
        NMT state by its latest heartbeat, None before the first.
    boot_ups : int
        Number of boot-up messages.
    emergencies : collections.Counter
        Number of EMCY messages by their words.
    objects : dict
        Values read by SDO, by index and subindex.

    """

    state: int | None = None
    boot_ups: int = 0
    emergencies: Counter[str] = field(default_factory=Counter)
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
        if (device := self.objects.get(canopen.DEVICE_TYPE)) is not None:
            parts.append(f'device type 0x{device:08X} (CiA {self.profile}'
                         + {canopen.ENCODER_PROFILE: ', encoder)',
                            canopen.DRIVE_PROFILE: ', drive)'}.get(self.profile or 0, ')'))
        names = {canopen.VENDOR_ID: 'vendor', canopen.PRODUCT_CODE: 'product',
                 canopen.REVISION: 'revision', canopen.SERIAL_NUMBER: 'serial'}
        parts += [f'{name} 0x{self.objects[key]:X}' for key, name in names.items()
                  if key in self.objects]
        parts += [f'{words} ({count} x)' for words, count in self.emergencies.items()]
        return ', '.join(parts)


class BusScan:
    """
    Collects the frames received on a bus, but for those of the scanning program itself.

    Parameters
    ----------
    sync_id : int or None
        Identifier of SYNC, None without SYNC.

    Attributes
    ----------
    sync_id : int or None
        As given.
    frames : dict
        HeardFrame by (extended, identifier).
    nodes : dict
        HeardNode by node id.
    errors : collections.Counter
        Number of error frames by their words.
    remote : int
        Number of remote frames.
    own_sync : HeardFrame or None
        SYNCs that the scanning program sent; None if it sent none.
    started : set of int
        Nodes to which it sent NMT start.
    unsent : collections.Counter
        Number of frames that the interface refused to send, by its error.

    """

    def __init__(self, sync_id: int | None = canopen.SYNC_ID) -> None:
        self.sync_id = sync_id
        self.frames: dict[tuple[bool, int], HeardFrame] = {}
        self.nodes: dict[int, HeardNode] = {}
        self.errors: Counter[str] = Counter()
        self.remote = 0
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
            self.errors[error_frames.error_words(message)] += 1
            return
        if message.is_remote_frame:
            self.remote += 1
            return
        identifier = message.arbitration_id
        if not message.is_extended_id:
            base = identifier & ~0x7F
            self._node_frame(base, identifier & 0x7F, message.data)
            if base in (canopen.SDO_ANSWER_BASE, canopen.SDO_REQUEST_BASE):
                return  # mostly caused by this scan; the answers are listed with the nodes
            if identifier == self.sync_id:
                self._take_sync(message.timestamp)
        heard = self.frames.setdefault(
            (message.is_extended_id, identifier),
            HeardFrame(message.timestamp, message.timestamp, first_cycle=self._cycles))
        heard.last, heard.last_cycle = message.timestamp, self._cycles
        heard.count += 1
        heard.lengths[len(message.data)] += 1

    def _take_sync(self, stamp: float) -> None:
        self._cycles += 1
        if (before := self.master_sync) is not None:
            self._sync_intervals.append(stamp - before.last)

    def lines(self, layouts: tuple[EncoderLayout, ...],
              others: Mapping[int, str] = MappingProxyType({})) -> list[str]:
        """
        Return the scan in lines: one for each identifier, node and kind of error.

        Parameters
        ----------
        layouts : tuple of EncoderLayout
            Layouts of the encoders' frames, which have the names of their joints.
        others : mapping of int to str
            Names of other frames by identifier.

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
        if node_id == 0 or base not in NODE_FRAMES:
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
    if identifier == canopen.NMT_ID:
        return 'NMT'
    if identifier == canopen.SYNC_ID:
        return 'SYNC'
    base, node_id = identifier & ~0x7F, identifier & 0x7F
    if base == canopen.SDO_REQUEST_BASE:
        return f'SDO request to node {node_id}'
    if base in NODE_FRAMES and node_id:
        return f'{NODE_FRAMES[base]} of node {node_id}'
    return 'foreign'
