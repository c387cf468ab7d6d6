# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Single samples: stamps and their period, angles that are no number, ranges."""

from math import degrees, inf, nan

import pytest
from rig import MS, NAMES, Rig
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.supervision.sample_clock import SampleClock
from spm_haptic_master.supervision.symptom import Reason


@pytest.mark.parametrize('back', [0, 1, 10_000])
def test_an_older_sample_is_withheld_and_a_hundred_are_a_clock_that_was_set_back(back):
    rig = Rig()
    verdict = rig.sample(stamp=rig.now - back * MS)
    assert verdict.estimate is None
    assert verdict.cause.reason is Reason.OLD
    assert verdict.cause.detail == f'{max(back * 1e-3, 1e-9):.6f} s older'
    assert rig.sample().estimate is not None
    rig.now -= 10_000 * MS
    assert set(rig.samples(100)) == {'sample not newer than the last'}
    assert rig.state == 'starting'
    assert rig.samples(10) == ['starting'] * 4 + [None] * 6
    assert rig.state == 'healthy'


@pytest.mark.parametrize('count', [1, 2, 20])
def test_as_many_consistent_samples_as_set_precede_the_first_orientation(count):
    rig = Rig(healthy=False, start_samples=count)
    assert rig.samples(1, th1b=5.0) == ['inconsistent angles']
    assert rig.samples(count) == ['starting'] * (count - 1) + [None]


@pytest.mark.parametrize(
    ('value', 'words'),
    [
        (nan, 'joint_3a missing'),
        (inf, 'angle not finite'),
        (-inf, 'angle not finite'),
    ],
)
def test_an_angle_that_is_no_number_is_withheld_and_is_silence_only_if_it_lasts(value, words):
    rig = Rig()
    for _ in range(5):
        assert rig.samples(2, th3a=value) == [words] * 2
        assert rig.state == 'healthy'
        assert rig.samples(1) == [None]
    rig.samples(30, th3a=value)
    assert rig.state == f'silent: {words}'
    # Orientations come back by themselves, of all four.
    assert set(rig.samples(60)[20:]) == {None}
    assert rig.state == 'healthy'


@pytest.mark.parametrize('sensor', range(4))
@pytest.mark.parametrize(('low', 'high'), [(-0.5, 20.0), (-20.0, 0.5)])
def test_a_reading_out_of_its_joints_range_is_withheld_and_a_fault_if_it_lasts(sensor, low, high):
    place = degrees(Rig(healthy=False).place[sensor])
    ends = {'joint_min_deg': [-170.0] * 4, 'joint_max_deg': [170.0] * 4}
    ends['joint_min_deg'][sensor], ends['joint_max_deg'][sensor] = place + low, place + high
    rig = Rig(healthy=False, alert_limit_deg=2.0, **ends)
    assert set(rig.samples(30)[5:]) == {None}
    outside = {NAMES[sensor]: 0.8 if high < 1.0 else -0.8}
    words = f'{JOINT_NAMES[sensor]} out of'
    assert rig.samples(2, **outside) == [f'{words} range'] * 2
    assert rig.state == 'healthy'
    rig.samples(2, **outside)
    assert rig.state == f'silent: {words} range'


def after(*steps):
    """Return a clock after samples so many ns apart."""
    clock = SampleClock()
    stamp = 5 * MS
    for step in (0, *steps):
        stamp += step
        clock.step(stamp)
    return clock


def test_period_and_jitter_are_averages():
    assert (after(4 * MS).period, after(4 * MS).jitter) == (pytest.approx(4e-3), 0.0)
    assert after(MS, *[2 * MS] * 500).period == pytest.approx(2e-3, rel=1e-3)
    clock = after(MS, *[MS - 200_000, MS + 200_000] * 300)
    assert clock.period == pytest.approx(1e-3, rel=0.02)
    assert clock.jitter == pytest.approx(0.2e-3, rel=0.02)


def test_a_gap_counts_for_twenty_periods_at_most_and_a_lost_sample_for_no_jitter():
    clock = after(MS, 400 * MS)
    assert clock.period == pytest.approx(1e-3 * (1.0 + 20.0) / 2.0)
    assert clock.jitter == 0.0
    assert after(*[MS] * 60, 2 * MS).jitter == pytest.approx(0.0, abs=1e-9)
