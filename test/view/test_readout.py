# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is due once a period, and plots with a gap where nothing was seen."""

from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import numpy as np
import pytest

periodic = pytest.importorskip('spm_haptic_master.view.periodic')
pytest.importorskip('viser', reason='viser is not installed (extra view)')
figures = pytest.importorskip('spm_haptic_master.view.figures')
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


@pytest.fixture
def panel():
    """Give the histories of a panel, without a page."""
    return SimpleNamespace(
        angles=history.History(4, 50), parity=history.History(2, 50),
        latency=history.History(2, 50), show_angles=lambda now: None,
        show_slow=lambda now: None, show_figures=lambda rows: None)


@pytest.fixture
def shown(panel):
    """Give a Readout with figures that stay the same."""
    entries = status_entries.StatusEntries('')
    entries.numbers = lambda *_: {
        'latency p50 (us)': 100.0, 'latency p99 (us)': 200.0, 'parity (sigma)': 0.5,
        'protection level (deg)': 0.3}
    return readout.Readout(panel, entries, SimpleNamespace(take=lambda: None), 0.0)


def test_a_gap_is_where_figures_do_not_come_and_nowhere_else(shown, panel):
    """They come once a second for 4 s, and then no more; ticks are more frequent."""
    for tick in range(32):
        if tick % 4 == 0 and tick < 16:
            shown.note_timing()
        shown.show(0.25 * tick, 'replay', 4, [0.1] * 9, None)
    for kept in (panel.parity, panel.latency):
        times, first, second = kept.columns(0.0)
        assert times.tolist() == [0.0, 1.0, 2.0, 3.0, 4.5, 6.0, 7.5]
        for values in (first, second):
            assert np.isnan(values).tolist() == [False] * 4 + [True] * 3


def test_a_joint_without_a_reading_has_a_dash():
    entries = status_entries.StatusEntries('')
    shown = {}
    for missing in ('none', 'joint_1b, joint_3c', None):
        values = [] if missing is None else [KeyValue(key='joints missing', value=missing)]
        entries.take(DiagnosticStatus(
            name='encoder_driver: encoders', message='publishing', values=values), 1.0)
        shown[missing] = figures.of_encoders('can: can0', entries, 1.0)
    plain = {'source': 'can: can0', 'encoders': 'publishing'}
    assert shown == {'none': plain, None: plain, 'joint_1b, joint_3c': plain | {
        'joint_1b': '&ndash;', 'joint_3c': '&ndash;'}}


def test_the_caution_is_a_value_and_no_part_of_the_message():
    entries = status_entries.StatusEntries('')
    shown = []
    for caution in ('joint_3a unchecked for 5 s; joint_1a <noisy>', None):
        values = [] if caution is None else [KeyValue(key='caution', value=caution)]
        entries.take(DiagnosticStatus(
            name='fkm: orientation', message='degraded: a; b', values=values), 1.0)
        shown.append(figures.of_encoders('sim', entries, 1.0))
    assert shown == [{'source': 'sim', 'caution': 'joint_3a unchecked for 5 s; joint_1a '
                      '&lt;noisy&gt;'}, {'source': 'sim'}]
    assert figures.of_encoders('sim', entries, 10.0) == {'source': 'sim'}


def test_the_plot_of_a_joint_without_a_reading_has_a_gap(shown, panel):
    """The angle that follows from the orientation is no reading of its encoder."""
    shown._entries.take(DiagnosticStatus(
        name='encoder_driver: encoders', message='publishing',
        values=[KeyValue(key='joints missing', value='joint_1b, joint_3c')]), 1.0)
    shown.show(1.0, 'can', 6, [0.1] * 9, None)
    _, *angles = panel.angles.columns(1.0)
    assert np.isnan(np.ravel(angles)).tolist() == [False, True, False, False]


def test_a_page_that_closes_on_a_silent_device_leaves_a_gap(shown, panel):
    """The plots of a silent device run on: what joins the two pages was seen by nobody."""
    def seen(now):
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
