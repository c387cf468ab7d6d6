# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of a bus in one line, with what to do where python-can does not say it."""

import sys

import pytest
from spm_haptic_master.encoders.bus_errors import BUS_ERRORS, first_line
from spm_haptic_master.encoders.can_source import open_bus


def test_the_first_line_is_enough():
    assert first_line(OSError('down\nTraceback')) == 'down'
    assert first_line(ValueError()) == 'ValueError'


def test_a_missing_msgpack_has_a_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, 'msgpack', None)
    for name in [name for name in sys.modules if 'udp_multicast' in name]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(BUS_ERRORS) as caught:
        open_bus('udp_multicast', '239.74.0.1', 0)
    assert first_line(caught.value) == 'msgpack not installed: sudo apt install python3-msgpack'
