# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the thread of the samples changes while a report reads it.

A report that reads an attribute once to check it and once to use it may get None the second time;
the TypeError that follows ends the process.
"""

import time

import pytest
from spm_haptic_master.encoders.can_source import CanSource
from spm_haptic_master.encoders.canopen_nodes import Node


class Fleeting:
    """An object whose attributes are there when they are read first, and None from then on."""

    def __init__(self, **values):
        self._values = values

    def __getattr__(self, name):
        return self._values.pop(name, None)


@pytest.mark.parametrize(('values', 'words'), [
    ({'emergency': 'generic error'}, 'generic error'), ({'heard': 1.0}, 'heartbeat lost'),
    ({'state': 4}, 'stopped')])
def test_troubles_cautions_and_figures_of_a_node(values, words):
    class FleetingNode(Node):
        """Its state is there once."""

    def node():
        left = {'emergency': None, 'heard': None, 'state': None, **values}
        for name in left:
            setattr(FleetingNode, name, property(
                lambda _, name=name: left.pop(name, None), lambda *_: None))
        return FleetingNode('joint_1b', 2, 0.5)

    assert node().trouble(10.0) == words
    assert node().caution(10.0) == (None if 'state' in values else words)
    assert node().unfit(10.0) in (None, words)
    assert words in str(node().statistics(10.0)) or 'heard' in values


@pytest.mark.parametrize(('attribute', 'of_decoder', 'fault'), [
    ('_failure', {}, 'can can0: down'), ('_send_error', {}, 'no frames on can0 (sending: down)'),
    (None, {'bus_error': 'down'}, 'can0: down')])
def test_faults_of_a_bus(attribute, of_decoder, fault):
    class Source(CanSource):
        """Its attribute is there once."""

    source = CanSource.__new__(Source)
    source.__dict__ |= {
        '_failure': None, '_send_error': None, '_name': 'can0', '_last_set': None,
        '_timeout': 0.1, '_reason_since': float('-inf'),
        '_last_frame': None if attribute else time.monotonic(),
        '_decoder': Fleeting(silent=lambda *_: (), encoders=(), **of_decoder)}
    values = ['can can0: down' if attribute == '_failure' else 'down']
    if attribute:
        setattr(Source, attribute, property(lambda _: values.pop() if values else None))
    assert source.fault == fault
