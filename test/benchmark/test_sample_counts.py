# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures from the entries on /diagnostics."""

from spm_haptic_master.benchmark.sample_counts import reported


def test_a_figure_is_that_of_its_entry():
    """Another entry has one of the same name, and no figure at that."""
    statuses = [(1, 'fkm: timing', {'latency p50 (us)': '120'}),
                (2, 'teleop', {'latency p50 (us)': 'none'}), (3, 'fkm: timing', {}),
                (4, 'fkm: timing', {'latency p50 (us)': '130'})]
    assert reported(statuses, 'fkm: timing', 'latency p50 (us)') == [120.0, 130.0]
