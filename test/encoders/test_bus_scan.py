# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A scan on a virtual bus: what it asks, what it sends, what it records."""

import threading

import can
from can.interfaces.virtual import VirtualBus
import pytest
from spm_haptic_master.encoders import bus_scan, canopen
from spm_haptic_master.encoders.bus_scan import BusScan, BusScanner


@pytest.fixture
def buses(monkeypatch):
    """Give both ends of a virtual bus; a master's SYNC is awaited for a shorter time."""
    monkeypatch.setattr(bus_scan, 'SYNC_LISTEN', 0.2)
    with can.Bus(interface='virtual', channel='scan') as bus, \
            can.Bus(interface='virtual', channel='scan') as other:
        yield bus, other


def scanner(bus, scan, rate=100.0, echoes=False, reports=None):
    return BusScanner(bus, scan, rate, echoes, [].append if reports is None else reports.append)


def heard(bus):
    """Return the frames that arrived."""
    found = []
    while (message := bus.recv(0.0)) is not None:
        found.append(message)
    return found


def test_passive_scan_collects_and_sends_nothing(buses):
    bus, other = buses
    other.send(canopen.frame(0x181, bytes(4)))
    scan = BusScan()
    scanner(bus, scan).listen(0.05, False)
    assert list(scan.frames) == [(False, 0x181)]
    assert heard(other) == []


def test_every_node_is_asked_for_its_type_and_those_heard_for_the_rest(buses, monkeypatch):
    bus, other = buses
    monkeypatch.setattr(bus_scan, 'REQUEST_PERIOD', 2e-4)
    monkeypatch.setattr(bus_scan, 'PROGRESS_PERIOD', 0.7)
    other.send(canopen.frame(canopen.HEARTBEAT_BASE + 7, bytes((canopen.OPERATIONAL,))))
    reports = []
    scanner(bus, BusScan(), reports=reports).listen(1.0, True)
    asked = [(message.arbitration_id - canopen.SDO_REQUEST_BASE,
              canopen.sdo_object(message.data)) for message in heard(other)]
    nodes = canopen.NODE_ID_MAXIMUM
    assert asked[:nodes] == [(node, canopen.DEVICE_TYPE) for node in range(1, nodes + 1)]
    assert asked[nodes:] == [(7, entry) for entry in (
        canopen.VENDOR_ID, canopen.PRODUCT_CODE, canopen.REVISION, canopen.SERIAL_NUMBER)]
    assert reports == ['0 s left, 1 identifiers']


def test_no_sync_is_sent_where_the_bus_has_none(buses):
    bus, other = buses
    scanner(bus, BusScan(None)).listen(0.4, False, ())
    assert heard(other) == []


@pytest.mark.parametrize('delay', [None, 0.0, 0.5])
def test_sync_is_sent_at_the_rate_while_no_master_makes_it(buses, delay):
    bus, other = buses
    scan, reports = BusScan(), []
    master = threading.Timer(delay or 0.0, other.send_periodic, (canopen.frame(0x80), 0.02))
    if delay is not None:
        master.start()
    scanner(bus, scan, 20.0, reports=reports).listen(0.9, False, ())
    other.stop_all_periodic_tasks()
    found = heard(other)
    assert {message.arbitration_id for message in found} <= {0x80}
    assert len(found) == (scan.own_sync.count if scan.own_sync else 0)
    if delay == 0.0:
        assert scan.own_sync is None and 20.0 < scan.master_sync.rate < 60.0
        return
    expected = ['no SYNC on the bus: SYNC 0x80 is sent from here, at 20 Hz',
                'another master makes SYNC: none is sent from here any more']
    assert [each for each in reports if 'SYNC' in each] == expected[:1 if delay is None else 2]
    assert 9 <= len(found) <= 20 if delay is None else 0 < len(found) < 12


def test_every_node_that_is_heard_is_started_until_it_is_operational(buses, monkeypatch):
    bus, other = buses
    monkeypatch.setattr(bus_scan, 'START_PERIOD', 0.05)
    for node, state in ((9, canopen.PRE_OPERATIONAL), (17, canopen.OPERATIONAL), (33, 0)):
        other.send(canopen.frame(canopen.HEARTBEAT_BASE + node, bytes((state,))))
    scan = BusScan()
    scanner(bus, scan).listen(0.4, False, (5,))
    started = [bytes(message.data) for message in heard(other) if message.arbitration_id == 0]
    assert {data[0] for data in started} == {canopen.NMT_START}
    assert {data[1] for data in started} == {5, 9, 33} == scan.started
    assert sum(data[1] == 9 for data in started) > 2


def test_echoes_are_not_in_the_table_and_others_are(buses):
    """As many frames as were sent are echoes; one more is another program's."""
    _, other = buses
    scan = BusScan()
    with VirtualBus('scan', receive_own_messages=True) as bus:
        scanner(bus, scan, 20.0, echoes=True).listen(0.4, False, (5,))
        assert scan.own_sync.count > 4 and scan.frames == {}
        other.send(canopen.frame(0x80))
        scanner(bus, scan, 20.0, echoes=True).listen(0.1, False)
    assert scan.master_sync.count == 1


class UnacknowledgedBus(VirtualBus):
    """A bus without another node that acknowledges: the interface's queue is full."""

    def send(self, msg, timeout=None):
        raise can.CanOperationError('Transmit buffer full')


def test_a_scan_goes_on_where_nobody_acknowledges(buses):
    _, other = buses
    scan = BusScan()
    with UnacknowledgedBus('scan') as bus:
        other.send(canopen.frame(0x181, bytes(4)))
        scanner(bus, scan).listen(0.2, True, (1, 2))
        other.send(canopen.frame(0x182, bytes(4)))
        scanner(bus, scan).listen(0.2, True, (1, 2))
    assert set(scan.frames) == {(False, 0x181), (False, 0x182)}
    assert scan.unsent['Transmit buffer full'] > 10
