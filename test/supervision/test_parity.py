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
    rng = np.random.default_rng(seed)
    vector = rng.normal(size=entries)
    return vector / np.linalg.norm(vector)


def check(parities, vectors, noise=1.0, bias=BIAS, step=MS, first=0):
    """Return the symptoms of parity vectors, one a sample."""
    symptoms = []
    stamp = first
    for vector in np.atleast_2d(vectors).tolist():
        symptoms.append(parities.test(stamp, tuple(vector), noise, bias))
        stamp += step
    return symptoms


@ENTRIES
@pytest.mark.parametrize('noise', [1.0, 2.5])
def test_a_sample_is_inconsistent_beyond_threshold_and_bias(entries, noise):
    """In any direction."""
    limit = THRESHOLD * noise + BIAS
    for seed in range(5):
        towards = direction(entries, seed)
        assert check(window(entries), 0.999 * limit * towards, noise) == [None]
        (symptom,) = check(window(entries), 1.001 * limit * towards, noise)
        assert symptom.reason is Reason.INCONSISTENT
        assert symptom.severity is Severity.PENDING
        assert symptom.detail == f'parity {1.001 * limit:.1f} sigma, limit {limit:.1f}'


@ENTRIES
def test_a_parity_that_is_not_a_number_is_inconsistent(entries):
    (symptom,) = check(window(entries), [[np.nan] * entries])
    assert symptom.reason is Reason.INCONSISTENT


@ENTRIES
def test_a_drift_is_found_by_the_mean_of_the_window(entries):
    """Beyond the threshold over the root of its samples, and the bias, which no mean reduces."""
    limit = THRESHOLD / sqrt(21.0) + BIAS
    within = 0.99 * limit * direction(entries)
    beyond = 1.01 * limit * direction(entries)
    assert check(window(entries), [within] * 100) == [None] * 100
    drifted = [each for each in check(window(entries), [beyond] * 100) if each]
    assert drifted
    for symptom in drifted:
        assert symptom.reason is Reason.DRIFTED
        assert symptom.severity is Severity.LATCH
    # The limit of evidence is that of the test.
    assert window(entries).limit(1.0, BIAS, 21) == pytest.approx(limit)


@ENTRIES
def test_healthy_noise_alarms_as_rarely_as_declared(entries):
    """One sample in 500 by itself, and as rarely together with its window."""
    share = 0.002
    count = 40_000
    limits = product_limits(false_alarms_per_hour=share * SAMPLES_AN_HOUR * TESTS)
    noise = np.random.default_rng(7).normal(size=(count, entries))
    parities = window(entries, limits.threshold(entries))
    symptoms = check(parities, noise, bias=0.0)
    reasons = [each.reason for each in symptoms if each is not None]
    by_itself = reasons.count(Reason.INCONSISTENT)
    with_its_window = reasons.count(Reason.DRIFTED)
    assert by_itself / count == pytest.approx(share, rel=0.2)
    assert with_its_window / count == pytest.approx(share, rel=0.6)


# Time of a window, s, and of a sample, ns; how many samples the window has.
WINDOWS = pytest.mark.parametrize(
    ('time', 'step', 'samples'),
    [
        (0.1, MS, 101),
        (0.02, 4 * MS, 10),
    ],
)


@WINDOWS
def test_it_has_the_samples_of_its_time_and_ten_at_least(time, step, samples):
    parities = window(time=time)
    check(parities, np.full((200, 1), 0.5), step=step)
    assert parities.root == pytest.approx(sqrt(samples))


@WINDOWS
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
    after = (199 + samples) * step
    check(parities, zeros[:1], step=step, first=after)
    assert parities.mean == pytest.approx((0.0, 0.0, 0.0))


def test_rounding_does_not_add_up():
    rng = np.random.default_rng(3)
    vectors = 5.0 * rng.uniform(-1.0, 1.0, size=(5_500, 3)) + 1e-3
    parities = window(3)
    check(parities, vectors, bias=10.0)
    expected = vectors[-21:].mean(axis=0)
    assert parities.mean == pytest.approx(tuple(expected), abs=1e-12)


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
    rng = np.random.default_rng(2)
    vectors = noise * rng.normal(size=(4000, entries))
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


def test_five_samples_at_least_are_tested_together():
    """The fifth is the first; a small window counts as ten samples meanwhile."""
    parities = window()
    assert parities.root == pytest.approx(sqrt(10.0))
    far = [[6.0]] * 10
    shown = check(parities, far, bias=0.0)
    assert [each is not None for each in shown] == [False] * 4 + [True] * 6
    assert shown[4].detail == 'mean parity of 5 samples 6.00 sigma, limit 3.13'
    assert parities.root == pytest.approx(sqrt(10.0))
    check(parities, np.zeros((10, 1)), first=10 * MS)
    assert parities.root == pytest.approx(sqrt(20.0))
    parities.restart()
    assert parities.root == pytest.approx(sqrt(10.0))
    assert parities.mean_bias == 0.0


def test_a_window_is_as_long_as_its_time_and_has_ten_samples_at_least():
    parities = window(time=0.02)
    # Twenty samples before it are 20 ms old; an older one leaves it.
    check(parities, np.full((21, 1), 0.5))
    assert parities.root == pytest.approx(sqrt(21.0))
    check(parities, [[0.5]], first=21 * MS)
    assert parities.root == pytest.approx(sqrt(21.0))
    check(parities, [[0.5]], first=900 * MS)
    assert parities.root == pytest.approx(sqrt(10.0))


@ENTRIES
def test_the_mean_bias_is_that_of_the_samples_of_the_window(entries):
    """Where the device slows down the biases of its samples were larger before."""
    parities = window(entries)
    assert parities.mean_bias == 0.0
    zeros = np.zeros((30, entries))
    check(parities, zeros, bias=3.0)
    assert parities.mean_bias == pytest.approx(3.0)
    check(parities, zeros[:7], bias=0.0, first=30 * MS)
    assert parities.mean_bias == pytest.approx(3.0 * 14.0 / 21.0)
    check(parities, zeros[:14], bias=0.0, first=37 * MS)
    assert parities.mean_bias == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(('factor', 'drifted'), [(0.99, False), (1.01, True)])
def test_a_mean_may_be_as_large_as_the_biases_of_its_samples_allow(factor, drifted):
    """Those of the latest sample may do less."""
    parities = window(threshold=7.0)
    before = 2.0
    limit = before * 20.0 / 21.0 + 7.0 / sqrt(21.0)
    check(parities, np.full((20, 1), factor * limit), bias=before)
    (shown,) = check(parities, [[factor * limit]], bias=0.0, first=20 * MS)
    assert (shown is not None) == drifted
    # The biases of the latest sample count where they do more.
    limit = before + 7.0 / sqrt(21.0)
    parities = window(threshold=7.0)
    check(parities, np.full((20, 1), factor * limit), bias=before)
    (shown,) = check(parities, [[factor * limit]], bias=before, first=20 * MS)
    assert (shown is not None) == drifted


@pytest.mark.parametrize('entries', [1, 3])
@pytest.mark.parametrize('large', [3e16, -3e16])
def test_what_rounding_takes_from_the_sums_is_back_after_a_thousand_samples(entries, large):
    """Very large parities, which are not tested here, leave nothing behind."""
    parities = window(entries, threshold=1e18)
    ones = np.ones((999, entries))
    check(parities, [[large] * entries], bias=abs(large))
    check(parities, ones[:998], bias=1.0, first=MS)
    expected = (1.0, 1.0, 1.0)[:entries] + (0.0,) * (3 - entries)
    assert parities.mean != pytest.approx(expected, rel=1e-3)
    assert parities.mean_bias != pytest.approx(1.0, rel=1e-3)
    check(parities, ones[:1], bias=1.0, first=999 * MS)
    assert parities.mean == pytest.approx(expected)
    assert parities.mean_bias == pytest.approx(1.0)
    # And again after the next thousand.
    check(parities, [[large] * entries], bias=abs(large), first=1000 * MS)
    check(parities, ones[:998], bias=1.0, first=1001 * MS)
    assert parities.mean != pytest.approx(expected, rel=1e-3)
    check(parities, ones[:1], bias=1.0, first=1999 * MS)
    assert parities.mean == pytest.approx(expected)


@pytest.mark.parametrize(
    ('before', 'factor', 'square', 'averaged'),
    [
        # The expected variance counts for 64 samples at the start, then up to 256 count.
        (0, 2.0, 4.0, 65),
        (0, 0.0, 0.0, 65),
        (10, 2.0, 4.0, 75),
        (191, 2.0, 4.0, 256),
        (300, 2.0, 4.0, 256),
        # An outlier counts for 16 times the variance at most.
        (0, 3.9, 15.21, 65),
        (0, 4.1, 16.0, 65),
        (0, 50.0, 16.0, 65),
    ],
)
@ENTRIES
def test_the_variance_averages_the_squares_about_the_mean(
    before, factor, square, averaged, entries
):
    parities = window(entries, threshold=1e9)
    assert parities.variance == 1.0
    check(parities, np.zeros((4, entries)), step=0)
    # Those before deviate by 1 from the mean of the window with them.
    for samples, size in enumerate([1.0] * before + [factor], 4):
        off = parities.mean[0] + size * (samples + 1) / samples
        check(parities, [[off] * entries])
    assert parities.variance == pytest.approx(1.0 + (square - 1.0) / averaged)
