# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Decisions about recordings, beside those of `decisions.txt`: no change alters one unnoticed.

After a change that is meant to: `python test/supervision/test_decisions.py --accept`, and read
the difference. Which decisions are right, the other tests of this folder say.
"""

from pathlib import Path
import sys

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from device import disturbance, every, noisy, offset, paused, ramp, run, stuck  # noqa: E402, I100

TABLE = Path(__file__).with_name('decisions.txt')
ACCEPT = 'if the change is meant to: .venv/bin/python test/supervision/test_decisions.py --accept'
# Samples from one protection level of the table to the next.
LEVEL_EVERY = 300


def lost(sensor):
    """Return a fault: frames lost at random, then for long, then an infinite angle."""

    def change(readings):
        readings[np.random.default_rng(1).random(readings.shape) < 0.01] = np.nan
        readings[250:300, sensor], readings[400, sensor] = np.nan, np.inf

    return change


def spikes(sensor):
    """Return a fault: every twelfth reading is wrong for a while."""

    def change(readings):
        readings[100:400:12, sensor] += 0.1

    return change


def slow(readings):
    """Have the encoders repeat each reading three times."""
    readings[:] = readings[np.arange(len(readings)) // 4 * 4]


# By name: arguments of `run`.
CASES = {
    **{
        f'{what}, {sensors} sensors': {'sensors': sensors, 'seed': sensors, **arguments}
        for sensors in (4, 5, 6)
        for what, arguments in {
            'step': {'kind': 'turning', 'change': offset(200, 1, 2.0, 400), 'recovery': 0.1},
            'step, others go on': {
                'kind': 'sweep',
                'change': offset(200, 3, -5.0),
                'degraded': 'allow',
                'alert_limit_deg': 2.0,
            },
            'two faults': {
                'kind': 'turning',
                'degraded': 'allow',
                'recovery': 0.1,
                'change': every(offset(150, 0, 3.0, 300), offset(220, 3, -2.0, 400)),
            },
            'drift': {
                'kind': 'resting',
                'seconds': 0.8,
                'change': ramp(500, 2, 5.0),
                'alert_limit_deg': 2.0,
            },
            'stuck': {'kind': 'taught', 'seconds': 1.7, 'spoil': stuck(1500, 0)},
            'spikes': {'kind': 'turning', 'spoil': spikes(1)},
            'lost': {'kind': 'rim', 'spoil': lost(3)},
            'noisy': {'kind': 'sweep', 'spoil': noisy(200, 1, 0.5), 'alert_limit_deg': 2.0},
            'pause': {
                'kind': 'singular',
                'change': offset(299, 3, 2.0),
                'times': paused(600, (200, 7), (300, 30), (500, 700)),
            },
            'slow encoders': {
                'kind': 'fast',
                'spoil': slow,
                'skew': 0.001,
                'alert_limit_deg': 5.0,
            },
            'unchecked': {'kind': 'singular', 'unchecked_limit': 0.3, 'bias_deg': [0.02] * 4},
            'end stop': {'kind': disturbance('end stop', 1)},
            'vibration': {'kind': disturbance('vibration', 2)[:900]},
        }.items()
    },
    'two that cancel': {'kind': 'rest', 'change': offset(300, [0, 1], [2.0, -1.87])},
    'a second sensor jumps': {
        'kind': 'turning',
        'degraded': 'allow',
        'change': every(offset(100, 1, 5.0), offset(200, 3, 1.0)),
    },
    'glitches of others, 6 sensors': {
        'kind': 'sweep',
        'sensors': 6,
        'seconds': 1.2,
        'recovery': 0.3,
        'change': every(offset(100, 0, 3.0), offset(400, 5, 4.0, 403), offset(500, 3, 4.0, 503)),
    },
    **{
        f'jump behind a gap of {gap} ms': {
            'kind': 'singular',
            'seconds': 0.4,
            'change': offset(230, 3, 1.0),
            'times': paused(400, (200, gap)),
        }
        for gap in (200, 450, 2000)
    },
    'start_checked': {
        'kind': 'through',
        'seconds': 2.0,
        'start_checked': True,
        'alert_limit_deg': 2.0,
    },
    'clock set back': {'kind': 'turning', 'times': paused(600, (300, -10_000))},
    'out of range': {'kind': 'rest', 'change': offset(300, 1, 20.0), 'joint_max_deg': [80.0] * 4},
    'slow sampling': {
        'kind': 'sweep',
        'rate': 100.0,
        'seconds': 5.0,
        'change': offset(300, 0, 2.0),
    },
}


def decided(case):
    """Return what becomes of a recording: a line each for their number, states and levels, deg."""
    result = run(**{'seconds': 0.6, **case}).result
    levels = result.protection_level
    return [
        f'{result.published.sum()} published',
        *(f'{index} {text}' for index, text in result.state),
        *(
            f'level {levels[index]:.3g} at {index}'
            for index in range(0, len(levels), LEVEL_EVERY)
            if np.isfinite(levels[index])
        ),
    ]


def recorded():
    """Return the lines of each recording by its name."""
    lines = {}
    name = ''
    for line in TABLE.read_text().splitlines():
        if line.startswith(' '):
            lines[name].append(line.strip())
        else:
            name = line
            lines[name] = []
    return lines


def without_levels(lines):
    """Return the lines but for the levels, and the levels, deg, by their samples."""
    levels = [line for line in lines if line.startswith('level ')]
    words = [line.split() for line in levels]
    return lines[: len(lines) - len(levels)], {at: float(level) for _, level, _, at in words}


def how_to_accept(name, found, expected):
    """Return the lines that differ, and how to accept those that were found."""
    lines = [f'{name}: sample and state, or number of published samples']
    lines += [f'found {line!r}, which is not recorded' for line in found if line not in expected]
    lines += [f'not found: {line!r}, which is recorded' for line in expected if line not in found]
    return '\n'.join([*lines, ACCEPT])


@pytest.mark.parametrize('name', CASES)
def test_a_recording_is_decided_as_before(name):
    states, levels = without_levels(decided(CASES[name]))
    expected_states, expected_levels = without_levels(recorded()[name])
    assert states == expected_states, how_to_accept(name, states, expected_states)
    assert levels == pytest.approx(expected_levels, rel=1e-2), ACCEPT


if __name__ == '__main__' and sys.argv[1:] == ['--accept']:
    lines = [
        line for name, case in CASES.items() for line in (name, *(f'  {x}' for x in decided(case)))
    ]
    TABLE.write_text('\n'.join(lines) + '\n')
