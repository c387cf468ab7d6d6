# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An entry on /diagnostics: when it is due, what it has, and what is logged of its changes."""

from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from rclpy.time import Time
from spm_haptic_master.ros import diagnostic_status
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, StatusPublisher, WARN


@pytest.fixture
def entry(monkeypatch):
    """Give an entry, what it has published and logged, and the time, s."""
    published = []
    logged = []
    now = [5.0]
    node = SimpleNamespace(
        create_publisher=lambda kind, topic, depth: SimpleNamespace(publish=published.append),
        get_fully_qualified_name=lambda: '/left/fkm',
        get_clock=lambda: SimpleNamespace(now=lambda: Time(seconds=7)),
    )
    for name in ('error', 'warning', 'info'):
        monkeypatch.setattr(
            diagnostic_status.node_log,
            name,
            lambda _, text, name=name: logged.append((name, text)),
        )
    monkeypatch.setattr(diagnostic_status.time, 'monotonic', lambda: now[0])
    return StatusPublisher(node, 'orientation', 'hardware'), published, logged, now


def test_an_entry_has_name_level_message_and_values(entry):
    status, published, _, _ = entry
    status.publish(WARN, 'starting', {'rate': 1000.123456, 'sensors': 4})
    (array,) = published
    assert array.header.stamp.sec == 7
    assert array.status == [
        DiagnosticStatus(
            level=WARN,
            name='left/fkm: orientation',
            message='starting',
            hardware_id='hardware',
            values=[KeyValue(key='rate', value='1000.12'), KeyValue(key='sensors', value='4')],
        )
    ]


def test_an_entry_is_due_when_it_changes_and_every_second(entry):
    status, _, _, now = entry
    assert status.is_due(OK, 'healthy')
    status.publish(OK, 'healthy', {})
    assert not status.is_due(OK, 'healthy')
    assert status.is_due(WARN, 'healthy')
    assert status.is_due(OK, 'starting')
    now[0] += 0.99
    assert not status.is_due(OK, 'healthy')
    now[0] += 0.02
    assert status.is_due(OK, 'healthy')
    # A message with figures that run is recognised by its subject.
    status.publish(OK, 'healthy since 3 s', {}, subject='healthy')
    assert not status.is_due(OK, 'healthy')


@pytest.mark.parametrize(
    ('published', 'lines'),
    [
        # A healthy entry is not logged; an error and its end are, once.
        (
            [
                (OK, 'healthy'),
                (ERROR, 'silent'),
                (ERROR, 'silent'),
                (OK, 'healthy'),
            ],
            [('error', 'silent'), ('info', 'healthy')],
        ),
        (
            [(OK, 'healthy'), (WARN, 'slow'), (WARN, 'slower'), (OK, 'healthy')],
            [('warning', 'slow'), ('warning', 'slower'), ('info', 'healthy')],
        ),
        (
            [(ERROR, 'silent'), (WARN, 'starting'), (OK, 'healthy'), (OK, 'fine')],
            [('error', 'silent'), ('warning', 'starting'), ('info', 'healthy')],
        ),
        # A caution of normal work is logged as what it is given for.
        (
            [
                (OK, 'healthy'),
                (WARN, 'caution', (OK, 'healthy')),
                (ERROR, 'silent', (ERROR, 'bus-off')),
            ],
            [('error', 'bus-off')],
        ),
    ],
)
def test_an_error_a_warning_and_their_end_are_logged(entry, published, lines):
    status, _, found, _ = entry
    for level, message, *logged in published:
        status.publish(level, message, {}, None, *logged)
        assert status.message == message
    assert found == lines
    StatusPublisher(status._node, 'timing', '', logs=False).publish(ERROR, 'late', {})
    assert found == lines


def test_of_a_node_that_starts_nothing_is_logged_but_what_is_wrong_when_it_has_started(entry):
    """As of five sensors of which one has an error from before the start."""
    status, _, found, _ = entry
    status.publish(WARN, 'starting', {}, starting=True)
    assert found == []
    for _ in range(2):
        status.publish(WARN, 'degraded: joint_3b missing', {})
    assert found == [('warning', 'degraded: joint_3b missing')]
    # It waits again: no longer a start.
    status.publish(WARN, 'starting', {}, starting=True)
    assert found[1:] == [('warning', 'starting')]
