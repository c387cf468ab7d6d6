# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the thread of the samples changes while a report reads it.

A report that reads an attribute once to check it and once to use it may get None the second time;
the TypeError that follows ends the process.
"""

import time
from types import SimpleNamespace

import pytest
from spm_haptic_master.encoders.can_source import CanSource
from spm_haptic_master.encoders.canopen_nodes import CanopenNodes


class Fleeting:
    """An object whose attributes are there when they are read first, and None from then on."""

    def __init__(self, **values):
        self._values = values

    def __getattr__(self, name):
        return self._values.pop(name, None)


def nodes(**values):
    found = CanopenNodes(('joint_1b',), (2,), 0.5)
    found.nodes = (Fleeting(joint='joint_1b', **values),)
    return found


@pytest.mark.parametrize(('values', 'trouble'), [
    ({'emergency': 'generic error'}, 'generic error'), ({'heard': 1.0}, 'heartbeat lost'),
    ({'state': 4}, 'stopped')])
def test_trouble_of_a_node(values, trouble):
    assert nodes(**values).trouble(0, 10.0) == trouble


@pytest.mark.parametrize(('values', 'caution'), [
    ({'emergency': 'generic error'}, 'generic error'), ({'heard': 1.0}, 'heartbeat lost')])
def test_caution_of_a_node(values, caution):
    assert nodes(**values).cautions(10.0) == {0: caution}


def test_emergencies_of_nodes():
    assert nodes(emergency='generic error').emergencies() == {0: 'generic error'}


def test_figures_of_a_node():
    (figure, *_) = nodes(state=5, heard=9.9, node_id=2).statistics(10.0).values()
    assert figure == 'operational, heartbeat 100 ms ago'


def fleeting(**values):
    """Return a source on a bus, with attributes that are None when they are read again."""
    class Source(CanSource):
        """Its attributes are there once."""

    source = CanSource.__new__(Source)
    for name in values:
        setattr(Source, name, property(lambda _, name=name: values.pop(name, None)))
    return source


def test_failure_of_a_bus():
    assert fleeting(_failure='can can0: down').fault == 'can can0: down'


def test_refused_sending():
    source = fleeting(_send_error='buffer full', _failure=None)
    source._name, source._last_set, source._last_frame = 'can can0', None, None
    source._timeout, source._reason_since = 0.1, float('-inf')
    source._decoder = SimpleNamespace(bus_off=False, network=None, silent=lambda *_: ())
    assert source.fault == 'no frames on can can0 (sending: buffer full)'


def test_error_frames():
    source = fleeting(_failure=None)
    source._name, source._last_set, source._last_frame = 'can can0', None, time.monotonic()
    source._timeout, source._reason_since = 0.1, float('-inf')

    class Decoder(Fleeting):
        encoders = ()

        def silent(self, *_):
            return ()

    source._decoder = Decoder(bus_error='bus-off is near')
    assert source.fault == 'can can0: bus-off is near'
