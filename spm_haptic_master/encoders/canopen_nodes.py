# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The encoders as CANopen nodes: NMT states, heartbeats, boot-ups and emergencies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import can
from spm_haptic_master.encoders import canopen

# Time between two NMT starts to a node (s): its boot-up message may have been lost.
START_AGAIN = 0.5


@dataclass(slots=True, eq=False)
class Node:
    """State of one node, from its own messages. Another thread reads: each value is read once."""

    joint: str
    node_id: int
    timeout: float  # time after which a heartbeat is lost, s
    # NMT state by the latest heartbeat or boot-up message, None before the first.
    state: int | None = None
    # Time of the latest heartbeat, s; None before the first and after a boot-up, since CiA 301
    # supervises a heartbeat from the first one on.
    heard: float | None = None
    # Latest emergency in words, None if there is none or it was reset.
    emergency: str | None = None
    boot_ups: int = 0
    emergencies: int = 0
    # Time of the latest NMT start, s; -inf before the first and after a boot-up.
    started_at: float = float('-inf')

    def down(self) -> str | None:
        """Return the word for its NMT state by its latest message, None if it is operational."""
        state = self.state
        return None if state in (None, canopen.OPERATIONAL) else canopen.state_word(state)

    def caution(self, now: float) -> str | None:
        """Return the emergency or the lost heartbeat of a node that may answer."""
        return self.emergency or ('heartbeat lost' if self._lost(self.heard, now) else None)

    def trouble(self, now: float) -> str | None:
        """Return the reason why it does not answer, None if it is unknown."""
        return self.caution(now) or self.down()

    def unfit(self, now: float) -> str | None:
        """
        Return why its answers are no readings: a caution, or a state that no answer comes from.

        That state is the latest heartbeat's, unless the node was started since; a boot-up message
        comes before a start.
        """
        heard = self.heard
        return (heard is not None and heard > self.started_at and self.down()) or self.caution(now)

    def statistics(self, now: float) -> dict[str, object]:
        """Return its state for diagnostics."""
        state, heard = self.state, self.heard
        words = 'unknown' if state is None else canopen.state_word(state)
        heartbeat = (
            'no heartbeat yet'
            if heard is None
            else f'heartbeat {1e3 * (now - heard):.0f} ms ago'
            + (' (lost)' if self._lost(heard, now) else '')
        )
        return {
            f'{self.joint} node {self.node_id}': f'{words}, {heartbeat}',
            f'{self.joint} boot-ups': self.boot_ups,
            f'{self.joint} EMCY': f'{self.emergency or "none"} ({self.emergencies} messages)',
        }

    def take(self, message: can.Message) -> str | None:
        """Take its heartbeat, boot-up or EMCY message; return what has a wrong length."""
        data = message.data
        if message.arbitration_id < canopen.HEARTBEAT_BASE:
            if len(data) != canopen.EMCY_LENGTH:
                return f'{self.joint} EMCY'
            self.emergencies += 1
            reset = canopen.emcy_code(data) == canopen.EMCY_ERROR_RESET
            self.emergency = None if reset else canopen.emcy_words(data)
            return None
        if len(data) != canopen.HEARTBEAT_LENGTH:
            return f'{self.joint} heartbeat'
        # Bit 7 is reserved; in the older node guarding it is the toggle bit.
        self.state = data[0] & 0x7F
        self.heard = message.timestamp
        if self.state == canopen.BOOT_UP:
            self.boot_ups += 1
            self.heard = self.emergency = None
            self.started_at = float('-inf')
        return None

    def _lost(self, heard: float | None, now: float) -> bool:
        return heard is not None and now - heard > self.timeout


class CanopenNodes:
    """Supervises the nodes; a heartbeat is lost `heartbeat_timeout` s after the one before."""

    def __init__(
        self, joints: tuple[str, ...], node_ids: tuple[int, ...], heartbeat_timeout: float
    ):
        self.nodes = tuple(
            Node(joint, node_id, heartbeat_timeout)
            for joint, node_id in zip(joints, node_ids, strict=True)
        )
        # Node that sends the heartbeats and emergencies with each identifier.
        self.senders = {
            base + node.node_id: node
            for node in self.nodes
            for base in (canopen.HEARTBEAT_BASE, canopen.EMCY_BASE)
        }
        # Other nodes on the bus.
        self._others: set[int] = set()

    def to_start(self, now: float, silent: tuple[int, ...]) -> list[Node]:
        """Return, and note, the nodes of silent joints to start `now`, s, by the frames' clock."""
        due = [
            node
            for index in silent
            if not 0.0 <= now - (node := self.nodes[index]).started_at < START_AGAIN
        ]
        for node in due:
            node.started_at = now
        return due

    def by_joint(self, reason: Callable[[Node], str | None]) -> dict[int, str]:
        """Return the reasons that some nodes have, by index of the joint."""
        return {index: words for index, node in enumerate(self.nodes) if (words := reason(node))}

    def note_other(self, identifier: int) -> None:
        """Note a frame that no encoder is configured to send: a node with another id may."""
        node_id = identifier & 0x7F
        if node_id and identifier - node_id in (*canopen.TPDO_BASES, canopen.HEARTBEAT_BASE):
            self._others.add(node_id)

    def others_text(self) -> str:
        """Return in words that other nodes are on the bus; empty if there are none."""
        others = sorted(self._others.difference(node.node_id for node in self.nodes))
        return (
            (
                '; on the bus, and not in encoders.node_id: '
                + ', '.join(map(str, others))
                + ' (can_scan prints the lines for rig.yaml)'
            )
            if others
            else ''
        )
