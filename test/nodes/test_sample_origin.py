# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Why no sample is taken: rivals, another driver, and an age by clock or machine."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from in_process import hosted
import pytest
from rclpy.node import Node
from spm_haptic_master.nodes.sample_origin import SampleOrigin
from spm_haptic_master.ros.overload import TOO_BUSY


@pytest.fixture
def graph():
    """Give a hosted node; `report` gives it an entry of a driver on /diagnostics."""
    with hosted(lambda _: Node('fkm')) as graph:

        def report(name='encoder_driver', aspect='encoders', **values):
            graph.give(
                '/diagnostics',
                DiagnosticArray(
                    status=[
                        DiagnosticStatus(
                            name=f'{name}: {aspect}',
                            values=[
                                KeyValue(key=key.replace('_', ' '), value=value)
                                for key, value in values.items()
                            ],
                        )
                    ]
                ),
            )

        graph.report = report
        graph.publishers['/measured_js'] = ('encoder_driver',)
        yield graph


@pytest.fixture
def origin(graph):
    found = SampleOrigin(graph.node, 'abc', '')
    found.watch()
    return found


def obstacle(graph, origin):
    """Return what is found at the next look: one each 0.2 s."""
    graph.pause(0.21)
    return origin.obstacle()


def test_rivals_are_looked_for_now_and_then_and_override_all(graph, origin):
    assert obstacle(graph, origin) is None
    graph.publishers['/orientation'] = 'fkm', 'other'
    graph.pause(0.19)
    assert origin.obstacle() is None
    graph.report(mechanism='other')
    words, expected = obstacle(graph, origin)
    assert words.startswith('2 publishers on /orientation: ')
    assert expected == 'expected one'
    del graph.publishers['/orientation']
    graph.pause(0.21)
    assert obstacle(graph, origin)[0] == 'another mechanism in the driver'


@pytest.mark.parametrize(
    ('values', 'expected'),
    [
        (
            {'mechanism': 'other'},
            (
                'another mechanism in the driver',
                'encoder_driver has other, expected abc: '
                'give geometry.* and working_mode for all nodes, /**',
            ),
        ),
        # With the noise and the bias of no calibration the levels would be too small.
        (
            {'mechanism': 'abc', 'calibration': '2026'},
            (
                'another calibration in the driver',
                'encoder_driver has 2026, expected not named: '
                'give fkm the calibration file of the driver',
            ),
        ),
        ({'mechanism': 'abc', 'calibration': 'not named'}, None),
        ({}, None),
    ],
)
def test_a_driver_that_differs_is_named_as_long_as_it_publishes(graph, origin, values, expected):
    graph.report(**values)
    assert obstacle(graph, origin) == expected
    graph.publishers['/measured_js'] = ('encoder_driver_2',)
    assert obstacle(graph, origin) is None


def test_other_drivers_and_other_entries_are_none_of_it(graph, origin):
    graph.report('other/encoder_driver', mechanism='other')
    graph.report(aspect='motors', mechanism='other')
    assert obstacle(graph, origin) is None


@pytest.mark.parametrize('is_watching', [True, False])
def test_only_a_driver_in_this_process_surely_has_this_clock(graph, is_watching):
    origin = SampleOrigin(graph.node, 'abc', '')
    if is_watching:
        origin.watch()
    limit = 100_000_000
    asks = 'limit 0.1 s: a host is too busy, or the clocks of two hosts are not synchronized'
    assert str(origin.rejection(300_000_000, limit)) == (
        f'stale sample: 0.300000 s old, {asks}'
        if is_watching
        else f'{TOO_BUSY}: a sample is more than 0.2 s old, limit 0.1 s'
    )
    assert str(origin.rejection(-300_000_000, limit)) == (
        f'sample from the future: -0.300000 s old, {asks}'
    )
