# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scan of a bus: frames and nodes received, compared with the configuration."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

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
# Largest relative deviation of an encoder's frame rate from the configured one (unit 1).
RATE_TOLERANCE = 0.05


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

    """

    first: float
    last: float
    count: int = 0
    lengths: Counter[int] = field(default_factory=Counter)

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

    def words(self) -> str:
        """Return state, identity and emergencies in one line."""
        parts = [canopen.state_word(self.state) if self.state is not None else 'no heartbeat']
        if self.boot_ups:
            parts.append(f'booted {self.boot_ups} x')
        if (device := self.objects.get(canopen.DEVICE_TYPE)) is not None:
            profile = device & 0xFFFF
            parts.append(f'device type 0x{device:08X} (CiA {profile}'
                         + (', encoder)' if profile == canopen.ENCODER_PROFILE else ')'))
        names = {canopen.VENDOR_ID: 'vendor', canopen.PRODUCT_CODE: 'product',
                 canopen.REVISION: 'revision', canopen.SERIAL_NUMBER: 'serial'}
        parts += [f'{name} 0x{self.objects[key]:X}' for key, name in names.items()
                  if key in self.objects]
        parts += [f'{words} ({count} x)' for words, count in self.emergencies.items()]
        return ', '.join(parts)


class BusScan:
    """
    Collects the frames received on a bus.

    Attributes
    ----------
    frames : dict
        HeardFrame by (extended, identifier).
    nodes : dict
        HeardNode by node id.
    errors : collections.Counter
        Number of error frames by their words.
    remote : int
        Number of remote frames.
    unsent : collections.Counter
        Number of frames that the interface refused to send, by its error.

    """

    def __init__(self) -> None:
        self.frames: dict[tuple[bool, int], HeardFrame] = {}
        self.nodes: dict[int, HeardNode] = {}
        self.errors: Counter[str] = Counter()
        self.remote = 0
        self.unsent: Counter[str] = Counter()

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
        heard = self.frames.setdefault((message.is_extended_id, identifier),
                                       HeardFrame(message.timestamp, message.timestamp))
        heard.last = message.timestamp
        heard.count += 1
        heard.lengths[len(message.data)] += 1

    def lines(self, layouts: tuple[EncoderLayout, ...], sync_id: int | None) -> list[str]:
        """Return the scan in lines: one for each identifier, node and kind of error."""
        joints = {(layout.extended, layout.can_id): layout.joint for layout in layouts}
        found = []
        for (extended, identifier), heard in sorted(self.frames.items()):
            name = 'SYNC' if not extended and identifier == sync_id \
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
        found += [f'  not sent: {count} frames, {words}' for words, count in self.unsent.items()]
        return found

    def problems(self, layouts: tuple[EncoderLayout, ...], sync_id: int | None,
                 node_ids: tuple[int, ...] | None, rate: float, sync_made: bool) -> list[str]:
        """
        Return what is missing, wrong or unexpected, in lines.

        Parameters
        ----------
        layouts : tuple of N EncoderLayout
            Configured layouts of the encoders' frames.
        sync_id : int or None
            Configured identifier of SYNC, None without SYNC.
        node_ids : tuple of N int or None
            Configured CANopen node ids, None if the encoders are not CANopen nodes.
        rate : float
            Configured rate of the sets, Hz.
        sync_made : bool
            Whether SYNC was sent by the scanning program itself: most interfaces do not return
            the frames sent.

        """
        found = [] if self.frames else ['no frames at all: check bit rate, termination, power, '
                                        'and that the interface is up']
        if sync_id is not None and not sync_made and (False, sync_id) not in self.frames:
            found.append(f'no SYNC 0x{sync_id:X}: let the driver make it (can.sync: produce), or '
                         'start its master')
        for index, layout in enumerate(layouts):
            node_id = node_ids[index] if node_ids else None
            found += self._encoder_problems(layout, node_id, rate)
        found += self._unexpected(layouts, sync_id, node_ids)
        found += [f'error frames: {words}' for words in self.errors]
        found += [f'sending: {words} (does any other node acknowledge?)' for words in self.unsent]
        return found

    def _encoder_problems(self, layout: EncoderLayout, node_id: int | None,
                          rate: float) -> list[str]:
        node = None if node_id is None else self.nodes.get(node_id)
        heard = self.frames.get((layout.extended, layout.can_id))
        if heard is None:
            reason = 'missing'
            if (not layout.extended, layout.can_id) in self.frames:
                reason += f'; it comes with {11 if layout.extended else 29} bits instead'
            elif node is not None:
                others = sorted(identifier for extended, identifier in self.frames
                                if not extended and identifier & 0x7F == node_id
                                and NODE_FRAMES.get(identifier & ~0x7F, '').startswith('TPDO'))
                if others:
                    reason += '; its node sends on ' + ', '.join(f'0x{i:X}' for i in others)
                elif node.state not in (None, canopen.OPERATIONAL):
                    reason += f'; its node {node_id} is {canopen.state_word(node.state)}'
                else:
                    reason += f'; its node {node_id} is present: does 0x1800:02 answer SYNC?'
            elif node_id is not None:
                reason += f'; its node {node_id} was not heard either'
            return [f'{layout.joint}: 0x{layout.can_id:X} {reason}']
        found = []
        if set(heard.lengths) != {layout.data_length}:
            lengths = ', '.join(str(length) for length in sorted(heard.lengths))
            found.append(f'{layout.joint}: 0x{layout.can_id:X} has {lengths} bytes, '
                         f'configured {layout.data_length}')
        if abs(heard.rate / rate - 1.0) > RATE_TOLERANCE:
            found.append(f'{layout.joint}: 0x{layout.can_id:X} comes at {heard.rate:.1f} Hz, '
                         f'configured {rate:g} Hz')
        if node is not None:
            found += [f'{layout.joint}: {words}' for words in node.emergencies]
        return found

    def _unexpected(self, layouts: tuple[EncoderLayout, ...], sync_id: int | None,
                    node_ids: tuple[int, ...] | None) -> list[str]:
        ours = {(layout.extended, layout.can_id) for layout in layouts}
        ours |= {(False, canopen.NMT_ID), *(() if sync_id is None else ((False, sync_id),))}
        # Heartbeats, emergencies and SDO answers are listed with their nodes.
        ours |= {(False, base + node_id) for node_id in self.nodes
                 for base, name in NODE_FRAMES.items() if not name.startswith('TPDO')}
        found = [f'unexpected: 0x{key[1]:X} ({frame_name(*key)})'
                 for key in sorted(self.frames.keys() - ours)]
        if node_ids is not None:
            found += [f'unexpected: node {node_id} ({self.nodes[node_id].words()})'
                      for node_id in sorted(self.nodes.keys() - set(node_ids))]
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
