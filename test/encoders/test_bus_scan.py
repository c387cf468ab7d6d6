# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A scan of a scripted bus: what it asks, what it sends, what it records."""

import can
from encoder_frames import sync
import numpy as np
import pytest
from scripted_bus import node_frame, ScriptedBus, SEND_TIMEOUT
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan, BusScanner

# s for which a scan listens for a master before it sends SYNC, and between two starts of a node.
LISTEN = 1.1
AGAIN = 0.5


class Bus(ScriptedBus):
    """A bus that returns the frames sent, if it `echoes`."""

    echoes = False

    def send(self, message):
        super().send(message, SEND_TIMEOUT)
        if self.echoes:
            self.script.insert(0, (self.clock.now, message))


@pytest.fixture
def scan_of(clock):
    """Scan a scripted bus; return the scan, what was sent and when, and the reports."""

    def make(script, seconds, ask=False, start=None, rate=100.0, sync_id=0x80, **changes):
        bus = Bus(clock, script)
        scan = BusScan(sync_id)
        reports = []
        for name, value in changes.items():
            setattr(bus, name, value)
        scanner = BusScanner(bus, scan, rate, bus.echoes, reports.append)
        scanner.listen(seconds, ask, start)
        return scan, bus.sent, reports

    return make


def test_passive_scan_collects_for_its_time_and_sends_nothing(scan_of, clock):
    script = [node_frame(at, 0x181, bytes(4)) for at in (0.0, 0.049, 0.06)]
    scan, sent, _ = scan_of(script, 0.05)
    assert [(key, frame.count) for key, frame in scan.frames.items()] == [((False, 0x181), 2)]
    assert sent == []
    assert clock.now == pytest.approx(0.05, abs=3e-3)


def test_every_node_is_asked_for_its_type_and_those_heard_for_the_rest(scan_of):
    _, sent, reports = scan_of([node_frame(0.1, 0x707, b'\x05')], 2.9, ask=True)
    asked = [
        (message.arbitration_id - canopen.SDO_REQUEST_BASE, canopen.sdo_object(message.data))
        for _, message in sent
    ]
    assert asked == [
        *((node, (0x1000, 0)) for node in range(1, 128)),
        *((7, (0x1018, subindex)) for subindex in (1, 2, 3, 4)),
        # What is wrong with it, and its resolution.
        *((7, (index, 0)) for index in (0x1001, 0x6000, 0x6001, 0x6501)),
    ]
    # At 1 Mbit/s they take a tenth of the bus.
    assert sent[-1][0] - sent[0][0] == pytest.approx(0.002 * 134, rel=0.1)
    assert reports == ['2 s left, 1 identifiers', '1 s left, 1 identifiers']


@pytest.mark.parametrize(
    ('rate', 'master', 'count', 'reported'),
    [
        # No master: for all the time after it was listened for; one from the start; one later.
        (20.0, None, 18, 1),
        (1000.0, None, 900, 1),
        (20.0, 0.5, 0, 0),
        (20.0, LISTEN + 0.23, 5, 2),
    ],
)
def test_sync_is_sent_at_the_rate_while_no_master_makes_it(
    scan_of, clock, rate, master, count, reported
):
    script = []
    if master is not None:
        script = [node_frame(master + 0.02 * number, 0x80, b'') for number in range(150)]
    scan, sent, reports = scan_of(script, 0.9, start=(), rate=rate)
    for number, (at, message) in enumerate(sent):
        assert message.arbitration_id == 0x80
        assert not message.data
        assert at == pytest.approx(LISTEN + number / rate, abs=0.01)
    assert len(sent) == count
    if scan.own_sync:
        assert scan.own_sync.count == count
    assert [each for each in reports if 'SYNC' in each] == [
        f'no SYNC on the bus: SYNC 0x80 is sent from here, at {rate:g} Hz',
        'another master makes SYNC: none is sent from here any more',
    ][:reported]
    # The answers to the last SYNC are waited for.
    assert clock.now == pytest.approx(LISTEN + (0.95 if count else 0.0), abs=0.01)


def test_every_node_is_started_until_it_is_operational(scan_of):
    script = [
        *(
            node_frame(0.01, 0x700 + node, bytes((state,)))
            for node, state in (
                (9, canopen.PRE_OPERATIONAL),
                (17, canopen.OPERATIONAL),
                (33, canopen.BOOT_UP),
            )
        ),
        node_frame(0.8, 0x709, b'\x05'),
    ]
    scan, sent, _ = scan_of(script, 1.0, start=(5,), sync_id=None)
    # And no SYNC, which this bus has not.
    assert {(message.arbitration_id, message.data[0]) for _, message in sent} == {
        (canopen.NMT_ID, canopen.NMT_START)
    }
    starts = {
        node: [at for at, message in sent if message.data[1:2] == bytes((node,))]
        for node in (5, 9, 17, 33)
    }
    for node, expected in (
        (5, (0.0, AGAIN, 2 * AGAIN)),
        (9, (0.01, 0.01 + AGAIN)),
        (17, ()),
        (33, (0.01, 0.01 + AGAIN, 0.01 + 2 * AGAIN)),
    ):
        assert starts[node] == pytest.approx(expected, abs=0.01)
    assert scan.started == {5, 9, 33}


def test_echoes_are_not_in_the_table_and_others_are(scan_of):
    """As many frames as were sent are echoes; one more is another program's."""
    nmt = canopen.nmt(canopen.NMT_START, 5)
    scan, _, _ = scan_of([], 0.4, start=(5,), echoes=True)
    assert scan.own_sync.count > 30
    assert scan.frames == {}
    scan, _, _ = scan_of([(3.0, nmt)], 0.4, start=(5,), echoes=True)
    assert scan.frames[False, 0].count == 1


def test_a_scan_goes_on_where_nobody_acknowledges(scan_of):
    scan, sent, _ = scan_of(
        [node_frame(0.15, 0x181, bytes(4))],
        0.2,
        ask=True,
        start=(1, 2),
        refusal=can.CanOperationError('Transmit buffer full'),
    )
    assert set(scan.frames) == {(False, 0x181)}
    assert sent == []
    assert scan.unsent['Transmit buffer full'] > 100
    assert scan.own_sync is None
    assert scan.started == set()


RNG = np.random.default_rng(2)


@pytest.mark.parametrize(
    ('stamps', 'off'),
    [
        # A busy machine loses a third of the SYNCs, and reads the others late by up to a fifth
        # of a
        # period.
        (
            [
                0.02 * number + RNG.uniform(0.0, 4e-3)
                for number in range(150)
                if RNG.random() > 1.0 / 3.0
            ],
            0.05,
        ),
        # A pause of a program, in periods: that of the first SYNC and those in which it catches
        # up.
        *(
            (0.02 * (np.arange(100) + [*[0.0] * 50, *late, *[0.0] * (50 - len(late))]), 1e-6)
            for late in (
                (0.55, 0.1),
                (0.52,),
                (1.0,),
                (1.6, 0.7, 0.2),
                (2.6, 1.7, 0.8, 0.3),
                (-0.1, 0.45),
            )
        ),
    ],
)
def test_the_rate_of_a_master_is_what_it_is_set_to_on_a_busy_machine(stamps, off):
    scan = BusScan()
    assert scan.master_rate == 0.0
    for number, stamp in enumerate(stamps):
        scan.feed(sync(1.76e9 + stamp))
        assert number or scan.master_rate == 0.0
    assert scan.master_rate == pytest.approx(50.0, rel=off)


def test_a_watch_shows_the_encoders_each_period_and_asks_for_their_errors_each_second(clock):
    bus = Bus(clock)
    scanner = BusScanner(bus, BusScan(), 100.0, False, lambda line: None)
    shown = []
    scanner.watch(2.5, lambda: shown.append(clock.now), 0.5, (3, 4))
    assert shown == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0], abs=0.02)
    asked = [(message.arbitration_id, message.data[1:4].hex()) for _, message in bus.sent]
    assert asked == [(0x603, '011000'), (0x604, '011000')] * 3
    assert [at for at, _ in bus.sent[::2]] == pytest.approx([0.0, 1.0, 2.0], abs=0.02)


SERIAL = canopen.SERIAL_NUMBER
TYPE = canopen.DEVICE_TYPE
VENDOR = canopen.VENDOR_ID


@pytest.mark.parametrize(
    ('asked', 'answered', 'devices'),
    [
        (
            [],
            [],
            1,
        ),
        (
            [TYPE],
            [(TYPE, 0x10196)],
            1,
        ),
        # Two answers to one request; and to two requests.
        (
            [TYPE],
            [(TYPE, 0x10196)] * 2,
            2,
        ),
        (
            [TYPE, TYPE],
            [(TYPE, 0x10196)] * 2,
            1,
        ),
        (
            [TYPE, TYPE],
            [(TYPE, 0x10196)] * 3,
            1,
        ),
        (
            [TYPE, TYPE],
            [(TYPE, 0x10196)] * 4,
            2,
        ),
        # Three of them answer one request each, and one has another.
        (
            [TYPE, VENDOR],
            [(TYPE, 1), (VENDOR, 2), (VENDOR, 2), (VENDOR, 2)],
            3,
        ),
        # Two serial numbers, of two devices that each missed one of two requests.
        (
            [SERIAL, SERIAL],
            [(SERIAL, 7), (SERIAL, 8)],
            2,
        ),
        (
            [SERIAL, SERIAL],
            [(SERIAL, 7), (SERIAL, 7)],
            1,
        ),
        # Others ask for the error register, too; a request that was not recorded is one.
        (
            [],
            [(canopen.ERROR_REGISTER, 0)] * 2,
            1,
        ),
        (
            [],
            [(TYPE, 1)] * 2,
            2,
        ),
    ],
)
def test_answers_show_how_many_devices_have_a_node_id(asked, answered, devices):
    scan = BusScan()
    scan.feed(canopen.frame(0x705, b'\x05'))
    for key in asked:
        scan.asked(5, key)
    for key, value in answered:
        scan.feed(canopen.sdo_answer(5, *key, value))
    assert scan.nodes[5].devices == devices


def test_refusals_count_as_answers_and_have_no_value():
    scan = BusScan()
    for _ in range(2):
        scan.feed(canopen.sdo(0x585, canopen.SDO_ABORT, *VENDOR, canopen.SDO_NO_SUCH_OBJECT))
        scan.feed(canopen.sdo(0x585, canopen.SDO_DOWNLOAD_ANSWER, *TYPE))
    node = scan.nodes[5]
    assert node.devices == 2
    assert node.answers == {VENDOR: 2}
    assert node.objects == {}


def test_a_request_to_a_node_that_was_never_heard_is_not_recorded():
    scan = BusScan()
    scan.asked(5, TYPE)
    assert scan.nodes == {}


@pytest.mark.parametrize(
    ('stamps', 'rate'), [([1.0], 0.0), ([1.0, 1.0], 0.0), ([1.0, 1.1, 1.5], 4.0)]
)
def test_the_rate_of_a_frame_is_from_its_first_to_its_latest(stamps, rate):
    scan = BusScan()
    for stamp in stamps:
        scan.feed(canopen.frame(0x123, bytes(3), stamp))
    heard = scan.frames[False, 0x123]
    assert (heard.first, heard.last, heard.count) == (stamps[0], stamps[-1], len(stamps))
    assert heard.lengths == {3}
    assert heard.rate == pytest.approx(rate)


def test_a_frame_knows_the_syncs_before_it():
    scan = BusScan()
    for identifier in (0x80, 0x181, 0x80, 0x182, 0x181):
        scan.feed(canopen.frame(identifier, stamp=1.0))
    scan.sent_sync(2.0)
    assert scan.cycles == 3
    assert scan.frames[False, 0x181].first_cycle == 1
    assert scan.frames[False, 0x182].first_cycle == 2


def test_a_node_is_heard_by_its_own_frames_and_nothing_else():
    scan = BusScan()
    for identifier, data in ((0x705, b'\x84'), (0x700, b'\x05'), (0x185, b'\x05'), (0x605, b'')):
        scan.feed(canopen.frame(identifier, data))
    extended = can.Message(arbitration_id=0x706, data=b'\x05', is_extended_id=True)
    scan.feed(extended)
    assert set(scan.nodes) == {5}
    node = scan.nodes[5]
    # Bit 7 is the toggle bit of node guarding.
    assert (node.state, node.boot_ups, node.profile) == (canopen.STOPPED, 0, None)
    # Requests and answers by SDO are not among the frames.
    assert set(scan.frames) == {(False, 0x705), (False, 0x700), (False, 0x185), (True, 0x706)}


def test_the_period_of_a_heartbeat_is_that_of_the_latest_two():
    scan = BusScan()
    periods = []
    for stamp in (1.0, 1.5, 1.6):
        scan.feed(canopen.frame(0x705, b'\x00', stamp))
        periods.append(scan.nodes[5].heartbeat_period)
    assert periods == [None, pytest.approx(0.5), pytest.approx(0.1)]
    assert scan.nodes[5].boot_ups == 3
