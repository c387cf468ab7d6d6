# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rate, latency and missing samples of the orientations, and what of it is a warning."""

from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from spm_haptic_master.nodes import orientation_status
from spm_haptic_master.nodes.orientation_status import LatencyStatus
from spm_haptic_master.ros.overload import TOO_BUSY

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
RATE = 100.0
PERIOD = 10_000_000
DELAY = 400_000


@pytest.fixture
def timing(monkeypatch):
    """Give the status, and a list of what it publishes."""
    entries = []
    monkeypatch.setattr(
        orientation_status.diagnostic_status,
        'StatusPublisher',
        lambda *_, **__: SimpleNamespace(publish=lambda *entry: entries.append(entry)),
    )
    return LatencyStatus(None, RATE, 0.005), entries


def second(timing, first, count=100, period=PERIOD, delay=DELAY, parity=(1.0, -0.5)):
    """Publish a second of orientations; return level and text of the entry, and its values."""
    status, entries = timing
    for number in range(count):
        stamp = first + number * period
        status.add(stamp, stamp + delay, parity[number % 2])
    status.publish()
    level, text, values = entries[-1]
    return (level, text), values


def test_a_second_without_a_loss(timing):
    assert second(timing, 0)[0] == (OK, 'in time')
    entry, values = second(timing, 100 * PERIOD)
    assert entry == (OK, 'in time')
    values.pop('orientation rate (Hz)')
    assert values == {
        'missed deadlines': 0,
        'missed in the last second': 0,
        **{
            f'latency {name} (us)': pytest.approx(400.0, rel=0.1)
            for name in ('p50', 'p90', 'p99', 'max')
        },
        'parity mean (sigma)': 0.25,
        'parity deviation (sigma)': 0.75,
    }
    assert timing[0].parity == -0.5


def test_the_parity_is_that_of_one_second(timing):
    second(timing, 0, parity=(3.0, 3.0))
    values = second(timing, 100 * PERIOD, parity=(0.5, 0.5))[1]
    assert (values['parity mean (sigma)'], values['parity deviation (sigma)']) == (0.5, 0.0)


@pytest.mark.parametrize(
    ('lost', 'expected'),
    [
        (2, (OK, 'in time')),
        (3, (WARN, 'samples missing')),
    ],
)
def test_missing_samples_are_counted_by_the_stamps(timing, lost, expected):
    second(timing, 0)
    for busy in ('', 'a cause'):
        begin = timing[0]._last + (1 + lost) * PERIOD
        timing[0].busy = busy
        entry, values = second(timing, begin, 100 - lost)
        assert entry == ((WARN, busy) if busy and lost > 2 else expected)
        assert values['missed in the last second'] == lost
    assert values['missed deadlines'] == 2 * lost
    # The cause of one second is not that of the next.
    assert timing[0].busy == ''


def test_a_rate_that_is_not_the_drivers_is_reported(timing):
    """In two processes, which cannot compare their parameters; jitter of 10 % is none."""
    assert second(timing, 0, 108, PERIOD // 108 * 100)[0] == (OK, 'in time')
    for number, (period, words) in enumerate(
        (
            (PERIOD // 108 * 100, 'in time'),
            (PERIOD // 2, 'more samples than expected'),
            (2 * PERIOD, 'samples missing'),
        ),
        1,
    ):
        begin = timing[0]._last + period
        count = round(1e9 / period)
        assert second(timing, begin, count, period)[0] == (OK if number == 1 else WARN, words)


def test_late_orientations_are_an_overload_and_none_is_a_warning(timing):
    assert second(timing, 0, delay=8_000_000)[0] == (
        WARN,
        f'{TOO_BUSY}: latency p99 more than 0.005 s',
    )
    entry, values = second(timing, 0, count=0)
    assert entry == (WARN, 'no orientations')
    assert list(values) == [
        'orientation rate (Hz)',
        'missed deadlines',
        'missed in the last second',
    ]
