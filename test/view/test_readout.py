# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures, plots and the encoders' states: of what is known now, and a dash for all else."""

from math import isnan, radians

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.orientation_state import received_state

pytest.importorskip('viser', reason='viser is not installed (extra view)')
readout = pytest.importorskip('spm_haptic_master.view.readout')
liveness = pytest.importorskip('spm_haptic_master.view.liveness')
sensor_states = pytest.importorskip('spm_haptic_master.view.sensor_states')
status_entries = pytest.importorskip('spm_haptic_master.view.status_entries')
SensorState = sensor_states.SensorState
HEALTHY = liveness.Banner(liveness.Light.GREEN, 'healthy', True)


def entries_of(**entries):
    """Return entries that came at 1 s: level, message and values by NODE_ASPECT."""
    made = status_entries.StatusEntries('')
    for name, (level, message, values) in entries.items():
        made.take(DiagnosticStatus(
            name=': '.join(name.rsplit('_', 1)), level=level, message=message,
            values=[KeyValue(key=key, value=value) for key, value in values.items()]), 1.0)
    return made


def shown(entries=None, now=1.0, **known):
    """Return what the page has of a device that is alive at the centre."""
    known = {'banner': HEALTHY, 'sensors': 4, 'states': [SensorState.HEALTHY] * 4,
             'angles': [0.1] * 9, 'orientation': (0.0, 0.0, 0.0, 1.0),
             'dexterities': (0.15, 0.4)} | known
    return readout.content(
        readout.Seen(**known), entries or status_entries.StatusEntries(''), now)


def row(content, name):
    (found,) = [each for each in content['rows'] if each[0] == name]
    return found[1]


LIMITS = {'warn below': '0.059', 'error below': '0.033'}


@pytest.mark.parametrize(('dexterities', 'words', 'warns'), [
    ((0.15, 0.4), 'Three encoders determine this pose', False),
    ((0.01, 0.4), 'three encoders do not determine this pose; four do', True),
    ((0.001, 0.002), 'Not even four encoders', True),
    (None, readout.DASH, False)])
def test_a_sentence_says_which_encoders_determine_the_pose(dexterities, words, warns):
    content = shown(entries_of(diagnostics_singularity=(DiagnosticStatus.OK, 'clear', LIMITS)),
                    dexterities=dexterities)
    assert words in content['note']
    assert content['warns'] == warns


def test_the_sentence_counts_the_encoders_in_use_and_says_that_an_old_pose_is_old():
    entries = entries_of(diagnostics_singularity=(DiagnosticStatus.OK, 'clear', LIMITS))
    states = [SensorState.HEALTHY] * 4 + [SensorState.MISSING, SensorState.HEALTHY]
    assert 'With five they check' in shown(entries, sensors=6, states=states)['note']
    silent = shown(entries, angles=None, orientation=None, dexterities=None)
    assert 'not the present pose' in silent['note'] and silent['warns']


def test_three_encoders_on_the_wrong_side_are_no_good_pose():
    entries = entries_of(diagnostics_singularity=(DiagnosticStatus.OK, 'clear', LIMITS))
    wrong = shown(entries, ghost=radians(13.0))
    assert 'wrong side' in wrong['note'] and wrong['warns']
    assert 'wrong side' not in shown(entries, ghost=radians(0.5))['note']


def test_without_the_limits_there_is_no_sentence():
    """They are those of the node diagnostics, as long as it runs."""
    entries = entries_of(diagnostics_singularity=(DiagnosticStatus.OK, 'clear', LIMITS))
    assert shown(entries, now=10.0)['note'] == shown()['note'] == readout.DASH


def test_the_error_of_three_encoders_is_a_figure_and_a_plot():
    content = shown(ghost=radians(2.5))
    assert row(content, 'three encoders') == '2.50\u00b0 off'
    assert content['sample']['values']['ghost'] == [pytest.approx(2.5)]
    assert row(shown(), 'three encoders') == readout.DASH
    assert isnan(shown()['sample']['values']['ghost'][0])


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_every_sensor_has_a_chip_and_a_line_in_the_plot(sensors):
    content = shown(sensors=sensors, states=[SensorState.HEALTHY] * sensors)
    names = ['1A', '1B', '1C', '3A', '3B', '3C'][:sensors]
    assert [chip[0] for chip in content['chips']] == names
    (angles,) = [plot for plot in content['plots'] if plot['key'] == 'angles']
    assert [name for name, *_ in angles['series']] == names
    assert len(content['sample']['values']['angles']) == sensors
    # One colour a leg: th1 and th3 of a leg differ by the dash.
    colours = {name: (colour, dashed) for name, colour, dashed in angles['series']}
    assert colours['1A'][0] == colours['3A'][0] != colours['1B'][0]
    assert not colours['1A'][1] and colours['3A'][1]


def test_each_plot_has_one_unit_and_values_for_its_lines():
    content = shown()
    for plot in content['plots']:
        assert len(content['sample']['values'][plot['key']]) == len(plot['series'])
        assert plot['title'].count(', ') <= 1


def test_limits_are_in_the_plots_where_they_are_known():
    entries = entries_of(diagnostics_singularity=(DiagnosticStatus.OK, 'clear', LIMITS))
    plots = {plot['key']: plot['limits'] for plot in shown(entries, alert_limit=1.0)['plots']}
    assert [value for value, _ in plots['dexterity']] == [0.059, 0.033]
    assert [value for value, _ in plots['level']] == [1.0]
    assert all(not plot['limits'] for plot in shown()['plots'])


def test_the_rows_stay_where_they_are_whatever_is_known():
    """Also of a silent device, whose figures of an orientation are dashes."""
    entries = entries_of(
        encoder_driver_encoders=(DiagnosticStatus.OK, 'publishing', {}),
        fkm_orientation=(DiagnosticStatus.OK, 'healthy', {
            'parity (sigma)': '0.5', 'protection level (deg)': '0.3', 'caution': 'x <b>'}),
        fkm_timing=(DiagnosticStatus.OK, 'in time', {
            'orientation rate (Hz)': '1000', 'latency p50 (us)': '130',
            'latency p99 (us)': '300'}))
    alive = shown(entries, force='ready')
    silent = shown(entries, angles=None, orientation=None, dexterities=None)
    nothing = shown(angles=None, orientation=None, dexterities=None)
    assert [name for name, *_ in alive['rows']] == [name for name, *_ in silent['rows']] \
        == [name for name, *_ in nothing['rows']]
    assert row(alive, 'parity') == '0.5 sigma' and row(silent, 'parity') == readout.DASH
    assert row(alive, 'caution') == 'x <b>' and row(alive, 'force') == 'ready'
    assert row(silent, 'encoders') == 'publishing' and row(nothing, 'encoders') == readout.DASH
    assert isnan(silent['sample']['values']['level'][0])


def test_the_plot_of_a_joint_without_a_reading_has_a_gap():
    """The angle that follows from the orientation is no reading of its encoder."""
    entries = entries_of(encoder_driver_encoders=(
        DiagnosticStatus.OK, 'publishing', {'joints missing': 'joint_1b, joint_3c'}))
    values = shown(entries, sensors=6)['sample']['values']['angles']
    assert [isnan(value) for value in values] == [False, True, False, False, False, True]


@pytest.mark.parametrize(('state', 'driver', 'expected'), [
    ('healthy', (DiagnosticStatus.OK, 'publishing', {}), {}),
    ('degraded: joint_3b excluded', (DiagnosticStatus.OK, 'publishing', {}),
     {'joint_3b': SensorState.EXCLUDED}),
    ('silent: joint_1c stuck', (DiagnosticStatus.OK, 'publishing', {}),
     {'joint_1c': SensorState.EXCLUDED}),
    ('degraded: joint_3c missing', (DiagnosticStatus.WARN, 'joint_3c: no answer',
                                    {'joints missing': 'joint_3c'}),
     {'joint_3c': SensorState.MISSING}),
    # With four there is no set without one of them: the driver's words name it.
    ('silent: no joint samples', (DiagnosticStatus.ERROR, 'joint_1b: no answer', {}),
     {'joint_1b': SensorState.MISSING})])
def test_the_state_of_each_sensor(state, driver, expected):
    figures = {f'{name} unchecked (s)': '0.0' for name in ALL_JOINT_NAMES}
    figures['joint_3a unchecked (s)'] = 'inf'
    entries = entries_of(encoder_driver_encoders=driver,
                         fkm_orientation=(DiagnosticStatus.OK, 'healthy', figures))
    found = sensor_states.sensor_states(6, received_state(state), entries, 1.0)
    healthy = dict.fromkeys(ALL_JOINT_NAMES, SensorState.HEALTHY)
    assert dict(zip(ALL_JOINT_NAMES, found, strict=True)) \
        == healthy | {'joint_3a': SensorState.UNCHECKED} | expected
    # What no longer comes is not known.
    assert sensor_states.sensor_states(4, None, entries, 10.0) == [SensorState.UNKNOWN] * 4


def test_a_story_is_told_in_place_of_the_sentence():
    assert shown(story='Watch.')['note'] == 'Watch.'
