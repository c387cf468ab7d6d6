# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The encoders as CANopen nodes: NMT states, heartbeats, boot-ups and emergencies.

What a node reports decides whether its answers are readings, and explains its silence.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import can
from spm_haptic_master.encoders import canopen

# Time between two NMT starts to a node (s): its boot-up message may have been lost.
START_AGAIN = 0.5
# Time between two requests for an object of a node (s), and most of them for one object without an
# answer.
ASK_AGAIN = 1.0
MOST_REQUESTS = 3
# What is known of a node that has no serial number, or keeps it to itself.
NO_SERIAL = 'none'
# Time after a SYNC that was left out here in which a node that leaves OPERATIONAL, or reports an
# error of communication, does so because of it (s): a heartbeat shows it within a second.
LEFT_OUT_SPAN = 1.5
# What is known of such a node.
SUPERVISES_SYNC = (
    'it left OPERATIONAL when this driver left a SYNC out, as it supervises SYNC; none is left '
    'out any more: set its 0x1006 to 0 (can_setup)'
)


@dataclass(slots=True, eq=False)
class Node:
    """
    State of one node, from its own messages. Another thread reads: each value is read once.

    Attributes
    ----------
    joint : str
        Joint or axis of its encoder.
    node_id : int
        CANopen node id.
    timeout : float
        Time without a heartbeat after which that is lost, s.
    state : int or None
        NMT state by the latest heartbeat or boot-up message, None before the first.
    heard : float or None
        Time of the latest heartbeat, s; None before the first and after a boot-up, since CiA 301
        supervises a heartbeat from the first one on.
    emergency : str or None
        Latest emergency in words, None if there is none or every error is over.
    register : int or None
        Error register (1001h) as it was read; None before that, and after a boot-up. EMCY reports
        only what happens while somebody listens.
    serial : str or None
        Serial number (1018h:04) as it was read, or that the node has none; None before that, and
        after a boot-up: another device may have come.
    asked_at : float
        Time of the latest request for an object, s.
    requests : Counter of tuple of int
        Numbers of requests since the boot-up, by index and subindex of the object.
    supervises_sync : bool
        Whether it left OPERATIONAL because of a SYNC that was left out here.
    boot_ups, emergencies : int
        Numbers of boot-up messages and of EMCY messages.
    started_at : float
        Time of the latest NMT start, s; -inf before the first and after a boot-up.

    """

    joint: str
    node_id: int
    timeout: float
    state: int | None = None
    heard: float | None = None
    emergency: str | None = None
    register: int | None = None
    serial: str | None = None
    asked_at: float = float('-inf')
    requests: Counter[tuple[int, int]] = field(default_factory=Counter)
    supervises_sync: bool = False
    boot_ups: int = 0
    emergencies: int = 0
    started_at: float = float('-inf')

    def down(self) -> str | None:
        """Return the word for its NMT state by its latest message, None if it is operational."""
        state = self.state
        if state in (None, canopen.OPERATIONAL):
            return None
        return canopen.state_word(state)

    def caution(self, now: float) -> str | None:
        """
        Return what is wrong with a node that may answer.

        Parameters
        ----------
        now : float
            Time, s since the Unix epoch.

        Returns
        -------
        str or None
            Its emergency, its error register or its lost heartbeat, in this order; None without
            any.

        """
        if emergency := self.emergency:
            return emergency
        if register := self.register:
            return canopen.register_words(register)
        if self._lost(self.heard, now):
            return 'heartbeat lost'
        return None

    def caution_with_sync(self, now: float) -> str | None:
        """Return the caution, and that the node supervises SYNC."""
        caution = self.caution(now)
        if not self.supervises_sync:
            return caution
        return f'{caution}; {SUPERVISES_SYNC}' if caution else SUPERVISES_SYNC

    def trouble(self, now: float) -> str | None:
        """Return the reason why it does not answer, None if it is unknown."""
        reason = self.caution(now) or self.down()
        return f'{reason}; {SUPERVISES_SYNC}' if reason and self.supervises_sync else reason

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
        state = self.state
        heard = self.heard
        if state is None:
            words = 'unknown'
        else:
            words = canopen.state_word(state)
        if heard is None:
            heartbeat = 'no heartbeat yet'
        else:
            heartbeat = f'heartbeat {1e3 * (now - heard):.0f} ms ago'
            if self._lost(heard, now):
                heartbeat += ' (lost)'
        return {
            f'{self.joint} node {self.node_id}': f'{words}, {heartbeat}',
            f'{self.joint} boot-ups': self.boot_ups,
            f'{self.joint} EMCY': f'{self.emergency or "none"} ({self.emergencies} messages)',
            f'{self.joint} error register': (
                'not read' if self.register is None else f'0x{self.register:02X}'
            ),
            f'{self.joint} serial number': self.serial or 'not read',
        }

    def take(self, message: can.Message) -> str | None:
        """
        Take its heartbeat, EMCY or answer to SDO.

        Parameters
        ----------
        message : can.Message
            Frame with one of its identifiers, stamped in s since the Unix epoch.

        Returns
        -------
        str or None
            The name of a frame that has a wrong length; None for a good one.

        """
        base = message.arbitration_id - self.node_id
        data = message.data
        name, length = LENGTHS[base]
        if len(data) != length:
            return f'{self.joint} {name}'
        if base == canopen.EMCY_BASE:
            self._take_emergency(data)
        elif base == canopen.SDO_ANSWER_BASE:
            self._take_answer(data)
        else:
            self._take_heartbeat(data[0], message.timestamp)
        return None

    def wanted(self, now: float) -> tuple[int, int] | None:
        """
        Return what is to be read of it, as it has been heard.

        Parameters
        ----------
        now : float
            Time, s since the Unix epoch.

        Returns
        -------
        tuple of int, or None
            Index and subindex of one object at a time: its error register, its serial number, or
            again the register of a node that has an error; None for nothing.

        """
        if 0.0 <= now - self.asked_at < ASK_AGAIN:
            return None
        if self.register is None and self.requests[canopen.ERROR_REGISTER] < MOST_REQUESTS:
            return canopen.ERROR_REGISTER
        if self.serial is None and self.requests[canopen.SERIAL_NUMBER] < MOST_REQUESTS:
            return canopen.SERIAL_NUMBER
        # One that has an error is asked until it has none: EMCY may get lost.
        return canopen.ERROR_REGISTER if self.register else None

    def ask(self, wanted: tuple[int, int], now: float) -> None:
        """
        Note a request.

        Parameters
        ----------
        wanted : tuple of int
            Index and subindex of the object.
        now : float
            Time, s since the Unix epoch.

        """
        self.asked_at = now
        self.requests[wanted] += 1

    def _take_emergency(self, data: bytes | bytearray) -> None:
        """Take an EMCY: it is over when no error is left in the register."""
        self.emergencies += 1
        if canopen.emcy_is_over(data):
            self.emergency = None
            self.register = 0
        else:
            self.emergency = canopen.emcy_words(data)

    def _take_answer(self, data: bytes | bytearray) -> None:
        """Take the answer to a request of `wanted`; other answers are not ours."""
        value = canopen.sdo_value(data)
        if value is None and data[0] != canopen.SDO_ABORT:
            return
        # None: the node refuses, because it has no such object.
        answered = canopen.sdo_object(data)
        if answered == canopen.ERROR_REGISTER:
            self.register = 0 if value is None else value & 0xFF
        elif answered == canopen.SERIAL_NUMBER:
            self.serial = NO_SERIAL if value is None else str(value)

    def _take_heartbeat(self, state: int, stamp: float) -> None:
        """Take an NMT state; a boot-up message resets what was known of the node."""
        # Bit 7 is reserved; in the older node guarding it is the toggle bit.
        self.state = state & 0x7F
        self.heard = stamp
        if self.state == canopen.BOOT_UP:
            self.boot_ups += 1
            self.heard = self.emergency = self.register = self.serial = None
            self.started_at = self.asked_at = float('-inf')
            self.requests.clear()

    def _lost(self, heard: float | None, now: float) -> bool:
        """Return whether the latest heartbeat, if any, is older than the time-out."""
        return heard is not None and now - heard > self.timeout


# Names and lengths (bytes) of the frames that a node sends, by the base of their identifier.
LENGTHS = {
    canopen.EMCY_BASE: ('EMCY', canopen.EMCY_LENGTH),
    canopen.SDO_ANSWER_BASE: ('SDO answer', canopen.SDO_LENGTH),
    canopen.HEARTBEAT_BASE: ('heartbeat', canopen.HEARTBEAT_LENGTH),
}


class CanopenNodes:
    """
    Supervises the nodes of the encoders.

    Parameters
    ----------
    joints : tuple of N str
        Joints of the encoders.
    node_ids : tuple of N int
        Their CANopen node ids.
    heartbeat_timeout : float
        Time after a heartbeat at which the next one is lost, s.
    drives : tuple of int
        Node ids of the drives on the same bus, which are known and left alone.
    further : tuple of Node
        Nodes of encoders that are no joints; they are started and asked as the others.

    Attributes
    ----------
    nodes : tuple of N Node
        Nodes of the joints.
    every : tuple of Node
        These, and the further ones behind them.
    senders : dict of int to Node
        Node that sends the frames with each identifier.

    """

    def __init__(
        self,
        joints: tuple[str, ...],
        node_ids: tuple[int, ...],
        heartbeat_timeout: float,
        drives: tuple[int, ...] = (),
        further: tuple[Node, ...] = (),
    ):
        self.nodes = tuple(
            Node(joint, node_id, heartbeat_timeout)
            for joint, node_id in zip(joints, node_ids, strict=True)
        )
        self.every = (*self.nodes, *further)
        self.senders = {base + node.node_id: node for node in self.every for base in LENGTHS}
        # Other nodes on the bus; and those of them that are known.
        self._others: set[int] = set()
        self._known = {*drives, *(node.node_id for node in self.every)}
        # Time at which a SYNC was left out here, s since the Unix epoch.
        self._sync_left_out_at = float('-inf')

    @property
    def supervise_sync(self) -> bool:
        """Whether a node left OPERATIONAL because of a SYNC that was left out here."""
        return any(node.supervises_sync for node in self.every)

    def left_out_sync(self, now: float) -> None:
        """Note that a SYNC is left out here `now`, s since the Unix epoch."""
        self._sync_left_out_at = now

    def take(self, message: can.Message) -> str | None:
        """
        Take the frame of a node.

        Parameters
        ----------
        message : can.Message
            Frame with an identifier of `senders`, stamped in s since the Unix epoch.

        Returns
        -------
        str or None
            What has a wrong length; None for a good frame.

        """
        node = self.senders[message.arbitration_id]
        before = node.state
        if wrong := node.take(message):
            return wrong
        since = message.timestamp - self._sync_left_out_at
        if 0.0 <= since < LEFT_OUT_SPAN and self._has_missed_sync(node, before, message):
            node.supervises_sync = True
        return None

    @staticmethod
    def _has_missed_sync(
        node: Node,
        before: int | None,
        message: can.Message,
    ) -> bool:
        """Return whether a message says that SYNC is missing, by the state of its node before."""
        if message.arbitration_id == canopen.EMCY_BASE + node.node_id:
            error_class = canopen.emcy_code(message.data) >> 8
            return error_class == canopen.EMCY_COMMUNICATION
        if before != canopen.OPERATIONAL:
            return False
        return node.state in (canopen.PRE_OPERATIONAL, canopen.STOPPED)

    def to_ask(self, now: float, silent: tuple[int, ...]) -> list[tuple[Node, tuple[int, int]]]:
        """
        Return, and note, which objects of which nodes are to be read.

        Parameters
        ----------
        now : float
            Time, s since the Unix epoch.
        silent : tuple of int
            Places in `every` of the nodes whose encoders are silent; a node that was never heard
            at all is not asked.

        Returns
        -------
        list of tuple of Node and tuple of int
            Nodes, with index and subindex of the object: the error register (1001h) or the serial
            number (1018h:04).

        """
        requests = []
        for index, node in enumerate(self.every):
            if node.state is None and index in silent:
                continue
            wanted = node.wanted(now)
            if wanted is not None:
                node.ask(wanted, now)
                requests.append((node, wanted))
        return requests

    def to_start(self, now: float, silent: tuple[int, ...]) -> list[Node]:
        """
        Return, and note, the nodes to start (NMT), each at most once in START_AGAIN.

        Parameters
        ----------
        now : float
            Time, s since the Unix epoch.
        silent : tuple of int
            Places in `every` of the nodes whose encoders are silent.

        """
        due = []
        for index in silent:
            node = self.every[index]
            since_start = now - node.started_at
            if not 0.0 <= since_start < START_AGAIN:
                node.started_at = now
                due.append(node)
        return due

    def by_joint(self, reason: Callable[[Node], str | None]) -> dict[int, str]:
        """
        Return the reasons that some nodes have.

        Parameters
        ----------
        reason : callable
            Returns the reason of a node in words, or None.

        Returns
        -------
        dict of int to str
            Reasons by index of the joint.

        """
        found = {}
        for index, node in enumerate(self.nodes):
            words = reason(node)
            if words:
                found[index] = words
        return found

    def note_other(self, identifier: int) -> None:
        """Note a frame that no encoder is configured to send: a node with another id may."""
        node_id = identifier & canopen.NODE_ID_MAXIMUM
        base = identifier - node_id
        if node_id and base in (*canopen.TPDO_BASES, canopen.HEARTBEAT_BASE):
            self._others.add(node_id)

    def others_text(self) -> str:
        """Return in words that other nodes are on the bus; empty if there are none."""
        others = sorted(self._others - self._known)
        if not others:
            return ''
        listed = ', '.join(map(str, others))
        return (
            f'; on the bus, and not in encoders.node_id: {listed}'
            ' (can_scan prints the lines for rig.yaml)'
        )
