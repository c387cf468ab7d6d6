# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures, plots and the encoders' states: of what is known now, and a dash for all else."""

import json
from math import nan, radians

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from recorded_text import assert_recorded
from shown_device import entries_of
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.view.page import content, DASH, Seen
from spm_haptic_master.view.status import Banner, Light, SensorState
from std_msgs.msg import Float64MultiArray

# Fields of a message that differ from run to run.
UNLIKE = 'order', 'uuid', 'container_uuid', 'run_id'
# Entries by name: level, message and values.
CLEAR = {
    'diagnostics: singularity': (
        DiagnosticStatus.OK,
        'clear',
        {'warn below': '0.059', 'error below': '0.033'},
    )
}


def figures(entries=None, now=1.0, **known):
    """Return what the page has of a device that is alive at the centre."""
    return content(
        Seen(
            **{
                'banner': Banner(Light.GREEN, 'healthy', True),
                'sensors': 4,
                'angles': [0.1] * 9,
                'states': [SensorState.HEALTHY] * known.get('sensors', 4),
                'orientation': (0.0, 0.0, 0.0, 1.0),
                'dexterities': (0.15, 0.4),
            }
            | known
        ),
        entries_of(entries or {}, now),
    )


# A device whose picture is of the past.
SILENT = {'banner': Banner(Light.RED, 'silent: x', False)}


@pytest.mark.parametrize(
    ('known', 'words', 'warns'),
    [
        ({}, 'Three encoders determine this pose. With four they check', False),
        (
            {'dexterities': (0.01, 0.059)},
            'three encoders do not determine this pose; four do',
            True,
        ),
        ({'dexterities': (0.001, 0.002)}, 'Not even four encoders', True),
        ({'dexterities': (0.059, 0.4)}, 'Three encoders determine this pose', False),
        ({'dexterities': None}, DASH, False),
        (
            {
                'sensors': 6,
                'states': [SensorState.MISSING, SensorState.EXCLUDED, *[SensorState.HEALTHY] * 4],
            },
            'With four they check',
            False,
        ),
        ({'ghost': radians(3.1)}, 'wrong side', True),
        ({'ghost': radians(2.9)}, 'Three encoders determine', False),
        (SILENT, 'not the present pose', True),
        # Limits are those of the node diagnostics, while it runs.
        ({'now': 10.0}, DASH, False),
        ({'story': 'Watch.'} | SILENT, 'Watch.', False),
    ],
)
def test_a_sentence_says_which_encoders_determine_the_pose(known, words, warns):
    found = figures(CLEAR, **known)
    assert words in found['note'] and found['warns'] == warns


@pytest.mark.parametrize(
    ('dexterities', 'colours'),
    [
        ((0.01, 0.05), (Light.RED, Light.AMBER)),
        ((0.033, 0.059), (Light.AMBER, Light.GREEN)),
        ((nan, 0.4), (Light.GREY, Light.GREEN)),
        (None, (Light.GREY, Light.GREY)),
    ],
)
def test_the_bars_of_the_dexterity(dexterities, colours):
    """Full at 0.2; grey where the value or its limits are not known."""
    for entries, expected in ((CLEAR, colours), ({}, (Light.GREY, Light.GREY))):
        found = [row for row in figures(entries, dexterities=dexterities)['rows'] if len(row) > 2]
        assert [colour for *_, colour in found] == [light.value for light in expected]
        for value, (_, text, share, _) in zip(dexterities or (nan, nan), found, strict=True):
            assert (text, share) == (
                (DASH, 0.0) if value != value else (f'{value:.3f}', pytest.approx(value / 0.2))
            )


def in_words(value):
    """Return a value of a message as text, of an array its shape and four figures."""
    if isinstance(value, np.ndarray):
        flat = value.astype(float).ravel()
        rise = flat @ np.arange(len(flat)) / len(flat)
        return f'{value.shape} {flat.mean():.5g} {flat.std():.5g} {flat[-1]:.5g} {rise:.5g}'
    if isinstance(value, dict):
        return ' '.join(f'{name}: {in_words(each)}' for name, each in value.items())
    if hasattr(value, '__dataclass_fields__'):
        return in_words(
            {
                name: each
                for name, each in vars(value).items()
                if name not in UNLIKE and not name.startswith('_')
            }
        )
    return str(value)


def sent(server):
    """Return all that a page to come is sent, one line a message."""
    lines = []
    for message in server._websock_server.get_message_buffer().message_from_id.values():
        _, call, setup = getattr(message, 'source', '').rpartition('})(')
        if call:
            # Of the page's own script, what it is called with; not its style.
            message = json.loads(setup.rpartition(')')[0])
            del message['css']
        lines.append(f'{type(message).__name__} {in_words(message)}')
    return lines


def test_a_page_is_sent_what_is_recorded(serve, shown, monkeypatch):
    """Device, dome, panel and figures of a simulated device that is healthy, then silent."""
    server = shown.server = serve(names='recorded')
    monkeypatch.setattr(server, 'get_clients', lambda: {0: None})
    shown.begin(source='sim', sensors=5, alert_limit_deg=2.0)
    shown.say('force_state', 'engaged')
    shown.say(COVERAGE_TOPIC, '{"text": "turn it", "covered": {"tilt": 0.4, "turn": 1.0}}')

    def healthy():
        pose = 0.2, 1.0 + 0.1 * (shown.now - 1000.0), 0.8
        shown.readings(pose, (0.01, 0.0, 0.0, 0.0))
        shown.torques(servo=0.2, measured=0.1)
        shown.pose(*pose)
        shown.entry(
            'fkm: orientation',
            'healthy',
            **{
                'protection level (deg)': '0.5',
                'parity (sigma)': '1.2',
                'caution': 'slow',
                **{
                    f'{name} unchecked (s)': str(0.3 * k) for k, name in enumerate(ALL_JOINT_NAMES)
                },
            },
        )
        shown.entry(
            'fkm: timing',
            'in time',
            **{
                'orientation rate (Hz)': '999',
                'latency p50 (us)': '130',
                'latency p99 (us)': '300',
            },
        )
        shown.entry(
            'diagnostics: singularity', 'clear', **{'warn below': '0.059', 'error below': '0.033'}
        )
        shown.entry('encoder_driver: encoders', 'publishing', **{'joints missing': 'joint_3b'})
        shown.newest['/dexterity'] = Float64MultiArray(data=(0.05, 0.4))

    shown.run(5.0, healthy)
    first = sent(server)
    shown.say('state', 'silent: joint_1b stuck')
    shown.run(0.25)
    changed = [line for line in sent(server) if line not in first]
    assert_recorded('page.txt', '\n'.join([*first, 'silent', *changed]))
