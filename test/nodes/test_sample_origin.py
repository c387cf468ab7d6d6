# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Why no sample is taken: rivals, another driver, and whose clock or machine is to blame."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from in_process import hosted
import pytest
from rclpy.node import Node
from spm_haptic_master.nodes.sample_origin import host, SampleOrigin
from spm_haptic_master.ros.overload import TOO_BUSY

SECOND = 10**9


@pytest.fixture
def graph():
    """Give a hosted node; `report` gives it an entry of a driver on /diagnostics."""
    with hosted(lambda _: Node('fkm')) as graph:
        def report(name='encoder_driver', aspect='encoders', **values):
            graph.give('/diagnostics', DiagnosticArray(status=[DiagnosticStatus(
                name=f'{name}: {aspect}', values=[
                    KeyValue(key=key.replace('_', ' '), value=value)
                    for key, value in values.items()])]))

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
    assert words.startswith('2 publishers on /orientation: ') and expected == 'expected one'
    del graph.publishers['/orientation']
    graph.pause(0.21)
    assert obstacle(graph, origin)[0] == 'another mechanism in the driver'


@pytest.mark.parametrize(('values', 'expected'), [
    ({'mechanism': 'other'}, (
        'another mechanism in the driver', 'encoder_driver has other, expected abc: '
        'give geometry.* and working_mode for all nodes, /**')),
    # With the noise and the bias of no calibration the levels would be too small.
    ({'mechanism': 'abc', 'calibration': '2026'}, (
        'another calibration in the driver', 'encoder_driver has 2026, expected not named: '
        'give fkm the calibration file of the driver')),
    ({'mechanism': 'abc', 'calibration': 'not named'}, None), ({}, None)])
def test_a_driver_that_differs_is_named_as_long_as_it_publishes(graph, origin, values, expected):
    graph.report(**values)
    assert obstacle(graph, origin) == expected
    graph.publishers['/measured_js'] = ('encoder_driver_2',)
    assert obstacle(graph, origin) is None


def test_other_drivers_and_other_entries_are_none_of_it(graph, origin):
    graph.report('other/encoder_driver', mechanism='other')
    graph.report(aspect='motors', mechanism='other')
    assert obstacle(graph, origin) is None


STALE = 'stale sample: 0.300000 s old, limit 0.1 s'


@pytest.mark.parametrize(('its_host', 'is_simulated', 'expected'), [
    (host(), False, f'{TOO_BUSY}: a sample is more than 0.2 s old, limit 0.1 s'),
    (host(), True, STALE), (None, False, STALE),
    ('another boot', False, f'{STALE}; are the clocks of the two hosts synchronized?')])
def test_only_another_host_may_have_another_clock(
        graph, origin, its_host, is_simulated, expected):
    """By what the driver reports of its host; of another publisher nothing is known."""
    if its_host is not None:
        graph.report(host=its_host)
    obstacle(graph, origin)
    age, limit = 300_000_000, 100_000_000
    assert str(origin.rejection(age, limit, is_simulated)) == expected
    assert str(origin.rejection(-age, limit, is_simulated)).startswith(
        'sample from the future: -0.300000 s old, limit 0.1 s')


def test_a_driver_in_this_process_has_this_clock(graph):
    assert SampleOrigin(graph.node, 'abc', '').rejection(SECOND, 10**8, False).reason == TOO_BUSY


def test_a_driver_of_this_host_that_loses_time_is_heard_for_three_seconds(graph, origin):
    words = 'this machine is too busy'
    graph.report('other/encoder_driver', host='another boot', too_busy=words)
    graph.report(host=host(), too_busy='no')
    assert origin.overload() == ''
    graph.report(host=host(), too_busy=words)
    graph.pause(2.9)
    assert origin.overload() == words
    graph.pause(0.1)
    assert origin.overload() == ''
