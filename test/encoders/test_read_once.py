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
from spm_haptic_master.encoders.canopen_nodes import CanopenNodes


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
    def nodes():
        found = CanopenNodes(('joint_1b',), (2,), 0.5)
        found.nodes = (Fleeting(joint='joint_1b', node_id=2, **values),)
        return found

    assert nodes().trouble(0, 10.0) == words
    assert nodes().cautions(10.0) == ({} if 'state' in values else {0: words})
    assert nodes().emergencies() == ({0: words} if 'emergency' in values else {})
    assert ('stopped' in [*nodes().statistics(10.0).values()][0]) == ('state' in values)


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
