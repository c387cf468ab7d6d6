# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The encoders as CANopen nodes: NMT states, heartbeats, boot-ups and emergencies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import can
from spm_haptic_master.encoders import canopen

# Base identifiers of the frames that show that a node is on the bus.
SHOWING = (*canopen.TPDO_BASES, canopen.HEARTBEAT_BASE)
# Time between two NMT starts to a silent node (s): its boot-up message may have been lost.
START_AGAIN = 0.5


class Handler(NamedTuple):
    """Handler of the frames with one identifier."""

    name: str  # kind of frame, with its joint
    length: int  # of the data, bytes
    take: Callable[[can.Message], None]


@dataclass(slots=True, eq=False)
class Node:
    """State of one node, from its own messages."""

    joint: str
    node_id: int
    # NMT state by the latest heartbeat or boot-up message, None before the first.
    state: int | None = None
    # Time of the latest heartbeat, s; None before the first and after a boot-up, since CiA 301
    # supervises a heartbeat from the first one on.
    heard: float | None = None
    # Latest emergency in words, None if there is none or it was reset.
    emergency: str | None = None
    boot_ups: int = 0
    emergencies: int = 0
    started_at: float = float('-inf')  # time of the latest NMT start, s


class CanopenNodes:
    """
    Supervisor of the nodes: their states, and which of them need an NMT start.

    A heartbeat is lost `heartbeat_timeout` s after the one before.
    """

    def __init__(self, joints: tuple[str, ...], node_ids: tuple[int, ...],
                 heartbeat_timeout: float):
        self.nodes = tuple(map(Node, joints, node_ids))
        self._timeout = heartbeat_timeout
        self._booted: list[Node] = []
        # Other nodes on the bus.
        self._others: set[int] = set()

    def handlers(self) -> dict[int, Handler]:
        """Return the handler of each heartbeat and EMCY by identifier."""
        found = {}
        for node in self.nodes:
            found[canopen.HEARTBEAT_BASE + node.node_id] = Handler(
                f'{node.joint} heartbeat', canopen.HEARTBEAT_LENGTH,
                partial(self._heartbeat, node))
            found[canopen.EMCY_BASE + node.node_id] = Handler(
                f'{node.joint} EMCY', canopen.EMCY_LENGTH, partial(self._emergency, node))
        return found

    def to_start(self, now: float, silent: tuple[int, ...]) -> list[Node]:
        """
        Return the nodes that need an NMT start now: those that booted, and silent joints'.

        `now`, s, is on the clock of the frames' stamps.
        """
        due = [node for node in self.nodes if node in self._booted]
        self._booted.clear()
        for index in silent:
            node = self.nodes[index]
            if node not in due and not 0.0 <= now - node.started_at < START_AGAIN:
                due.append(node)
        for node in due:
            node.started_at = now
        return due

    @property
    def booted(self) -> bool:
        """Whether a node has booted and not been started since."""
        return bool(self._booted)

    def trouble(self, index: int, now: float) -> str | None:
        """Return the reason why a joint's node does not answer, None if it is unknown."""
        node = self.nodes[index]
        if emergency := node.emergency:
            return emergency
        if self._lost(node.heard, now):
            return 'heartbeat lost'
        state = node.state
        return None if state in (None, canopen.OPERATIONAL) else canopen.state_word(state)

    def note_other(self, identifier: int) -> None:
        """Note a frame that no encoder is configured to send: a node with another id may."""
        node_id = identifier & 0x7F
        if node_id and identifier - node_id in SHOWING:
            self._others.add(node_id)

    def others_text(self) -> str:
        """Return in words that other nodes are on the bus; empty if there are none."""
        others = sorted(self._others.difference(node.node_id for node in self.nodes))
        if not others:
            return ''
        return (f'; on the bus, and not in encoders.node_id: {", ".join(map(str, others))} '
                '(can_scan prints the lines for rig.yaml)')

    def emergencies(self) -> dict[int, str]:
        """Return the emergencies in words, by index of the joint."""
        return {index: emergency for index, node in enumerate(self.nodes)
                if (emergency := node.emergency)}

    def down(self) -> list[int]:
        """Return the joints of the nodes that are not operational by their latest message."""
        return [index for index, node in enumerate(self.nodes)
                if node.state not in (None, canopen.OPERATIONAL)]

    def cautions(self, now: float) -> dict[int, str]:
        """Return the emergencies and lost heartbeats of nodes that may answer, by index."""
        return {index: emergency or 'heartbeat lost' for index, node in enumerate(self.nodes)
                if (emergency := node.emergency) or self._lost(node.heard, now)}

    def unfit(self, now: float) -> dict[int, str]:
        """
        Return why answers of a node are no readings, by index of the joint.

        These are the cautions, and an NMT state that no answer comes from. That state is the
        latest heartbeat's, unless the node was started since; a boot-up message comes before a
        start.
        """
        return self.cautions(now) | {
            index: canopen.state_word(node.state) for index, node in enumerate(self.nodes)
            if node.state not in (None, canopen.OPERATIONAL)
            and node.heard is not None and node.heard > node.started_at}

    def statistics(self, now: float) -> dict[str, object]:
        """Return each node's state for diagnostics."""
        found: dict[str, object] = {}
        for node in self.nodes:
            number, heard = node.state, node.heard
            state = 'unknown' if number is None else canopen.state_word(number)
            if heard is None:
                heartbeat = 'no heartbeat yet'
            else:
                heartbeat = f'heartbeat {1e3 * (now - heard):.0f} ms ago'
                if self._lost(heard, now):
                    heartbeat += ' (lost)'
            found[f'{node.joint} node {node.node_id}'] = f'{state}, {heartbeat}'
            found[f'{node.joint} boot-ups'] = node.boot_ups
            found[f'{node.joint} EMCY'] = \
                f'{node.emergency or "none"} ({node.emergencies} messages)'
        return found

    def _lost(self, heard: float | None, now: float) -> bool:
        return heard is not None and now - heard > self._timeout

    def _heartbeat(self, node: Node, message: can.Message) -> None:
        # Bit 7 is reserved; in the older node guarding it is the toggle bit.
        node.state = message.data[0] & 0x7F
        if node.state == canopen.BOOT_UP:
            node.boot_ups += 1
            node.heard = None
            node.emergency = None
            # A recording and a listener to the bus start no node: each is listed once.
            if node not in self._booted:
                self._booted.append(node)
        else:
            node.heard = message.timestamp

    def _emergency(self, node: Node, message: can.Message) -> None:
        node.emergencies += 1
        reset = canopen.emcy_code(message.data) == canopen.EMCY_ERROR_RESET
        node.emergency = None if reset else canopen.emcy_words(message.data)
