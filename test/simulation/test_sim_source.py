# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated encoders: reproducible, with the given noise, quantised, at the given rate, faulty."""

from math import isnan, pi
from types import SimpleNamespace

from encoder_frames import values
import numpy as np
import pytest
from spm_haptic_master import timing
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.simulation import sim_source, source_factory
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.rig import make_rig
from spm_haptic_master.simulation.sim_source import PUNCTUAL
from spm_haptic_master.simulation.source_factory import make_source, source_text
from spm_haptic_master.simulation.steering import PHI_LIMITS, TILT_LIMIT
from spm_haptic_master.timing import SECOND

COUNT = 2.0 * pi / 16384
TIMES = np.linspace(0.0, 20.0, 2001)


def source_of(**overrides):
    return make_source('sim', values('sim', **overrides))


def angles(times, **overrides):
    source = source_of(**overrides)
    return np.array([source.angles(t) for t in times])


def test_noise_has_its_sigma_and_the_seed_decides_it():
    noisy = angles(TIMES, sim__noise_deg=0.2)
    error = np.degrees(noisy - angles(TIMES, sim__noise_deg=0.0))
    np.testing.assert_allclose(error.std(axis=0), 0.2, rtol=0.05)
    assert np.abs(np.corrcoef(error.T) - np.eye(4)).max() < 0.06
    assert not np.array_equal(angles(TIMES, sim__noise_deg=0.2, sim__seed=2), noisy)
    assert np.abs(np.remainder(noisy / COUNT + 0.5, 1.0) - 0.5).max() < 1e-6


def test_the_harmonics_of_the_rig_are_corrected_as_the_file_says():
    plain = {
        'sim__rig_seed': 4,
        'sim__tolerance_deg': [0.0, 0.0],
        'sim__harmonics_deg': [1.0, 0.0],
        'sim__noise_deg': 0.0,
    }
    times = (0.0, 2.0, 5.0)
    checked = values('sim', **plain)
    harmonics = [sensor.first_harmonic for sensor in make_rig(checked).sensors]
    cosine, sine = np.degrees(np.transpose(harmonics)).tolist()
    true = [make_motion(checked).joints(t) for t in times]
    wrong = np.abs(angles(times, **plain) - true).max(axis=1)
    corrected = angles(
        times,
        **plain,
        encoders__harmonic_cos_deg=cosine,
        encoders__harmonic_sin_deg=sine,
    )
    assert wrong.min() > 10.0 * COUNT
    np.testing.assert_allclose(corrected, true, atol=0.6 * COUNT)


@pytest.mark.parametrize(
    ('given', 'text', 'produce'),
    [
        ({'can__channel': 'can1'}, 'can: can1', None),
        (
            {'can__channel': 'x', 'can__interface': 'virtual', 'can__sync': 'produce'},
            'can: virtual x',
            0.01,
        ),
    ],
)
def test_the_bus_is_a_source_with_or_without_sync_from_here(monkeypatch, given, text, produce):
    made = []
    monkeypatch.setattr(source_factory, 'CanSource', lambda **given: made.append(given))
    checked = values(
        'can',
        rate=100.0,
        can__timeout=0.02,
        **given,
    )
    make_source('can', checked)
    (source,) = made
    assert source_text('can', checked) == text
    assert text.endswith(source['channel'])
    assert source['interface']
    assert (source['timeout'], source['produce']) == (0.02, produce)
    for change, words in (
        ({'can__timeout': 0.019}, 'at least two periods, 0.02 s at 100 Hz'),
        ({'can__sync': 'produce', 'encoders__sync_id': 0}, 'consume where'),
    ):
        with pytest.raises(SettingError, match=words):
            make_source('can', values('can', **{'rate': 100.0, 'can__timeout': 0.02} | change))
    assert source_text('replay', values('replay', replay__path='/a/b.log')) == 'replay: b.log'
    assert source_text('sim', {}) == 'sim'


def read(source, count):
    return [sample for _ in range(count) if (sample := source.read(0.1)) is not None]


def test_samples_come_at_the_rate_with_the_angles_of_their_time(monkeypatch):
    """Woken 0.1 ms late, of every tenth sample 3 ms, and once by two periods more."""
    now = [1_700_000_000 * SECOND]
    sleeps = []

    def sleep(seconds):
        sleeps.append(seconds)
        late = 13.0 if len(sleeps) == 50 else 3.0 if len(sleeps) % 10 == 5 else 0.1
        now[0] += round((seconds + 1e-3 * late) * SECOND)

    clock = SimpleNamespace(
        monotonic=lambda: 1e-9 * now[0],
        time_ns=lambda: now[0],
        sleep=sleep,
    )
    monkeypatch.setattr(timing, 'time', clock)
    monkeypatch.setattr(sim_source, 'time', clock)
    source = source_of(
        rate=200.0,
        sim__noise_deg=0.0,
        sim__trajectory='perturbed',
    )
    motion = make_motion(values('sim', sim__noise_deg=0.0, sim__trajectory='perturbed'))
    assert source.orientation() == motion.orientation(0.0)
    samples = read(source, 100)
    t = np.array([sample.stamp - samples[0].stamp for sample in samples]) * 1e-9
    assert t[-1] == pytest.approx((99 + 2) / 200.0 + 1e-4, abs=2e-5)
    assert source.statistics() == {'sets': 100, 'missed deadlines': 2}
    assert source.lost == 2 / 200.0
    true = np.array([motion.joints(each) for each in t])
    off = [sample.angles for sample in samples] - true
    # At most 1 rad/s, for as long as the angles prepared may be old.
    assert np.abs(off).max() < COUNT + PUNCTUAL
    np.testing.assert_allclose(source.orientation(), motion.orientation(t[-1]), atol=6e-5)
    assert (source.fault, source.caution) == (None, None)


def by_name(sample):
    """Return the angles of a sample by their joints."""
    return dict(zip(ALL_JOINT_NAMES, sample.angles, strict=False))


@pytest.mark.parametrize(
    ('sensors', 'gone', 'goes_on'),
    [
        (4, ['joint_3a'], False),
        (5, ['joint_3b'], True),
        (6, ['joint_1a', 'joint_3c'], True),
        (6, ['joint_1a', 'joint_3b', 'joint_3c'], False),
    ],
)
def test_encoders_that_do_not_answer_have_no_reading(sensors, gone, goes_on):
    source = source_of(sensors=sensors, rate=200.0)
    source.faults = tuple(parse_switched(f'dropout:{joint}', sensors) for joint in gone)
    sample = source.read(1.0)
    text = f'no answer of {", ".join(gone)}'
    if goes_on:
        missing = [name for name, angle in by_name(sample).items() if isnan(angle)]
        assert missing == gone
        assert source.fault is None
        assert source.caution == text
    else:
        assert sample is None
        assert source.fault == text
        assert source.caution is None
    source.faults = ()
    assert not any(map(isnan, source.read(1.0).angles))
    assert source.fault is None


def test_faults_come_and_go():
    source = source_of(
        rate=500.0,
        sim__noise_deg=0.0,
        sim__trajectory='sweep',
    )
    read(source, 1)
    source.faults = (parse_switched('stuck:joint_1b'), parse_switched('offset:joint_3a=5'))
    faulty = read(source, 20)
    moved = np.ptp([sample.angles for sample in faulty], axis=0) > 0.0
    assert moved[:3].tolist() == [True, False, True]
    source.faults = (parse_switched('offset:joint_1a=359'),)
    healthy = read(source, 20)
    off = np.degrees(np.subtract(healthy[0].angles, faulty[-1].angles))
    # An offset stays within a turn.
    assert off[0] == pytest.approx(-1.0, abs=0.3)
    assert off[3] == pytest.approx(-5.0, abs=0.3)
    assert len({sample.angles[1] for sample in healthy}) > 1


def test_out_of_reach_it_waits():
    """With a mechanism that reaches less: no error ends the source."""
    source = source_of(sim__noise_deg=0.0, geometry__beta_deg=24.0)
    source.angles(0.0)
    source.steering.steer(TILT_LIMIT, 0.0, PHI_LIMITS[1])
    got = np.array([source.angles(t) for t in np.arange(0.0, 5.0, 0.01)])
    assert np.ptp(got[-100:], axis=0).max() == 0.0
    source.steering.release()
    got = np.array([source.angles(t) for t in np.arange(5.0, 9.0, 0.01)])
    assert np.ptp(got[-100:], axis=0).max() > 0.0
