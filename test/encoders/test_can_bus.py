# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of a bus in one line, with what to do where python-can does not say it."""

import errno
import json
import os
import sys

import can
import pytest
from recorded_text import assert_recorded
from spm_haptic_master.encoders import can_bus


def test_a_missing_msgpack_has_a_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, 'msgpack', None)
    for name in [name for name in sys.modules if 'udp_multicast' in name]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(can_bus.BUS_ERRORS) as caught:
        can_bus.open_bus('udp_multicast', '239.74.0.1', 0)
    assert can_bus.first_line(caught.value) == (
        'msgpack not installed: sudo apt install python3-msgpack; in a virtual environment: pip '
        'install msgpack')


@pytest.mark.parametrize(('number', 'words'), [
    (errno.EAFNOSUPPORT, ['this machine has no SocketCAN', '--params-file rig.yaml',
                          'can.interface:=']),
    (errno.ENODEV, ['ip link', '--params-file rig.yaml', 'can.channel:='])])
def test_a_bus_that_is_not_there_says_what_to_give(number, words):
    for error in (OSError(number, os.strerror(number)),
                  can.CanInitializationError(os.strerror(number), number)):
        text = can_bus.first_line(error)
        assert os.strerror(number) in text and '\n' not in text
        assert all(word in text for word in words)


@pytest.mark.parametrize(('config', 'expected'), [
    ({}, 'udp_multicast 239.74.0.1 port 43113'),
    ({'port': 43999}, 'udp_multicast 239.74.0.1 port 43999')])
def test_the_name_of_a_bus_between_processes_has_its_port(monkeypatch, config, expected):
    monkeypatch.setenv('CAN_CONFIG', json.dumps(config))
    assert can_bus.bus_name('udp_multicast', '239.74.0.1') == expected
    assert can_bus.bus_name('socketcan', 'can0') == 'socketcan can0'
    monkeypatch.setenv('CAN_CONFIG', '{')
    assert can_bus.bus_name('udp_multicast', '239.74.0.1') == 'udp_multicast 239.74.0.1'


def test_error_frames_have_the_words_of_linux():
    """Classes in the identifier, and byte 1 of a controller's (linux/can/error.h)."""
    frames = [*((1 << bit, b'') for bit in range(11)),
              *((0x004, bytes((0, 1 << bit))) for bit in range(8)),
              # Several; too short for details, and details of another class.
              (0x088, b''), (0x041, b''), (0x004, b'\x00\x30'), (0x004, b'\x01'),
              (0x008, b'\x00\x30')]
    assert_recorded('encoders/error_frames.txt', ''.join(
        f'0x{identifier:03X} {data.hex()}: ' + can_bus.error_words(can.Message(
            arbitration_id=identifier, is_error_frame=True, data=data)) + '\n'
        for identifier, data in frames))
