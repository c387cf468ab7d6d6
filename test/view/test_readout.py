# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is due once a period, and plots with a gap where nothing was seen."""

from types import SimpleNamespace

import numpy as np
import pytest

periodic = pytest.importorskip('spm_haptic_master.view.periodic')
pytest.importorskip('viser', reason='viser is not installed (extra view)')
readout = pytest.importorskip('spm_haptic_master.view.readout')
history = pytest.importorskip('spm_haptic_master.view.history')
status_entries = pytest.importorskip('spm_haptic_master.view.status_entries')


def test_the_first_time_is_at_once_and_the_next_a_period_later():
    due = periodic.Periodic(0.5)
    assert [due.is_due(now) for now in (0.25, 0.5, 0.625, 0.75, 1.0, 1.25)] \
        == [True, False, False, True, False, True]
    due.begin(1.5)
    assert not due.is_due(1.875)
    due.hasten()
    assert due.is_due(1.875) and not due.is_due(2.0)


def test_a_page_that_closes_on_a_silent_device_leaves_a_gap():
    """The plots of a silent device run on: what joins the two pages was seen by nobody."""
    panel = SimpleNamespace(
        angles=history.History(4, 10), parity=history.History(2, 10),
        latency=history.History(2, 10), show_angles=lambda now: None,
        show_slow=lambda now: None, show_figures=lambda rows: None)
    entries = status_entries.StatusEntries('')
    shown = readout.Readout(panel, entries, SimpleNamespace(take=lambda: None), 0.0)

    def seen(now):
        entries.numbers = lambda *_: {'latency p50 (us)': 100.0, 'latency p99 (us)': 200.0}
        shown.note_timing()
        shown.show(now, 'sim', 4, None, None)

    seen(1.0)
    shown.break_off(1.5, watched=True)
    assert np.isfinite(panel.latency.columns(2.0)[1]).all()
    shown.break_off(2.0, watched=False)
    seen(60.0)
    times, latency, _ = panel.latency.columns(60.0)
    assert times.tolist() == [-59.0, -58.0, 0.0]
    assert np.isnan(latency).tolist() == [False, True, False]
    assert len(panel.angles.columns(60.0)[0]) == 1
