# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Why no sample is taken: rivals, another driver, and whose clock or machine is to blame."""

from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import pytest
from rclpy.serialization import serialize_message
from spm_haptic_master.nodes import sample_origin
from spm_haptic_master.nodes.sample_origin import host, SampleOrigin
from spm_haptic_master.ros.overload import TOO_BUSY

SECOND = 10**9


class Graph:
    """A node whose graph and clock the test makes."""

    def __init__(self, monkeypatch):
        self.now, self.rivals, self.names = 100.0, None, ['encoder_driver']
        monkeypatch.setattr(sample_origin.time, 'monotonic', lambda: self.now)
        monkeypatch.setattr(sample_origin, 'Rivals', lambda *_: SimpleNamespace(
            found=lambda: self.rivals))

    def resolve_topic_name(self, topic):
        return f'/left/{topic}'

    def create_subscription(self, kind, topic, callback, depth, raw):
        assert (kind, topic, raw) == (DiagnosticArray, '/diagnostics', True)
        self.callback = callback

    def get_publishers_info_by_topic(self, topic):
        assert topic == '/left/measured_js'
        return [SimpleNamespace(node_namespace='/left', node_name=name) for name in self.names]

    def report(self, name='left/encoder_driver', aspect='encoders', **values):
        entry = DiagnosticStatus(name=f'{name}: {aspect}', values=[
            KeyValue(key=key.replace('_', ' '), value=value) for key, value in values.items()])
        self.callback(serialize_message(DiagnosticArray(status=[entry])))


@pytest.fixture
def graph(monkeypatch):
    return Graph(monkeypatch)


@pytest.fixture
def origin(graph):
    found = SampleOrigin(graph, 'abc', '')
    found.watch()
    return found


def obstacle(graph, origin):
    """Return what is found at the next look: one each 0.2 s."""
    graph.now += 0.2
    return origin.obstacle()


def test_rivals_are_looked_for_now_and_then_and_override_all(graph, origin):
    assert obstacle(graph, origin) is None
    graph.rivals = '2 publishers on /orientation'
    graph.now += 0.19
    assert origin.obstacle() is None
    graph.report(mechanism='other')
    assert obstacle(graph, origin) == ('2 publishers on /orientation', 'expected one')
    graph.rivals = None
    assert obstacle(graph, origin)[0] == 'another mechanism in the driver'


@pytest.mark.parametrize(('values', 'expected'), [
    ({'mechanism': 'other'}, (
        'another mechanism in the driver', 'left/encoder_driver has other, expected abc: '
        'give geometry.* and working_mode for all nodes, /**')),
    # With the noise and the bias of no calibration the levels would be too small.
    ({'mechanism': 'abc', 'calibration': '2026'}, (
        'another calibration in the driver', 'left/encoder_driver has 2026, expected not named: '
        'give fkm the calibration file of the driver')),
    ({'mechanism': 'abc', 'calibration': 'not named'}, None), ({}, None)])
def test_a_driver_that_differs_is_named_as_long_as_it_publishes(graph, origin, values, expected):
    graph.names = ['another_program', 'encoder_driver']
    graph.report(**values)
    assert obstacle(graph, origin) == expected
    graph.names = ['encoder_driver_2']
    assert obstacle(graph, origin) is None


def test_other_drivers_and_other_entries_are_none_of_it(graph, origin):
    graph.report('right/encoder_driver', mechanism='other')
    graph.report(aspect='motors', mechanism='other')
    assert obstacle(graph, origin) is None


@pytest.mark.parametrize(('hosts', 'is_simulated', 'expected'), [
    ((host(),), False, f'{TOO_BUSY}: a sample is more than 0.2 s old, limit 0.1 s'),
    ((host(),), True, 'stale sample: 0.300000 s old, limit 0.1 s'),
    ((), False, 'stale sample: 0.300000 s old, limit 0.1 s'),
    (('another boot',), False, 'stale sample: 0.300000 s old, limit 0.1 s; are the clocks of the '
     'two hosts synchronized?'),
    ((host(), 'another boot'), False, 'stale sample: 0.300000 s old, limit 0.1 s; are the clocks '
     'of the two hosts synchronized?')])
def test_only_another_host_may_have_another_clock(graph, origin, hosts, is_simulated, expected):
    """By what the driver reports of its host; of other publishers nothing is known."""
    graph.names = [f'driver_{number}' for number in range(len(hosts))]
    for number, name in enumerate(hosts):
        graph.report(f'left/driver_{number}', host=name)
    obstacle(graph, origin)
    age, limit = 300_000_000, 100_000_000
    assert str(origin.rejection(age, limit, is_simulated)) == expected
    assert str(origin.rejection(-age, limit, is_simulated)).startswith(
        'sample from the future: -0.300000 s old, limit 0.1 s')


def test_a_driver_in_this_process_has_this_clock(graph):
    assert SampleOrigin(graph, 'abc', '').rejection(SECOND, 10**8, False).reason == TOO_BUSY


def test_a_driver_of_this_host_that_loses_time_is_heard_for_three_seconds(graph, origin):
    words = 'this machine is too busy'
    graph.report('right/encoder_driver', host='another boot', too_busy=words)
    graph.report(host=host(), too_busy='no')
    assert origin.overload() == ''
    graph.report(host=host(), too_busy=words)
    graph.now += 2.9
    assert origin.overload() == words
    graph.now += 0.1
    assert origin.overload() == ''
