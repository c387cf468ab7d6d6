# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sensors that are not in use: missing, excluded, and when they are used again."""

from math import inf, nan

import pytest
from rig import Rig

WINDOW = {'window': 0.0205}  # twenty samples of agreement


def used_again(rig):
    """Return after how many samples of agreement all sensors are used."""
    return next(count for count in range(1, 400) if rig.samples(1) and rig.state == 'healthy')


def test_a_lost_frame_is_no_state_and_three_are_a_missing_sensor_until_it_agrees():
    rig = Rig(6, **WINDOW)
    for _ in range(20):
        assert rig.samples(2, th3b=nan) == [None] * 2
        assert rig.samples(1) == [None]
        assert rig.state == 'healthy'
    assert rig.samples(3, th3b=nan) == [None] * 3
    assert rig.state == 'degraded: joint_3b missing'
    assert 20 <= used_again(rig) <= 22
    assert rig.state == 'healthy'


@pytest.mark.parametrize(
    'contradiction',
    [
        {},
        {'th1b': 5.0},
        {'th1a': 5.0},
        {'th1b': nan},
    ],
)
def test_an_excluded_sensor_is_used_after_its_recovery_in_one_piece(contradiction):
    rig = Rig(6, recovery=0.1005, **WINDOW)
    rig.samples(30, th1b=5.0)
    assert rig.state == 'degraded: joint_1b excluded'
    if contradiction:
        rig.samples(90)
        rig.samples(5, **contradiction)
    assert 100 <= used_again(rig) <= 125


@pytest.mark.parametrize(
    ('left_out', 'moved', 'cause'),
    [
        ({}, {'th3b': nan, 'th3c': nan}, None),
        ({}, {'th3a': nan, 'th3b': nan, 'th3c': nan}, 'joint_3a missing'),
        # As without a reading; four are named by what they gave.
        ({}, {'th1a': inf}, None),
        ({}, {'th1a': -inf, 'th3b': nan, 'th3c': nan}, 'angle not finite'),
        # Four in use could not go on without a fifth.
        ({'th1b': 5.0}, {'th3b': nan, 'th3c': nan}, 'joint_3b missing'),
    ],
)
def test_what_does_not_suffice_is_the_cause_of_silence(left_out, moved, cause):
    rig = Rig(6)
    rig.samples(30, **left_out)
    assert rig.sample(**left_out, **moved).estimate is None or cause is None
    assert (rig.verdict.cause and rig.verdict.cause.words) == cause


def test_an_excluded_sensor_need_not_be_checked():
    rig = Rig(6, unchecked_limit=0.1, start_checked=True)
    assert rig.samples(300, th1b=5.0)[30:] == [None] * 270
    assert rig.state == 'degraded: joint_1b excluded'
