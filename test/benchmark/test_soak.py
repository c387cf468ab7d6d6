# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The soak in a short form, and what its report counts."""

import re

from benchmarks import soak, stalls
from benchmarks.disturbances import Schedule
from benchmarks.soak_report import growth, MOST_REASONS, reason_lines
import numpy as np
import pytest


@pytest.mark.process
@pytest.mark.alone
@pytest.mark.evidence
def test_soak_survives_failures_of_the_bus(measured, monkeypatch):
    # "Minutes" of a second, and failures and visitors every few of them.
    monkeypatch.setattr(
        soak,
        'SCHEDULE',
        Schedule(
            minute=1.0,
            failure_period=4.0,
            failure=1.0,
            visit_period=7.0,
            visit=6.0,
        ),
    )
    out = measured(soak.main, '--minutes', '14', '--apart')
    for pattern in (
        *(
            rf'resident memory of {name}: [\d.]+ MiB, growth'
            for name in ('recorder', 'fkm', 'diagnostics', 'encoder_driver')
        ),
        r'5 minutes: \d+ orientations; resident memory, MiB: observer [\d.]+',
        *(
            rf'latency, {part} [\d.]+ minutes: (p50 \d+ p99 \d+|no orientation \(control)'
            for part in ('first', 'last')
        ),
        # Of 14 s: bus-off after 4, power lost after 8, and again.
        r'failures of the bus: [2-9]; bus opened again [1-9] times; first',
        r'came and went: [1-9]',
        r'while the bus was alive: \d+.*; of these without a rejected sample: \d+',
    ):
        assert re.search(pattern, out), out
    cycles, made, missing, recorded = map(
        int,
        re.search(
            r'samples: (\d+) cycles, (\d+) made, (\d+) without .* rejected by fkm; (\d+) ', out
        ).groups(),
    )
    assert 0 <= missing < made <= cycles + 1
    assert recorded > 0


def test_only_the_most_frequent_reasons_are_printed_one_by_one():
    lines = list(
        reason_lines({f'dropped: {count}': count for count in range(1, MOST_REASONS + 3)})
    )
    assert len(lines) == MOST_REASONS + 1
    assert lines[0] == f'dropped: {MOST_REASONS + 2}: {MOST_REASONS + 2}'
    assert lines[-1] == '2 other reasons: 3'


def test_stalls_are_counted_only_while_the_bus_is_alive():
    """Orientations from 0 to 10 s and 14 to 16 s; the bus is dead from 10 to 13 s."""
    arrivals = np.concatenate([np.arange(0.0, 10.0, 0.5), np.arange(14.5, 16.0, 0.5)])
    gaps, restarts = stalls.stalls(arrivals, [(0.0, 10.0), (13.0, 20.0)])
    assert gaps == [(13.0, 1.5), (15.5, 4.5)]
    assert restarts == [1.5]
    assert stalls.stalls(arrivals, [(0.0, 10.0), (11.0, 13.0)]) == ([(11.0, 2.0)], [2.0])


def test_a_gap_is_explained_by_samples_rejected_in_it():
    seconds = np.arange(0.0, 20.0)
    # Rejected from 4 to 8 s.
    rejections = np.column_stack([seconds * 1e9, np.clip(seconds - 4.0, 0.0, 4.0) * 100.0])
    assert stalls.unexplained([(5.2, 1.5), (12.0, 2.5)], rejections) == [2.5]
    assert stalls.unexplained([(5.2, 1.5)], rejections[:0]) == [1.5]


def test_counts_grow_from_the_first_status_of_their_name():
    assert growth(
        [
            (1, 'fkm', {'sets': '5', 'state': 'healthy'}),
            (2, 'driver', {'made': '1'}),
            (3, 'fkm', {'sets': '9', 'lost': '2', 'state': '7'}),
        ]
    ) == {'sets': 4, 'lost': 2, 'made': 0}
