# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bus: how it is opened and named, its errors in a line with the remedy, its times."""

import errno
from importlib import import_module
import logging
import os
import sys
from unittest.mock import call, Mock

import can
from encoder_frames import T0
import pytest
from spm_haptic_master.encoders import can_bus

# s; a day apart a device has an epoch of its own.
OWN_EPOCH = 86400.0


def test_a_missing_msgpack_has_a_remedy(monkeypatch):
    # Loaded before, so that its modules are those with msgpack again after this test.
    import_module('can.interfaces.udp_multicast')
    monkeypatch.setitem(sys.modules, 'msgpack', None)
    for name in [name for name in sys.modules if 'udp_multicast' in name]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(can_bus.BUS_ERRORS) as caught:
        can_bus.open_bus('udp_multicast', '239.74.0.1', 0)
    assert can_bus.first_line(caught.value) == (
        'msgpack not installed: sudo apt install python3-msgpack; in a virtual environment: pip '
        'install msgpack'
    )


@pytest.mark.parametrize(
    ('number', 'words'),
    [
        (
            errno.EAFNOSUPPORT,
            ['this machine has no SocketCAN', '--params-file rig.yaml', 'can.interface:='],
        ),
        (errno.ENODEV, ['ip link', '--params-file rig.yaml', 'can.channel:=']),
    ],
)
def test_a_bus_that_is_not_there_says_what_to_give(number, words):
    for error in (
        OSError(number, os.strerror(number)),
        can.CanInitializationError(os.strerror(number), number),
    ):
        text = can_bus.first_line(error)
        assert os.strerror(number) in text
        assert '\n' not in text
        assert all(word in text for word in words)


@pytest.mark.parametrize(
    ('config', 'port'),
    [
        ('{}', ' port 43113'),
        ('{"port": 43999}', ' port 43999'),
        ('{', ''),
    ],
)
def test_the_name_of_a_bus_between_processes_has_its_port(monkeypatch, config, port):
    monkeypatch.setenv('CAN_CONFIG', config)
    assert can_bus.bus_name('udp_multicast', '239.74.0.1') == f'udp_multicast 239.74.0.1{port}'


# Classes in the identifier, and byte 1 of a controller's (linux/can/error.h).
@pytest.mark.parametrize(
    ('identifier', 'data', 'words'),
    [
        (0x001, '', 'transmit timeout'),
        (0x002, '', 'lost arbitration'),
        (0x004, '', 'controller problem'),
        (0x008, '', 'protocol violation'),
        (0x010, '', 'transceiver'),
        (0x020, '', 'no acknowledge (is any other node on the bus?)'),
        (0x040, '', 'bus-off'),
        (0x080, '', 'bus error'),
        (0x100, '', 'controller restarted'),
        (0x200, '', 'unknown error 0x200'),
        (0x400, '', 'unknown error 0x400'),
        (0x004, '0001', 'controller problem, receive overflow'),
        (0x004, '0002', 'controller problem, transmit overflow'),
        (0x004, '0004', 'controller problem, receive warning level'),
        (0x004, '0008', 'controller problem, transmit warning level'),
        (0x004, '0010', 'controller problem, receive error passive'),
        (0x004, '0020', 'controller problem, transmit error passive'),
        (0x004, '0040', 'controller problem, error active again'),
        (0x004, '0080', 'controller problem'),
        # Several; too short for details, and details of another class.
        (0x088, '', 'protocol violation, bus error'),
        (0x041, '', 'transmit timeout, bus-off'),
        (0x004, '0030', 'controller problem, receive error passive, transmit error passive'),
        (0x004, '01', 'controller problem'),
        (0x008, '0030', 'protocol violation'),
    ],
)
def test_error_frames_have_the_words_of_linux(identifier, data, words):
    frame = can.Message(
        arbitration_id=identifier,
        is_error_frame=True,
        data=bytes.fromhex(data),
    )
    assert can_bus.error_words(frame) == words


@pytest.mark.parametrize(
    ('own', 'bitrate', 'calls'),
    [
        (False, 0, [{}]),
        # Where the interface cannot return the frames sent, it is opened without.
        (
            True,
            125_000,
            [{'bitrate': 125_000, 'receive_own_messages': True}, {'bitrate': 125_000}],
        ),
    ],
)
def test_a_bus_is_opened_with_what_its_interface_takes(monkeypatch, own, bitrate, calls):
    made = Mock(side_effect=[NotImplementedError, 'bus'] if own else ['bus'])
    monkeypatch.setattr(can, 'Bus', made)
    logging.getLogger('can').setLevel(logging.NOTSET)
    assert can_bus.open_bus('virtual', 'can7', bitrate, own) == 'bus'
    assert made.call_args_list == [
        call(interface='virtual', channel='can7', **options) for options in calls
    ]
    # python-can would log what it also raises.
    assert logging.getLogger('can').level == logging.CRITICAL


@pytest.mark.parametrize(
    'frames',
    [
        # Without times, those of arrival; near this clock, the interface's; a day away, another
        # epoch.
        ((0.0, 0.0, 0.0),),
        *(((T0 - delay, 0.0, -delay),) for delay in (0.0, 1.0, OWN_EPOCH - 1.0, 1.0 - OWN_EPOCH)),
        ((T0 - OWN_EPOCH, 0.0, 0.0),),
        ((T0 + OWN_EPOCH, 0.0, 0.0),),
        # The least delay of this span and the one before counts.
        (
            (10.0, 0.005, 0.005),
            (10.1, 0.102, 0.102),
            (10.2, 0.207, 0.202),
            (11.1, 1.106, 1.102),
            (11.2, 1.204, 1.202),
            (12.2, 2.209, 2.204),
            (12.3, 2.308, 2.304),
            (13.4, 3.409, 3.408),
        ),
        # A span ends after exactly a second.
        ((10.0, 0.0, 0.0), (9.998, 0.0, -0.002), (10.994, 1.0, 0.994), (11.989, 2.0, 1.995)),
        # An offset holds up to a day's difference forward; a step back is a new one.
        ((1e6, 0.0, 0.0), (1e6 - 1.0, 0.0, -1.0), (1e6 - 2.5, 0.0, 0.0)),
        # A device that restarts gets a new offset at once.
        ((200_000.0, 0.0, 0.0), (1.0, 0.5, 0.5), (1.1, 0.65, 0.6)),
        # A clock that is set back begins a new span.
        (
            (100.0, 0.0, 0.0),
            (101.0, -3600.0, -3600.0),
            (101.1, -3599.7, -3599.9),
            (102.5, -3598.6, -3598.6),
        ),
    ],
)
def test_receive_times_are_mapped_with_the_least_delay(frames):
    clock = can_bus.ReceiveClock()
    for received, arrived, expected in frames:
        assert clock.epoch(received, T0 + arrived) == pytest.approx(T0 + expected, abs=1e-6)
