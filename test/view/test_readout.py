# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures, plots and the encoders' states: of what is known now, and a dash for all else."""

from math import isnan, nan, radians

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from spm_haptic_master.view.page import content, DASH, Seen
from spm_haptic_master.view.status import Banner, Light, SensorState, StatusEntries

NAMES = ['1A', '1B', '1C', '3A', '3B', '3C']
# Entries by name: level, message and values.
CLEAR = {'diagnostics: singularity': (
    DiagnosticStatus.OK, 'clear', {'warn below': '0.059', 'error below': '0.033'})}
DRIVER = {'encoder_driver: encoders': (DiagnosticStatus.OK, 'publishing', {})}


def entries_of(entries, now=1.0):
    """Return entries that came at 1 s."""
    made = StatusEntries('')
    for name, (level, message, values) in entries.items():
        made.take(DiagnosticStatus(name=name, level=level, message=message, values=[
            KeyValue(key=key, value=value) for key, value in values.items()]), 1.0)
    made.now = now
    return made


def shown(entries=None, now=1.0, **known):
    """Return what the page has of a device that is alive at the centre."""
    return content(Seen(**{
        'banner': Banner(Light.GREEN, 'healthy', True), 'sensors': 4, 'angles': [0.1] * 9,
        'states': [SensorState.HEALTHY] * known.get('sensors', 4),
        'orientation': (0.0, 0.0, 0.0, 1.0), 'dexterities': (0.15, 0.4)} | known),
        entries_of(entries or {}, now))


# A device whose picture is of the past.
SILENT = {'banner': Banner(Light.RED, 'silent: x', False)}


def rows(found):
    return {name: text for name, text, *_ in found['rows']}


@pytest.mark.parametrize(('known', 'words', 'warns'), [
    ({}, 'Three encoders determine this pose. With four they check', False),
    ({'dexterities': (0.01, 0.059)}, 'three encoders do not determine this pose; four do', True),
    ({'dexterities': (0.001, 0.002)}, 'Not even four encoders', True),
    ({'dexterities': None}, DASH, False),
    ({'sensors': 6, 'states': [SensorState.MISSING, *[SensorState.HEALTHY] * 5]},
     'With five they check', False),
    ({'sensors': 6, 'states': [SensorState.EXCLUDED, *[SensorState.HEALTHY] * 5]},
     'With five they check', False),
    ({'ghost': radians(3.1)}, 'wrong side', True),
    ({'ghost': radians(2.9)}, 'Three encoders determine', False),
    (SILENT, 'not the present pose', True),
    # Limits are those of the node diagnostics, while it runs.
    ({'now': 10.0}, DASH, False),
    ({'story': 'Watch.'} | SILENT, 'Watch.', False)])
def test_a_sentence_says_which_encoders_determine_the_pose(known, words, warns):
    found = shown(CLEAR, **known)
    assert words in found['note'] and found['warns'] == warns


@pytest.mark.parametrize(('dexterities', 'colours'), [
    ((0.01, 0.05), (Light.RED, Light.AMBER)), ((0.033, 0.059), (Light.AMBER, Light.GREEN)),
    ((nan, 0.4), (Light.GREY, Light.GREEN)), (None, (Light.GREY, Light.GREY))])
def test_the_bars_of_the_dexterity(dexterities, colours):
    """Full at 0.2; grey where the value or its limits are not known."""
    for entries, expected in ((CLEAR, colours), ({}, (Light.GREY, Light.GREY))):
        found = [row for row in shown(entries, dexterities=dexterities)['rows'] if len(row) > 2]
        assert [colour for *_, colour in found] == [light.value for light in expected]
        for value, (_, text, share, _) in zip(dexterities or (nan, nan), found, strict=True):
            assert (text, share) == ((DASH, 0.0) if value != value else (
                f'{value:.3f}', pytest.approx(value / 0.2)))


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_every_sensor_has_a_chip_and_a_line_in_the_plots(sensors):
    found = shown(CLEAR, sensors=sensors, alert_limit=1.0, ghost=radians(2.5))
    assert found['chips'] == [
        (name, f'joint_{name.lower()}: healthy', SensorState.HEALTHY.colour)
        for name in NAMES[:sensors]]
    assert rows(found)['three encoders'] == '2.50\u00b0 off'
    plots = {plot['key']: plot for plot in found['plots']}
    assert [name for name, *_ in plots['angles']['series']] == NAMES[:sensors]
    # One colour a leg: th1 and th3 of a leg differ by the dash.
    colours = {name: (colour, dashed) for name, colour, dashed in plots['angles']['series']}
    assert colours['1A'][0] == colours['3A'][0] != colours['1B'][0]
    assert not colours['1A'][1] and colours['3A'][1]
    values = found['sample']['values']
    assert {key: len(value) for key, value in values.items()} \
        == {key: len(plot['series']) for key, plot in plots.items()}
    assert values['ghost'] == [pytest.approx(2.5)]
    assert {key: [value for value, _ in plot['limits']] for key, plot in plots.items()
            if plot['limits']} == {'dexterity': [0.059, 0.033], 'level': [1.0]}
    assert not any(plot['limits'] for plot in shown()['plots'])


def test_the_rows_stay_where_they_are_whatever_is_known():
    """Also of a silent device, whose figures of an orientation are dashes."""
    entries = DRIVER | {
        'fkm: orientation': (DiagnosticStatus.OK, 'healthy', {
            'parity (sigma)': '0.5', 'protection level (deg)': '0.3', 'caution': 'x <b>'}),
        'fkm: timing': (DiagnosticStatus.OK, 'in time', {
            'orientation rate (Hz)': '1000', 'latency p50 (us)': '130',
            'latency p99 (us)': '300'})}
    alive, nothing = rows(shown(entries, force='ready', source='sim')), rows(shown(**SILENT))
    assert alive == nothing | {
        'source': 'sim', 'encoders': 'publishing', 'force': 'ready', 'caution': 'x <b>',
        'orientation': '\u03c8 0.00\u00b0, \u03b8 0.00\u00b0, \u03c6 0.00\u00b0',
        'protection level': '0.30\u00b0', 'parity': '0.5 sigma', 'rate': '1000 Hz',
        'dexterity of 3': '0.150', 'dexterity of 4': '0.400',
        'latency': 'p50 130 us, p99 300 us'}
    assert {text for name, text in nothing.items() if name not in ('source', 'picture')} == {DASH}
    silent = shown(entries, **SILENT)
    assert list(rows(silent)) == list(alive) and rows(silent)['parity'] == DASH
    assert rows(silent)['encoders'] == 'publishing'
    assert isnan(silent['sample']['values']['level'][0])


def test_the_plot_of_a_joint_without_a_reading_has_a_gap():
    """The angle that follows from the orientation is no reading of its encoder."""
    values = shown({'encoder_driver: encoders': (DiagnosticStatus.OK, 'publishing', {
        'joints missing': 'joint_1b, joint_3c'})}, sensors=6)['sample']['values']['angles']
    assert [isnan(value) for value in values] == [False, True, False, False, False, True]
