# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the parity vector: one sample, the mean of a window, false alarms, variance."""

from math import sqrt

import numpy as np
import pytest
from rig import product_limits
from spm_haptic_master.parameters.fkm import SAMPLES_AN_HOUR, TESTS
from spm_haptic_master.supervision.parity import ParityWindow
from spm_haptic_master.supervision.symptom import Reason, Severity

MS = 1_000_000
THRESHOLD = 7.0
BIAS = 1.5
ENTRIES = pytest.mark.parametrize('entries', [1, 2, 3])


def window(entries=1, threshold=THRESHOLD, time=0.02):
    return ParityWindow(threshold, entries, time)


def direction(entries, seed=1):
    """Return a unit vector."""
    vector = np.random.default_rng(seed).normal(size=entries)
    return vector / np.linalg.norm(vector)


def check(parities, vectors, noise=1.0, bias=BIAS, step=MS, first=0):
    """Return the symptoms of parity vectors, one a sample."""
    return [
        parities.test(first + index * step, tuple(vector), noise, bias)
        for index, vector in enumerate(np.atleast_2d(vectors).tolist())
    ]


@ENTRIES
@pytest.mark.parametrize('noise', [1.0, 2.5])
def test_a_sample_is_inconsistent_beyond_threshold_and_bias(entries, noise):
    """In any direction."""
    limit = THRESHOLD * noise + BIAS
    for seed in range(5):
        for factor, found in ((0.999, None), (1.001, Reason.INCONSISTENT)):
            (symptom,) = check(window(entries), factor * limit * direction(entries, seed), noise)
            assert (symptom and symptom.reason) == found
    assert symptom.severity is Severity.PENDING
    assert symptom.detail == f'parity {1.001 * limit:.1f} sigma, limit {limit:.1f}'
    assert check(window(entries), [[np.nan] * entries])[0].reason is Reason.INCONSISTENT


@ENTRIES
def test_a_drift_is_found_by_the_mean_of_the_window(entries):
    """Beyond the threshold over the root of its samples, and the bias, which no mean reduces."""
    for factor, found in ((0.99, False), (1.01, True)):
        size = factor * (THRESHOLD / sqrt(21.0) + BIAS)
        symptoms = check(window(entries), [size * direction(entries)] * 100)
        drifted = [each for each in symptoms if each is not None]
        assert bool(drifted) == found
        assert all(
            (each.reason, each.severity) == (Reason.DRIFTED, Severity.LATCH) for each in drifted
        )
    # The limit of evidence is that of the test.
    assert window(entries).limit(1.0, BIAS, 21) == pytest.approx(THRESHOLD / sqrt(21.0) + BIAS)


@ENTRIES
def test_healthy_noise_alarms_as_rarely_as_declared(entries):
    """One sample in 500 by itself, and as rarely together with its window."""
    share = 0.002
    count = 40_000
    limits = product_limits(false_alarms_per_hour=share * SAMPLES_AN_HOUR * TESTS)
    noise = np.random.default_rng(7).normal(size=(count, entries))
    symptoms = check(window(entries, limits.threshold(entries)), noise, bias=0.0)
    for reason, spread in ((Reason.INCONSISTENT, 0.2), (Reason.DRIFTED, 0.6)):
        found = sum(each is not None and each.reason is reason for each in symptoms)
        assert found / count == pytest.approx(share, rel=spread)


@pytest.mark.parametrize(('time', 'step', 'samples'), [(0.1, MS, 101), (0.02, 4 * MS, 10)])
def test_it_has_the_samples_of_its_time_and_ten_at_least(time, step, samples):
    parities = window(time=time)
    check(parities, np.full((200, 1), 0.5), step=step)
    assert parities.root == pytest.approx(sqrt(samples))


@pytest.mark.parametrize(('time', 'step', 'samples'), [(0.1, MS, 101), (0.02, 4 * MS, 10)])
def test_an_inconsistent_sample_is_not_in_the_mean(time, step, samples):
    """And each of the others leaves it after its time."""
    parities = window(time=time)
    check(parities, np.full((200, 1), 0.5), step=step)
    after = 200 * step
    check(parities, [[100.0]], step=step, first=after)
    assert parities.mean == pytest.approx((0.5, 0.0, 0.0))
    zeros = np.zeros((samples - 1, 1))
    check(parities, zeros, step=step, first=after)
    assert parities.mean == pytest.approx((0.5 / samples, 0.0, 0.0))
    check(
        parities,
        zeros[:1],
        step=step,
        first=(199 + samples) * step,
    )
    assert parities.mean == pytest.approx((0.0, 0.0, 0.0))


def test_rounding_does_not_add_up():
    vectors = 5.0 * np.random.default_rng(3).uniform(-1.0, 1.0, size=(5_500, 3)) + 1e-3
    parities = window(3)
    check(parities, vectors, bias=10.0)
    assert parities.mean == pytest.approx(tuple(vectors[-21:].mean(axis=0)), abs=1e-12)


@pytest.mark.parametrize(
    ('entries', 'noise'),
    [
        (1, 1.0),
        (2, 3.0),
        (3, 1.0),
    ],
)
def test_the_variance_of_the_entries_is_measured_and_outlasts_a_restart(entries, noise):
    parities = window(entries)
    vectors = noise * np.random.default_rng(2).normal(size=(4000, entries))
    variances = []
    for index, vector in enumerate(vectors.tolist()):
        parities.test(index * MS, tuple(vector), noise, BIAS)
        variances.append(parities.variance)
    assert np.mean(variances[1000:]) == pytest.approx(noise**2, rel=0.1)
    parities.restart()
    assert parities.mean == (0.0, 0.0, 0.0)
    assert parities.variance == variances[-1]
    # The first four are not tested together.
    far = [6.0 * direction(entries)] * 4
    assert not any(check(parities, far, first=10_000 * MS))


def test_neither_a_constant_parity_nor_one_outlier_is_noise():
    parities = window(threshold=100.0)
    noise = np.random.default_rng(2).normal(size=(3000, 1))
    check(parities, noise + 5.0)
    assert parities.variance == pytest.approx(1.0, rel=0.25)
    before = parities.variance
    check(parities, [[80.0]], first=3000 * MS)
    assert parities.variance < 1.1 * before
