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
