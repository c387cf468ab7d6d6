# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The loop of a bus scan on a virtual bus: what it asks, what it sends, what it collects."""

import can
from can.interfaces.virtual import VirtualBus
from encoder_frames import LAYOUTS
import pytest
from spm_haptic_master.encoders import canopen, scan_loop
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.scan_loop import listen


@pytest.fixture
def buses():
    """Give both ends of a virtual bus."""
    with can.Bus(interface='virtual', channel='scan') as bus, \
            can.Bus(interface='virtual', channel='scan') as other:
        yield bus, other


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
    listen(bus, scan, 0.05, 100.0, ask=False, sync_id=None, progress=lambda left: None)
    assert list(scan.frames) == [(False, 0x181)]
    assert heard(other) == []


def test_every_node_is_asked_for_its_type_and_those_heard_for_the_rest(buses, monkeypatch):
    bus, other = buses
    monkeypatch.setattr(scan_loop, 'REQUEST_PERIOD', 2e-4)
    monkeypatch.setattr(scan_loop, 'PROGRESS_PERIOD', 0.7)
    other.send(canopen.frame(canopen.HEARTBEAT_BASE + 7, bytes((canopen.OPERATIONAL,))))
    left = []
    listen(bus, BusScan(), 1.0, 1000.0, ask=True, sync_id=None, progress=left.append)
    asked = [(message.arbitration_id - canopen.SDO_REQUEST_BASE,
              canopen.sdo_object(message.data)) for message in heard(other)]
    nodes = canopen.NODE_ID_MAXIMUM
    assert asked[:nodes] == [(node, canopen.DEVICE_TYPE) for node in range(1, nodes + 1)]
    assert asked[nodes:] == [(7, entry) for entry in (
        canopen.VENDOR_ID, canopen.PRODUCT_CODE, canopen.REVISION, canopen.SERIAL_NUMBER)]
    assert len(left) == 1 and 0.0 < left[0] <= 0.3


def test_sync_is_sent_at_the_rate(buses):
    bus, other = buses
    listen(bus, BusScan(), 0.5, 20.0, ask=False, sync_id=0x80, progress=lambda left: None)
    found = heard(other)
    assert {message.arbitration_id for message in found} == {0x80}
    assert 5 <= len(found) <= 11


class UnacknowledgedBus(VirtualBus):
    """A bus without another node that acknowledges: the interface's queue is full."""

    def send(self, msg, timeout=None):
        raise can.CanOperationError('Transmit buffer full')


def test_a_scan_goes_on_where_nobody_acknowledges(buses):
    _, other = buses
    scan = BusScan()
    with UnacknowledgedBus('scan') as bus:
        other.send(canopen.frame(0x181, bytes(4)))
        listen(bus, scan, 0.2, 100.0, ask=True, sync_id=0x80, progress=lambda left: None)
        other.send(canopen.frame(0x182, bytes(4)))
        listen(bus, scan, 0.2, 100.0, ask=True, sync_id=0x80, progress=lambda left: None)
    assert set(scan.frames) == {(False, 0x181), (False, 0x182)}
    assert scan.unsent['Transmit buffer full'] > 10
    refused = sum(scan.unsent.values())
    assert scan.lines(LAYOUTS, 0x80)[-1] \
        == f'  not sent: {refused} frames, Transmit buffer full'
    assert scan.problems(LAYOUTS, 0x80, (1, 2, 3, 4), 1000.0, True)[-1] \
        == 'sending: Transmit buffer full (does any other node acknowledge?)'
