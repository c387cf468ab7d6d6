# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Scan of a bus: record its frames, ask the nodes for their identity, start them on request.

`BusScan` is the record, `BusScanner` is what sends and receives.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from statistics import median
import time

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.can_bus import BUS_ERRORS, error_words, first_line
from spm_haptic_master.encoders.canopen_nodes import START_AGAIN
from spm_haptic_master.encoders.counts_watch import CountsWatch
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.timing import DeadlineGrid, Periodic

# Time between two SDO requests (s): they take a tenth of a 1 Mbit/s bus at most.
REQUEST_PERIOD = 0.002
# Time between two reports of the progress (s).
PROGRESS_PERIOD = 1.0
# Time of listening for a master's SYNC before one is sent here (s): a period of the lowest
# `rate`, 1 Hz, and some.
SYNC_LISTEN = 1.1
# Most frames that are read before it is time to send again: more wait only on a machine that is
# too busy, and the rate of SYNC shows that.
FRAMES_AT_ONCE = 32
# Time after the last SYNC sent here in which its answers come (s).
LAST_ANSWERS = 0.05
# Time between two requests for the error register of a node that is watched (s).
REGISTER_PERIOD = 1.0
# Objects of an encoder that are read beside its identity: what is wrong, and its resolution.
ENCODER_OBJECTS = (
    canopen.ERROR_REGISTER,
    canopen.OPERATING_PARAMETERS,
    canopen.UNITS_PER_TURN,
    canopen.DISC_UNITS_PER_TURN,
)
# Objects whose answers show how many devices have a node id: nobody else asks for them.
COUNTED = (canopen.DEVICE_TYPE, *canopen.IDENTITY)
# Interface of python-can that returns the frames sent, without a mark.
ECHOING = 'udp_multicast'
# Lengths of the frames of a node that are looked into, by their identifier without the node id.
LENGTHS = {
    canopen.HEARTBEAT_BASE: canopen.HEARTBEAT_LENGTH,
    canopen.EMCY_BASE: canopen.EMCY_LENGTH,
    canopen.SDO_ANSWER_BASE: canopen.SDO_LENGTH,
}


@dataclass(slots=True)
class HeardFrame:
    """
    Frames received with one identifier.

    Attributes
    ----------
    first, last : float
        Receive times of the first and of the latest frame, s.
    count : int
        Number of frames.
    lengths : set of int
        Lengths of their data, bytes.
    first_cycle : int
        Number of SYNCs before the first frame.

    """

    first: float
    last: float
    count: int = 0
    lengths: set[int] = field(default_factory=set)
    first_cycle: int = 0

    @property
    def rate(self) -> float:
        """Mean rate from the first to the latest frame, Hz."""
        if self.last > self.first:
            return (self.count - 1) / (self.last - self.first)
        return 0.0


@dataclass(slots=True)
class HeardNode:
    """
    State and identity of a CANopen node, from its own messages.

    Attributes
    ----------
    state : int or None
        NMT state by its latest heartbeat.
    boot_ups : int
        Number of boot-up messages.
    heartbeat, heartbeat_before : float or None
        Receive times of its latest heartbeat and the one before, s; None before them.
    emergencies : Counter of str
        Number of EMCY messages by their words.
    objects : dict of (int, int) to int
        Values read by SDO, by index and subindex.
    requests, answers : Counter of (int, int)
        Number of requests for, and answers with each object of COUNTED.
    serials : set of int
        Serial numbers that were answered.

    """

    state: int | None = None
    boot_ups: int = 0
    heartbeat: float | None = None
    heartbeat_before: float | None = None
    emergencies: Counter[str] = field(default_factory=Counter)
    objects: dict[tuple[int, int], int] = field(default_factory=dict)
    requests: Counter[tuple[int, int]] = field(default_factory=Counter)
    answers: Counter[tuple[int, int]] = field(default_factory=Counter)
    serials: set[int] = field(default_factory=set)

    @property
    def devices(self) -> int:
        """Return how many devices have this node id: one answers a request once."""
        if not self.answers:
            return 1
        found = [1, len(self.serials)]
        for key, answers in self.answers.items():
            requests = max(1, self.requests[key])
            found.append(answers // requests)
        return max(found)

    @property
    def heartbeat_period(self) -> float | None:
        """Return the time between the latest two heartbeats, s; None before two."""
        if self.heartbeat is None or self.heartbeat_before is None:
            return None
        return self.heartbeat - self.heartbeat_before

    @property
    def profile(self) -> int | None:
        """Return the number of its CiA device profile, None if it is not known."""
        device = self.objects.get(canopen.DEVICE_TYPE)
        if device is None:
            return None
        return device & 0xFFFF


class BusScan:
    """
    Record of the frames received on a bus, but for those of the scanning program itself.

    Parameters
    ----------
    sync_id : int or None
        Identifier of SYNC; None on a bus without it.
    layouts : iterable of EncoderLayout
        Encoders whose counts are followed.

    Attributes
    ----------
    watches : dict of (bool, int) to CountsWatch
        Counts of these encoders, by 29 bits or not, and identifier.
    latest : float
        Receive time of the latest data frame, s; -inf before the first.
    frames : dict of (bool, int) to HeardFrame
        Frames heard, by 29 bits or not, and identifier.
    nodes : dict of int to HeardNode
        Nodes heard, by node id.
    errors : Counter of str
        Number of error frames by their words.
    remote : int
        Number of remote frames.
    own_sync : HeardFrame or None
        SYNCs that the scanning program sent.
    started : set of int
        Node ids that it started.
    unsent : Counter of str
        Number of frames that the interface refused to send, by its error.
    cycles : int
        Number of SYNCs, of a master and own ones.

    """

    def __init__(
        self,
        sync_id: int | None = canopen.SYNC_ID,
        layouts: Iterable[EncoderLayout] = (),
    ) -> None:
        self.sync_id = sync_id
        self.watches = {}
        for layout in layouts:
            self.watches[layout.extended, layout.can_id] = CountsWatch(layout)
        self.latest = float('-inf')
        self.frames: dict[tuple[bool, int], HeardFrame] = {}
        self.nodes: dict[int, HeardNode] = {}
        self.errors: Counter[str] = Counter()
        self.remote = 0
        self.own_sync: HeardFrame | None = None
        self.started: set[int] = set()
        self.unsent: Counter[str] = Counter()
        self.cycles = 0
        # Times between the SYNCs of a master, s.
        self._sync_intervals: list[float] = []

    @property
    def master_sync(self) -> HeardFrame | None:
        """Return the SYNC frames of a master on the bus, None if there is none."""
        if self.sync_id is None:
            return None
        return self.frames.get((False, self.sync_id))

    @property
    def master_rate(self) -> float:
        """
        Rate that the master of SYNC is set to, Hz; 0 before it is known.

        A busy machine loses SYNCs or reads them late: each time between two counts as the number
        of typical times that it is nearest to, with half of what the one before was longer.
        """
        typical = 0.0
        if self._sync_intervals:
            typical = median(self._sync_intervals)
        if typical <= 0.0:
            return 0.0
        cycles = 0
        late = 0.0
        for interval in self._sync_intervals:
            count = round((interval + late) / typical)
            cycles = cycles + count
            late = 0.5 * (interval + late - count * typical)
        return cycles / sum(self._sync_intervals)

    def sent_sync(self, now: float) -> None:
        """
        Record a SYNC that the scanning program sent.

        Parameters
        ----------
        now : float
            Time of sending, s.

        """
        self.own_sync = self.own_sync or HeardFrame(now, now)
        self.own_sync.last = now
        self.own_sync.count += 1
        self.cycles += 1

    def asked(self, node_id: int, key: tuple[int, int]) -> None:
        """
        Record a request, so that the answers can be compared in number.

        Parameters
        ----------
        node_id : int
            Node that was asked; one that was never heard is not recorded.
        key : tuple of 2 int
            Index and subindex of the object.

        """
        if key in COUNTED and node_id in self.nodes:
            self.nodes[node_id].requests[key] += 1

    def feed(self, message: can.Message) -> None:
        """
        Record a frame.

        Parameters
        ----------
        message : can.Message
            Frame of any kind, with its receive time in s.

        """
        if message.is_error_frame:
            self.errors[error_words(message)] += 1
            return
        if message.is_remote_frame:
            self.remote += 1
            return
        identifier = message.arbitration_id
        now = message.timestamp
        self.latest = max(self.latest, now)
        if not message.is_extended_id:
            base = identifier & ~0x7F
            self._node_frame(base, identifier & 0x7F, message)
            if base in (canopen.SDO_ANSWER_BASE, canopen.SDO_REQUEST_BASE):
                return  # mostly caused by this scan; the answers are listed with the nodes
            if identifier == self.sync_id:
                self.cycles += 1
                if (before := self.master_sync) is not None:
                    self._sync_intervals.append(now - before.last)
        key = (message.is_extended_id, identifier)
        if key not in self.frames:
            self.frames[key] = HeardFrame(
                first=now,
                last=now,
                first_cycle=self.cycles,
            )
        heard = self.frames[key]
        heard.last = now
        heard.count += 1
        heard.lengths.add(len(message.data))
        watch = self.watches.get(key)
        if watch is not None:
            watch.take(message.data, now)

    def _node_frame(
        self,
        base: int,
        node_id: int,
        message: can.Message,
    ) -> None:
        """
        Record a heartbeat, an emergency or an SDO answer with the right length.

        Parameters
        ----------
        base : int
            Identifier less the node id.
        node_id : int
            Node that sends it; 0 is none.
        message : can.Message
            The frame.

        """
        data = message.data
        length = LENGTHS.get(base)
        if node_id == 0 or len(data) != length:
            return
        node = self.nodes.setdefault(node_id, HeardNode())
        if base == canopen.HEARTBEAT_BASE:
            node.state = data[0] & 0x7F
            node.boot_ups += node.state == canopen.BOOT_UP
            node.heartbeat_before = node.heartbeat
            node.heartbeat = message.timestamp
        elif base == canopen.EMCY_BASE:
            node.emergencies[canopen.emcy_words(data)] += 1
        else:
            _take_answer(node, data)


def _take_answer(node: HeardNode, data: bytes | bytearray) -> None:
    """Record the answer of a node to a request by SDO."""
    key = canopen.sdo_object(data)
    value = canopen.sdo_value(data)
    if key in COUNTED and (value is not None or data[0] == canopen.SDO_ABORT):
        node.answers[key] += 1
    if value is None:
        return
    node.objects[key] = value
    if key == canopen.SERIAL_NUMBER:
        node.serials.add(value)


class BusScanner:
    """
    Feeds the frames on a bus to a scan; asks, starts and synchronises the nodes on request.

    Parameters
    ----------
    bus : can.BusABC
        Open bus.
    scan : BusScan
        Record of the frames.
    rate : float
        Rate of the bus's cycle, Hz.
    echoes : bool
        Whether the interface returns the frames sent here.
    report : callable
        Takes a line on what the scanner does on the bus.

    """

    def __init__(
        self,
        bus: can.BusABC,
        scan: BusScan,
        rate: float,
        echoes: bool,
        report: Callable[[str], None],
    ):
        self._bus = bus
        self._scan = scan
        self._rate = rate
        self._report = report
        self._echoes = echoes
        # Number of frames sent whose echo is expected.
        self._expected: Counter[tuple[bool, int, bytes]] = Counter()
        self._sync_grid: DeadlineGrid | None = None
        self._progress = Periodic(PROGRESS_PERIOD)
        # Time of the latest NMT start to each node, s.
        self._started_at: dict[int, float] = {}

    def listen(
        self,
        seconds: float,
        ask: bool,
        start: tuple[int, ...] | None = None,
    ) -> None:
        """
        Listen, and ask every node for its type, each one heard for its identity.

        Parameters
        ----------
        seconds : float
            How long, s; counted again from the first SYNC sent from here.
        ask : bool
            Whether requests by SDO are sent.
        start : tuple of int, optional
            Node ids to start, with every other node that is heard. Where no master makes SYNC it
            is then sent here at the rate, until a master appears. None: nothing is started.

        Raises
        ------
        can.CanError
            The bus cannot be read; python-can raises one of BUS_ERRORS.

        """
        requests: Iterator[can.Message | None] = iter(())
        if ask:
            requests = self._identity_requests()
        self._progress.is_due(time.monotonic())
        for now, left in self._run(seconds, requests, start):
            if self._progress.is_due(now):
                self._report(f'{left:.0f} s left, {len(self._scan.frames)} identifiers')
        # The answers to the last SYNC.
        end = time.monotonic() + LAST_ANSWERS
        while self._scan.own_sync is not None and time.monotonic() < end:
            self._receive()

    def watch(
        self,
        seconds: float,
        show: Callable[[], None],
        period: float,
        ask: tuple[int, ...],
        start: tuple[int, ...] | None = None,
    ) -> None:
        """
        Listen, and show the state of the encoders periodically.

        Parameters
        ----------
        seconds : float
            How long, s.
        show : callable
            Called each period, without arguments.
        period : float
            Time between two calls, s.
        ask : tuple of int
            Node ids that are asked for their error registers (1001h).
        start : tuple of int, optional
            As of `listen`.

        """
        shown = Periodic(period)
        for now, _ in self._run(seconds, self._register_requests(ask), start):
            if shown.is_due(now):
                show()

    def _run(
        self,
        seconds: float,
        requests: Iterator[can.Message | None],
        start: tuple[int, ...] | None,
    ) -> Iterator[tuple[float, float]]:
        """Send and receive for some seconds; yield the time and the seconds left, each step."""
        grid = DeadlineGrid(REQUEST_PERIOD)
        now = time.monotonic()
        end = now + seconds
        # When it is decided whether SYNC is sent from here.
        decision = None if start is None else now + SYNC_LISTEN
        while decision or now < end:
            if decision and now >= decision:
                decision = None
                if self._begin_sync():
                    end = now + seconds
            if grid.wait(0.0):
                self._send_request(next(requests, None))
                self._start_nodes(start, now)
            if self._sync_grid:
                self._send_sync(self._sync_grid)
            self._receive()
            yield now, max(0.0, end - now)
            now = time.monotonic()

    def _begin_sync(self) -> bool:
        """Begin to send SYNC where the bus has one and no master makes it; return whether."""
        if self._scan.sync_id is None or self._scan.master_sync is not None:
            return False
        self._sync_grid = DeadlineGrid(1.0 / self._rate)
        self._report(
            f'no SYNC on the bus: SYNC 0x{self._scan.sync_id:X} is sent from here, at '
            f'{self._rate:g} Hz'
        )
        return True

    def _send_request(self, request: can.Message | None) -> None:
        """Send a request by SDO, if there is one, and record it."""
        if request is not None and self._send(request):
            node_id = request.arbitration_id - canopen.SDO_REQUEST_BASE
            self._scan.asked(node_id, canopen.sdo_object(request.data))

    def _receive(self) -> None:
        """Feed the frames that are waiting, or the first one within half a cycle."""
        timeout = min(REQUEST_PERIOD, 0.5 / self._rate)
        for _ in range(FRAMES_AT_ONCE):
            message = self._bus.recv(timeout)
            if message is None:
                return
            key = _key(message)
            if self._expected[key]:
                self._expected[key] -= 1
            else:
                self._scan.feed(message)
            timeout = 0.0

    def _send_sync(self, grid: DeadlineGrid) -> None:
        """Send SYNC if it is due; stop for good once a master makes it."""
        if self._scan.master_sync is not None:
            self._sync_grid = None
            self._report('another master makes SYNC: none is sent from here any more')
            return
        if grid.wait(0.0):
            sync = canopen.frame(self._scan.sync_id or 0)
            if self._send(sync):
                self._scan.sent_sync(time.monotonic())

    def _start_nodes(self, start: tuple[int, ...] | None, now: float) -> None:
        """
        Send NMT start every START_AGAIN to these nodes and those heard, unless operational.

        None starts no node.
        """
        if start is None:
            return
        nodes = self._scan.nodes
        for node_id in {*start, *nodes}:
            if node_id in nodes and nodes[node_id].state == canopen.OPERATIONAL:
                continue
            since_start = now - self._started_at.get(node_id, float('-inf'))
            if since_start > START_AGAIN:
                self._started_at[node_id] = now
                if self._send(canopen.nmt(canopen.NMT_START, node_id)):
                    self._scan.started.add(node_id)

    def _send(self, message: can.Message) -> bool:
        """Send a frame; return whether the interface took it, as on a bus that acknowledges."""
        try:
            self._bus.send(message)
        except BUS_ERRORS as error:
            self._scan.unsent[first_line(error)] += 1
            return False
        # Only this thread receives: the echo cannot be read before this.
        self._expected[_key(message)] += self._echoes
        return True

    def _identity_requests(self) -> Iterator[can.Message]:
        """Yield requests for the type to every node id, then for the rest to those heard."""
        for node_id in range(1, canopen.NODE_ID_MAXIMUM + 1):
            yield canopen.sdo_upload(node_id, *canopen.DEVICE_TYPE)
        for key in (*canopen.IDENTITY, *ENCODER_OBJECTS):
            for node_id in sorted(self._scan.nodes):
                yield canopen.sdo_upload(node_id, *key)

    def _register_requests(self, node_ids: tuple[int, ...]) -> Iterator[can.Message | None]:
        """Yield requests for the error register of each node, each second; None in between."""
        due = Periodic(REGISTER_PERIOD)
        while True:
            if not due.is_due(time.monotonic()):
                yield None
                continue
            for node_id in node_ids:
                yield canopen.sdo_upload(node_id, *canopen.ERROR_REGISTER)


def _key(message: can.Message) -> tuple[bool, int, bytes]:
    """Return what distinguishes a frame, to recognise its echo: width, identifier and data."""
    return message.is_extended_id, message.arbitration_id, bytes(message.data)
