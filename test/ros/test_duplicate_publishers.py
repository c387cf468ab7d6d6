# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A process that finds another publisher on its topics; the test makes the time."""

from types import SimpleNamespace

import pytest
from rclpy.executors import ExternalShutdownException
from spm_haptic_master.exceptions import RivalError
from spm_haptic_master.ros import duplicate_publishers
from spm_haptic_master.ros.duplicate_publishers import LOOK, LOOK_PERIOD, NO_NAME, wait_until_alone


@pytest.fixture
def search(monkeypatch):
    """Return what searches where the looks find `found`, and returns the number of looks."""
    lines = []
    node = SimpleNamespace(resolve_topic_name=lambda topic: f'/{topic}', destroy_node=lambda: None)
    monkeypatch.setattr(duplicate_publishers, 'Node', lambda name, **_: node)
    monkeypatch.setattr(
        duplicate_publishers.node_log,
        'warning',
        lambda _, text: lines.append(text.partition(' already')[0]),
    )

    def search(found, period=LOOK_PERIOD, is_ended=lambda: False):
        slept = []
        monkeypatch.setattr(
            duplicate_publishers,
            'time',
            SimpleNamespace(monotonic=lambda: 100.0 + period * len(slept), sleep=slept.append),
        )
        monkeypatch.setattr(
            duplicate_publishers, 'publishers', lambda node, topic: found(period * len(slept))
        )
        wait_until_alone({'fkm': 'orientation'}, is_ended)
        return len(slept)

    search.lines = lines
    return search


@pytest.mark.parametrize(
    ('named_after', 'printed'),
    [
        (0.5 * LOOK, ['/fkm']),
        (2.0 * LOOK, ['a node without a name', '/fkm']),
    ],
)
def test_a_node_whose_name_comes_late_is_named(search, named_after, printed):
    with pytest.raises(RivalError, match='/orientation is published by /fkm already'):
        search(lambda passed: ('/fkm' if passed > named_after else NO_NAME,))
    assert search.lines == [
        f'nothing published: /orientation is published by {name}' for name in printed
    ]


def test_it_waits_for_the_end_of_another_publisher_and_longer_on_a_busy_machine(search):
    assert search(lambda passed: ('/fkm',) if passed < 3.0 else ()) > 3.0 / LOOK_PERIOD
    # The first round takes no time; of one of 0.2 s counts `LONGEST_ROUND`.
    assert [search(lambda _: (), period) for period in (0.2, 0.015625)] == [10, 33]
    with pytest.raises(ExternalShutdownException):
        search(lambda passed: (), is_ended=lambda: True)
