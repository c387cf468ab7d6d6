# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is declared beside an orientation: its level, unchecked sensors, noise, what waits."""

from math import inf, radians, sqrt

import numpy as np
from product_limits import product_limits
import pytest
from rig import Rig, SIGMA
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.supervision.protection import integrity
from supervised import PLACES, readings, rest, Run, supervisor

# Standard deviations of threshold and missed detection.
REACH = product_limits().threshold + 5.3


def worth(rig, noise=1.0, bias=None):
    return integrity(rig.solver.four, bias or product_limits().bias, noise)


def settled(**limits):
    """Return a rig whose window is full, 21 samples."""
    rig = Rig(**limits)
    for _ in range(30):
        assert rig.sample() == ''
    return rig


# The protection level -----------------------------------------------------------------------

def test_the_level_is_the_largest_part_of_a_sensor_that_is_within_the_alert_limit():
    rig = settled(alert_limit=10.0)
    parts = worth(rig).levels(REACH / sqrt(21.0))
    assert rig.level == pytest.approx(max(parts))
    # One sensor cannot be checked within the limit: it is not in the level.
    below = sorted(parts)[-2]
    rig = settled(alert_limit=0.5 * (below + max(parts)))
    assert rig.level == pytest.approx(below)
    found = rig.supervisor.unchecked()
    assert found[parts.index(max(parts))] == inf
    assert sorted(found)[:3] == [0.0] * 3


def test_it_is_never_less_than_what_healthy_sensors_do():
    rig = settled()
    rig.supervisor.alert_limit = worth(rig).healthy
    rig.sample()
    assert rig.level == worth(rig).healthy
    assert min(rig.supervisor.unchecked()) > 0.0


def test_fewer_samples_than_ten_count_for_ten():
    rig = Rig(healthy=False, start_samples=1, alert_limit=10.0)
    for _ in range(9):
        assert rig.sample() == ''
        assert rig.level == pytest.approx(max(worth(rig).levels(REACH / sqrt(10.0))))


def test_the_distance_from_the_estimate_is_in_every_part():
    rig = settled(alert_limit=10.0)
    before = rig.level
    rig.solver.apart = 0.001
    rig.sample()
    assert rig.level == pytest.approx(before + 0.001)
    # A part that it moves beyond the limit is a sensor that is not checked, and no silence.
    rig = settled(alert_limit=before + 0.0005)
    rig.solver.apart = 0.001
    assert rig.sample() == ''
    assert rig.level < before
    assert max(rig.supervisor.unchecked()) == pytest.approx(1e-3)


def test_the_alert_limit_is_live_and_exact():
    rig = settled()
    healthy = worth(rig).healthy
    rig.supervisor.alert_limit = healthy
    assert rig.sample() == ''
    assert rig.level == healthy
    rig.supervisor.alert_limit = healthy * (1.0 - 1e-9)
    assert rig.sample() == 'protection level above the alert limit'
    assert rig.detail == f'{np.degrees(healthy):.2f} deg, limit {np.degrees(healthy):g}'


@pytest.mark.parametrize('skew', [0.0, 0.003])
def test_a_declared_skew_adds_to_the_bias_with_the_speed(skew):
    rig = Rig(healthy=False, start_samples=1, skew=skew, alert_limit=10.0)
    for index in range(60):
        assert rig.sample(th1b=-2e-3 * index) == ''
    bias = list(product_limits().bias)
    bias[1] += skew * 2.0
    assert rig.level == pytest.approx(
        max(worth(rig, bias=tuple(bias)).levels(REACH / sqrt(21.0))), rel=2e-3)


@pytest.mark.parametrize(('factor', 'counts'), [(1.15, False), (2.0, True)])
def test_noise_beyond_chance_raises_the_level_and_is_a_caution(factor, counts):
    """From 1.25 times the configured one on; of all sensors the noisiest counts."""
    noise = SIGMA[0] * np.array([1.0, factor, 1.0, 1.0])
    _, angles = readings(rest(20.0), 3000, noise=noise, counts=False)
    subject = supervisor(alert_limit=10.0)
    run = Run(subject, angles)
    _, angles = readings(rest(20.0), 3000, counts=False)
    usual = Run(supervisor(alert_limit=10.0), angles)
    assert subject.noise() == pytest.approx(noise, rel=0.2)
    ratio = run.level[-1] / usual.level[-1]
    found = {kind: text for kind, text in subject.cautions().items() if kind.startswith('noise')}
    if counts:
        assert 1.3 < ratio < 2.0
        assert found == {'noise joint_1b': 'noise of joint_1b 0.08 deg, configured 0.04'}
    else:
        assert ratio == pytest.approx(1.0, abs=1e-3)
        assert found == {}


def test_noise_that_makes_the_level_too_high_is_the_reason_of_silence():
    _, angles = readings(rest(20.0), 1500)
    assert Run(supervisor(alert_limit=radians(0.4)), angles).out[4:].all()
    _, angles = readings(rest(20.0), 1500, noise=2.5 * SIGMA[0])
    subject = supervisor(alert_limit=radians(0.4))
    run = Run(subject, angles)
    assert not run.out[1000:].any()
    assert len([kind for kind in subject.cautions() if kind.startswith('noise')]) == 4
    assert run.states[-1] == 'silent: protection level above the alert limit'


# Unchecked sensors --------------------------------------------------------------------------

def test_a_sensor_unchecked_for_a_second_is_a_caution():
    _, angles = readings(rest(49.3586), 50)
    subject = supervisor()
    Run(subject, angles)
    assert subject.cautions() == {'unchecked joint_3a': 'joint_3a unchecked since the start'}
    # Away from the singularity it is none.
    _, angles = readings(rest(20.0), 2600)
    subject = supervisor()
    Run(subject, angles)
    assert subject.cautions() == {}
    rig = settled()
    rig.supervisor.alert_limit = 1e-9
    for after, text in ((1000, None), (1, '1 s'), (499, '2 s'), (500, '2 s'), (12_000, None)):
        for _ in range(after // 250):
            rig.sample(after=250)
        rig.sample(after=after % 250 or 1)
        found = rig.supervisor.cautions()
        times = rig.supervisor.unchecked()
        for name, time in zip(JOINT_NAMES, times, strict=True):
            assert (f'unchecked {name}' in found) == (time > 1.0)
            if time > 1.0:
                assert found[f'unchecked {name}'] == f'{name} unchecked for {time:.0f} s'
        assert text is None or any(text in each for each in found.values())


def test_a_sample_with_a_symptom_checks_no_sensor():
    rig = settled()
    assert rig.supervisor.unchecked() == (0.0,) * 4
    rig.sample(th1c=0.1)
    assert rig.supervisor.unchecked() == pytest.approx((1e-3,) * 4)
    # And a window of consistency has to follow.
    for _ in range(20):
        rig.sample()
    assert rig.supervisor.unchecked() == pytest.approx((21e-3,) * 4)
    rig.sample()
    assert rig.supervisor.unchecked() == (0.0,) * 4


def test_a_restart_forgets_what_was_checked():
    rig = settled()
    rig.sample(after=501)
    assert rig.supervisor.unchecked() == (inf,) * 4


@pytest.mark.parametrize('limit', [0.5, 2.0])
def test_unchecked_for_longer_than_the_limit_is_silence(limit):
    """Counted from the last check, or from the start where there was none."""
    _, angles = readings(rest(49.3586), 2600)
    run = Run(supervisor(unchecked_limit=limit), angles)
    last = round(limit * 1e3)
    assert run.out[4:last + 1].all()
    assert not run.out[last + 1:].any()
    assert run.states[-1] == 'silent: joint_3a unchecked for too long'
    assert set(run.reasons[last + 1:]) == {'joint_3a unchecked for too long', 'settling'}


def test_unchecked_for_too_long_ends_where_the_others_check_it_again():
    rig = settled(unchecked_limit=0.1, alert_limit=10.0)
    rig.supervisor.alert_limit = worth(rig).healthy * 1.0001
    reasons = [rig.sample() for _ in range(150)]
    assert set(reasons[:99]) == {''}
    assert set(reasons[103:]) <= {f'{name} unchecked for too long' for name in JOINT_NAMES} \
        | {'settling'}
    rig.supervisor.alert_limit = 10.0
    reasons = [rig.sample() for _ in range(40)]
    assert set(reasons[-15:]) == {''}
    assert rig.state == 'healthy'


def test_without_a_limit_it_may_last():
    _, angles = readings(rest(49.3586), 2600)
    assert Run(supervisor(unchecked_limit=0.0), angles).out[4:].all()


@pytest.mark.parametrize(('place', 'sensor', 'how'), [
    (rest(49.3586), 'joint_3a', 'turn the handle about its axis, away from the singularity'),
    (PLACES['centre'], None, '')])
def test_with_start_checked_every_sensor_is_checked_before_the_first_orientation(
        place, sensor, how):
    _, angles = readings(place, 100)
    run = Run(supervisor(start_checked=True), angles)
    if sensor:
        assert not run.out.any()
        assert run.states[-1] == f'silent: {sensor} not checked yet: {how}'
    else:
        first = np.flatnonzero(run.out)[0]
        assert 20 <= first <= 30
        assert run.out[first:].all()
        assert np.all(run.unchecked[first] == 0.0)


def test_how_to_check_a_motor_sensor():
    rig = Rig(healthy=False, start_checked=True, alert_limit=1e-9)
    rig.supervisor.alert_limit = worth(rig).healthy * 1.0001
    for _ in range(9):
        rig.sample()
    assert rig.state == 'silent: joint_1a not checked yet: ' \
        'tilt the handle towards the centre of the workspace'


# Two that jumped ----------------------------------------------------------------------------

def test_two_that_jumped_stay_a_fault_until_somebody_acknowledges():
    rig = settled(recovery=0.05)
    assert not rig.supervisor.acknowledge()
    for _ in range(3):
        rig.sample(th1a=0.1, th1b=0.1)
    assert rig.state == 'silent: jumped, sensor undetermined, to be acknowledged'
    assert {rig.sample(th1a=0.1, th1b=0.1) for _ in range(200)} == {
        'jumped, sensor undetermined, to be acknowledged'}
    assert rig.supervisor.acknowledge()
    assert not rig.supervisor.acknowledge()
    assert rig.sample(th1a=0.1, th1b=0.1) == ''
    assert rig.state == 'healthy'


def test_an_acknowledgement_before_the_recovery_time_waits_for_it():
    rig = settled(recovery=0.05)
    for _ in range(3):
        rig.sample(th1a=0.1, th1b=0.1)
    assert rig.supervisor.acknowledge()
    reasons = [rig.sample(th1a=0.1, th1b=0.1) for _ in range(100)]
    first = reasons.index('')
    # The window from the first sample on, then the recovery time.
    assert first in (69, 70)
    assert set(reasons[first:]) == {''}


def test_a_restart_needs_the_acknowledgement_as_well():
    rig = settled(recovery=0.01)
    for _ in range(3):
        rig.sample(th1a=0.1, th1b=0.1)
    rig.sample(after=600)
    assert {rig.sample() for _ in range(100)} == {
        'jumped, sensor undetermined, to be acknowledged'}
