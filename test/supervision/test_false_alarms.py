# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Healthy samples are published: no false alarms, and no more withheld than promised."""

import device
import numpy as np
import pytest
from rig import few, MS
from spm_haptic_master.kinematics.joints import JOINT_NAMES

SENSORS = (4, 6, 5)
SEEDS = pytest.mark.parametrize(
    'seeds',
    [
        pytest.param(range(1), id='few'),
        pytest.param(range(1, 25), id='more', marks=pytest.mark.evidence),
    ],
)


# Motions and encoders -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('kind', 'sensors'),
    few(['rest', 'singular', 'crossing', 'turning', 'rim', 'tremor', 'sweep', 'fast'], SENSORS),
)
@pytest.mark.parametrize(
    'seconds',
    [
        pytest.param(1.0, id='short'),
        pytest.param(25.0, id='long', marks=pytest.mark.evidence),
    ],
)
def test_no_false_alarm_in_many_healthy_samples(kind, sensors, seconds):
    """The threshold promises one in 10,000 hours, 3.6e10 samples; `make faults` plays hours."""
    outcome = device.run(kind, sensors, seconds)
    assert outcome.healthy_throughout
    assert outcome.within_level
    if sensors > 4:
        # They check each other everywhere.
        assert (outcome.result.unchecked[100:] == 0.0).all()


@pytest.mark.parametrize(
    ('kind', 'noise', 'bits'), few(['rest', 'tremor', 'fast'], [0.0, 0.005], [12, 16])
)
def test_a_healthy_quiet_encoder_is_not_frozen(kind, noise, bits):
    assert device.run(kind, noise=noise, bits=bits).published[10:].all()


@pytest.mark.parametrize(
    ('sensors', 'hold', 'speed'),
    few(SENSORS, (2, 4), (1.0, 0.5), others=pytest.mark.evidence),
)
def test_encoders_slower_than_the_bus_are_within_the_level(sensors, hold, speed):
    """All hold their readings for some samples; largest speed of a joint in rad/s."""
    angles = device.joint_angles(device.motion('fast', 2.0))
    fastest = 1000.0 * np.abs(np.diff(angles, axis=0)).max()
    # As fast as that at 1 kHz.
    rotations = device.motion('fast', 0.2, 1000.0 * fastest / speed)
    readings = device.encoders(device.joint_angles(rotations, sensors))
    index = np.arange(len(readings))
    outcome = device.Outcome(rotations, readings[index // hold * hold])
    assert outcome.published[10:].mean() > 0.99
    assert outcome.within_level


def test_a_declared_skew_between_encoders_is_allowed_for():
    def late(angles):
        angles[1:, 3] = angles[:-1, 3].copy()

    outcome = device.run(
        'fast',
        seconds=1.0,
        change=late,
        skew=0.002,
        alert_limit_deg=3.0,
    )
    assert outcome.published[10:].mean() > 0.999


def test_small_systematic_errors_are_not_silent():
    """Zero errors of the size of the nominal bias: no alarm, and the level covers them."""
    small = device.offset(0, slice(4), [0.05, -0.05, 0.05, 0.05])
    outcome = device.run('sweep', 4, 8.0, 250.0, small)
    assert outcome.published[10:].mean() > 0.999
    assert outcome.within_level


# Impacts and vibrations -----------------------------------------------------------------------


def disturbed(kind, seed, sensors, encoder):
    noise, bits = device.ENCODER_KINDS[encoder]
    return device.run(
        device.disturbance(kind, seed),
        sensors,
        noise=noise,
        bits=bits,
        seed=seed,
        sigma_deg=[noise] * 4,
    )


@SEEDS
@pytest.mark.parametrize(('sensors', 'encoder'), few(SENSORS, list(device.ENCODER_KINDS)))
def test_an_end_stop_is_healthy(sensors, encoder, seeds):
    for seed in seeds:
        outcome = disturbed('end stop', seed, sensors, encoder)
        if outcome is not None and sensors == 4:
            # A sensor that the others cannot check may leave its motion first: one sample.
            assert np.count_nonzero(~outcome.published[4:]) <= 1, seed
            assert outcome.states == ['starting', 'healthy'], seed
        else:
            assert outcome is None or outcome.healthy_throughout, seed


@SEEDS
@pytest.mark.parametrize(('sensors', 'encoder'), few(SENSORS, list(device.ENCODER_KINDS)))
def test_a_vibration_is_healthy(sensors, encoder, seeds):
    for seed in seeds:
        outcome = disturbed('vibration', seed, sensors, encoder)
        if outcome is not None and sensors == 4 and encoder == '17 bits':
            # A quiet sensor that the others cannot check may leave its motion first.
            assert outcome.published[10:].mean() > 0.99, seed
            assert set(outcome.states) == {'starting', 'healthy'}, seed
        else:
            assert outcome is None or outcome.healthy_throughout, seed


@pytest.mark.parametrize('seed', [7, 13, 15, 21])
def test_a_joint_that_is_shaken_makes_no_step_onto_another_solution(seed):
    """At rest th1C and th3A have rivals: a step much shorter than to one of them is none."""
    assert disturbed('vibration', seed, 4, '14 bits').healthy_throughout


# Stamps ---------------------------------------------------------------------------------------


def bursts(rng):
    """Return stamps of which some come late, several at once."""
    times = np.arange(2_000) * MS
    for start in rng.integers(100, 1_900, 40):
        length = rng.integers(2, 30)
        before_last = np.arange(length)[::-1] * 20_000
        last = times[start + length - 1]
        times[start : start + length] = last - before_last
    return np.maximum.accumulate(times) + np.arange(2_000)


def losses(rng, count=2_000):
    """Return stamps with a gap of up to 24 periods in every 33, and jitter."""
    is_gap = rng.random(count) < 0.03
    gaps = rng.integers(2, 25, count)
    steps = np.where(is_gap, gaps, 1) * MS
    jitter = rng.integers(-MS // 10, MS // 10, count)
    return np.cumsum(steps + jitter)


@pytest.mark.parametrize(
    ('kind', 'drawn'), few(['rest', 'crossing', 'sweep'], [bursts, losses], count=2)
)
def test_no_false_alarm_on_a_busy_host(kind, drawn):
    times = drawn(np.random.default_rng(13))
    rotations = device.motion_at(kind, times * 1e-9)
    bits = 14 if drawn is losses else 40
    readings = device.encoders(device.joint_angles(rotations), bits=bits)
    assert device.Outcome(rotations, readings, times).healthy_throughout


# Spikes and interference ----------------------------------------------------------------------


def test_a_spike_is_withheld_and_is_no_fault():
    spikes = device.every(
        device.offset(200, 0, 4.0, 201),
        device.offset(300, 3, -60.0, 302),
    )
    outcome = device.run('turning', seconds=0.5, change=spikes)
    withheld = np.flatnonzero(~outcome.published)
    assert withheld[withheld >= 5].tolist() == [200, 300, 301]
    assert outcome.within_level
    assert outcome.states[-1] == 'healthy'


@pytest.mark.parametrize('gap', [7, 20])
def test_a_spike_right_before_a_gap_is_no_fault(gap):
    outcome = device.run(
        'singular',
        seconds=0.4,
        change=device.offset(199, 3, 3.0, 200),
        times=device.paused(400, (200, gap)),
    )
    assert np.flatnonzero(~outcome.published).tolist() == [0, 1, 2, 3, 199]
    assert outcome.states[-1] == 'healthy'


@pytest.mark.parametrize(('index', 'sensor', 'gap'), few([0, 1, 2], [0, 3], [0, 700]))
def test_a_first_reading_that_is_wrong_does_not_silence_for_good(index, sensor, gap):
    first = 200 if gap else 0
    wrong = first + index
    outcome = device.run(
        'rest',
        seconds=0.4,
        change=device.offset(wrong, sensor, 5.0, wrong + 1),
        times=device.paused(400, (first, gap)),
    )
    assert not outcome.published[first : wrong + 1].any()
    assert outcome.published[first + 30 :].all()
    assert outcome.states[-1] == 'healthy'


def interference(seed, sensors, count):
    """Return what two bursts of interference make of readings, and the samples that are left."""
    rng = np.random.default_rng(seed)
    wrong = rng.choice(sensors, size=rng.integers(1, 3), replace=False)
    size = np.radians(rng.choice([2.0, 10.0, 90.0]))
    keep = np.ones(count, bool)
    spans = []
    for first in (500, 800):
        length = int(rng.integers(1, 6))
        lost = int(rng.integers(0, 9))
        spans.append(slice(first, first + length))
        keep[first + length : first + length + lost] = False

    def change(angles):
        for span in spans:
            shape = (span.stop - span.start, len(wrong))
            angles[span, wrong] += size * rng.uniform(-1.0, 1.0, shape)

    return change, keep


@SEEDS
@pytest.mark.parametrize(('sensors', 'kind'), few(SENSORS, ['rest', 'turning', 'sweep']))
def test_after_an_interference_orientations_come_again_by_themselves(sensors, kind, seeds):
    """
    On one sensor or two, for 1 to 5 ms, then up to 8 ms without a sample; and once more.

    A sensor that the others cannot check clears when the motion has brought it where they can: a
    handle at rest has to be moved, and `state` says how.
    """
    seconds = 13 if kind == 'sweep' and len(seeds) > 1 else 2
    for seed in seeds:
        change, keep = interference(seed, sensors, 1000 * seconds)
        outcome = device.run(
            kind,
            sensors,
            seconds,
            seed=seed,
            spoil=change,
            keep=keep,
        )
        last = outcome.states[-1]
        is_at_rest = (sensors, kind) == (4, 'rest')
        if is_at_rest and 'waits until checked' in last:
            assert 'turn the handle' in last, seed
            hidden = np.flatnonzero(outcome.result.unchecked[-1])
            assert any(JOINT_NAMES[place] in last for place in hidden), seed
        else:
            assert outcome.published[-100:].all(), seed


def test_noise_beyond_the_alert_limit_is_silent_and_blames_no_sensor_for_jumping():
    outcome = device.run('turning', noise=0.3)
    assert outcome.published[1000:].mean() < 0.01
    assert not np.any(outcome.error > 1.0)
    quiet = device.run('rest', seconds=0.2, alert_limit_deg=0.4)
    assert quiet.published[10:].all()
    rest = device.run('rest', noise=0.1, alert_limit_deg=0.4)
    assert not rest.published[1000:].any()
    assert rest.states[-1] == 'silent: protection level above the alert limit'
