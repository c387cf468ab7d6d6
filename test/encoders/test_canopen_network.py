# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How long a node is waited for, and how devices with one node id are found, without a bus."""

from contextlib import nullcontext
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from spm_haptic_master.encoders import canopen, canopen_network
from spm_haptic_master.encoders.canopen_network import awaited, NodeClient
from spm_haptic_master.exceptions import SetupError

pytest.importorskip('canopen')


class Network:
    """A network on which nothing is sent; `answers` come back at their times after a request."""

    def __init__(self):
        self.sent = []
        self.takers = {}
        self.answers = []
        self.sdo = SimpleNamespace(download=Mock())

    def add_node(self, node):
        return SimpleNamespace(sdo=self.sdo)

    def subscribe(self, identifier, take):
        self.takers[identifier] = take

    def unsubscribe(self, identifier, take):
        assert self.takers.pop(identifier) is take

    def send_message(self, identifier, data):
        self.sent.append((identifier, bytes(data)))
        self.pass_until(0.0)

    def pass_until(self, seconds):
        """Deliver the answers that come within some seconds."""
        for _, identifier, data in [each for each in self.answers if each[0] <= seconds]:
            if identifier in self.takers:
                self.takers[identifier](identifier, bytearray(data), 0.0)
        self.answers = [each for each in self.answers if each[0] > seconds]


class Event:
    """An event that does not wait; it notes for how long it would."""

    waits = []

    def __init__(self):
        self._set = False

    def set(self):
        self._set = True

    def wait(self, timeout):
        self.waits.append(timeout)
        return self._set


@pytest.fixture
def network(monkeypatch):
    """Return a network on which waiting takes no time."""
    made = Network()
    monkeypatch.setattr(Event, 'waits', [])
    monkeypatch.setattr(canopen_network, 'threading', SimpleNamespace(Event=Event))
    monkeypatch.setattr(canopen_network, 'time', SimpleNamespace(sleep=made.pass_until))
    return made


def test_an_answer_is_waited_for_twice_half_a_second_and_a_store_15_s(network):
    client = NodeClient(network, 5)
    sdo = network.sdo
    assert (sdo.RESPONSE_TIMEOUT, sdo.MAX_RETRIES) == (0.5, 2)
    at_store = []
    sdo.download.side_effect = lambda *_: at_store.append((sdo.RESPONSE_TIMEOUT, sdo.MAX_RETRIES))
    client.store()
    # It is sent once: a node that stores twice wears its memory.
    assert at_store == [(15.0, 1)]
    sdo.download.assert_called_once_with(0x1010, 1, b'save')
    assert (sdo.RESPONSE_TIMEOUT, sdo.MAX_RETRIES) == (0.5, 2)


def test_after_a_refused_store_answers_are_waited_for_as_before(network):
    client = NodeClient(network, 5)
    network.sdo.download.side_effect = OSError('gone')
    with pytest.raises(OSError, match='gone'):
        client.store()
    assert (network.sdo.RESPONSE_TIMEOUT, network.sdo.MAX_RETRIES) == (0.5, 2)


SERIAL = bytes(canopen.sdo_answer(5, *canopen.SERIAL_NUMBER, 4711).data)


@pytest.mark.parametrize(
    ('times', 'devices'),
    [
        ((), None),
        ((0.0,), None),
        # All devices with that node id have 50 ms after the first.
        ((0.0, 0.049), 'two devices have node id 5'),
        ((0.0, 0.0, 0.04), 'three devices have node id 5'),
        ((0.0, 0.051), None),
    ],
)
def test_devices_with_one_node_id_answer_within_fifty_milliseconds(network, times, devices):
    network.answers = [(at, 0x585, SERIAL) for at in times]
    network.answers.append((0.0, 0x586, SERIAL))
    client = NodeClient(network, 5)
    with pytest.raises(SetupError, match=devices) if devices else nullcontext():
        client.check_alone()
    assert network.sent == [(0x605, bytes.fromhex('40 18 10 04 00 00 00 00'))]
    assert network.takers == {}
    assert Event.waits == [0.5]


@pytest.mark.parametrize(
    ('identifier', 'data', 'boots'),
    [
        (0x705, b'\x00', True),
        (0x705, b'\x05', False),
        (0x706, b'\x00', False),
    ],
)
def test_a_reset_is_over_with_the_boot_up_message_of_the_node(network, identifier, data, boots):
    network.answers = [(0.0, identifier, data)]
    client = NodeClient(network, 5)
    refused = pytest.raises(SetupError, match='node 5 has not booted within 5 s of its reset')
    with nullcontext() if boots else refused:
        client.reset()
    assert network.sent == [(0x000, b'\x81\x05')]
    assert Event.waits == [5.0]
    assert network.takers == {}


@pytest.mark.parametrize(
    ('wanted', 'data', 'is_heard'),
    [(None, b'\x01', True), (b'\x01', b'\x01', True), (b'\x01', b'\x02', False)],
)
def test_a_frame_is_awaited_with_its_data_or_with_any(network, wanted, data, is_heard):
    with awaited(network, 0x123, wanted) as heard:
        network.answers = [(0.0, 0x123, data)]
        network.pass_until(0.0)
        assert heard.wait(0.0) is is_heard
    assert network.takers == {}


@pytest.mark.parametrize(
    ('stored', 'can_store'),
    [((0, 4), False), ((1, 4), True), ((2, 4), True), ((4, 4), False), ((None, 0), False)],
)
def test_a_node_stores_on_command_or_by_itself(network, monkeypatch, stored, can_store):
    client = NodeClient(network, 5)
    monkeypatch.setattr(client, 'read', lambda index, subindex: stored)
    assert client.can_store() is can_store
