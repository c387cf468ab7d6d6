# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parity against noise and nominal bias: one sample, and the mean of a window of time."""

from math import nextafter

import numpy as np
import pytest
from spm_haptic_master.supervision.consistency_monitor import ConsistencyMonitor

THRESHOLD = 6.0
MS = 1_000_000


class Played:
    """A monitor, and a clock that grows by a period a sample."""

    def __init__(self, window=0.02, rate=1000.0):
        self.monitor = ConsistencyMonitor(THRESHOLD, window)
        self.period = round(1e9 / rate)
        self.stamp = 0

    def check(self, parity, bias=0.0, noise=1.0):
        self.stamp += self.period
        return self.monitor.check(self.stamp, parity, bias, noise)

    def alert(self, parity, most=2000, **changed):
        """Return how many equal parities it takes to the alarm, None for more than `most`."""
        for count in range(1, most + 1):
            if self.check(parity, **changed) is not None:
                return count
        return None


# One sample ---------------------------------------------------------------------------------

@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize(('bias', 'noise', 'limit'), [
    (0.0, 1.0, 6.0), (1.5, 1.0, 7.5), (0.0, 2.0, 12.0), (1.5, 2.0, 13.5)])
def test_one_sample_may_have_noise_and_nominal_bias(sign, bias, noise, limit):
    assert Played().check(sign * limit, bias, noise) is None
    symptom = Played().check(sign * nextafter(limit, 99.0), bias, noise)
    assert (symptom.reason, symptom.sensor) == ('inconsistent angles', None)
    assert symptom.detail == f'parity {sign * limit:.1f} sigma, limit {limit:.1f}'
    assert not symptom.fault
    assert not symptom.passive


@pytest.mark.parametrize('parity', [np.nan, np.inf, -np.inf])
def test_a_parity_that_is_not_finite_is_inconsistent(parity):
    assert Played().check(parity).reason == 'inconsistent angles'


def test_an_inconsistent_sample_does_not_enter_the_window():
    played = Played()
    for _ in range(10):
        played.check(0.5)
    assert played.check(1000.0) is not None
    assert (played.monitor.count, played.monitor.mean) == (10, 0.5)
    assert played.check(0.5) is None


# The window ---------------------------------------------------------------------------------

@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_the_mean_of_n_samples_has_its_own_noise(sign):
    """6 / sqrt(9) is 2: the tenth sample of that size is the alarm."""
    played = Played()
    assert [played.check(2.0 * sign) for _ in range(9)] == [None] * 9
    symptom = played.check(2.0 * sign)
    assert (symptom.reason, symptom.sensor) == ('angles drifted apart', None)
    assert symptom.detail == f'mean parity of 10 samples {2.0 * sign:.2f} sigma, limit 1.90'
    assert symptom.fault
    assert not symptom.passive


def test_the_mean_is_tested_from_five_samples_on():
    assert Played().alert(5.9) == 5
    assert Played().alert(2.9) == 5
    assert Played().alert(2.6) == 6


@pytest.mark.parametrize('bias', [0.0, 0.5, 2.0])
def test_the_nominal_bias_adds_to_the_limit_of_the_mean(bias):
    limit = bias + 6.0 / 21 ** 0.5
    assert Played().alert(limit - 1e-9, bias=bias) is None
    assert Played().alert(limit + 1e-9, bias=bias) == 21


@pytest.mark.parametrize('noise', [1.0, 1.5, 3.0])
def test_measured_noise_widens_the_limit_of_the_mean(noise):
    limit = 6.0 * noise / 21 ** 0.5
    assert Played().alert(limit - 1e-9, noise=noise) is None
    assert Played().alert(limit + 1e-9, noise=noise) == 21


def test_the_noise_and_bias_of_the_latest_sample_count():
    played = Played()
    for _ in range(30):
        assert played.check(2.5, bias=2.0) is None
    assert played.check(2.5).reason == 'angles drifted apart'


@pytest.mark.parametrize(('rate', 'count'), [
    (100.0, 10), (250.0, 10), (500.0, 11), (1000.0, 21), (2000.0, 41), (4000.0, 81)])
def test_the_window_is_a_time_and_ten_samples_at_least(rate, count):
    """20 ms, both ends included."""
    played = Played(rate=rate)
    for _ in range(300):
        played.check(0.1)
    assert played.monitor.count == count
    # The smallest offset that is an alarm for good.
    limit = 6.0 / count ** 0.5
    assert Played(rate=rate).alert(limit - 1e-9) is None
    assert Played(rate=rate).alert(limit + 1e-9) == count


@pytest.mark.parametrize(('window', 'count'), [(0.001, 10), (0.05, 51), (0.0149, 15)])
def test_the_windows_time_is_a_setting(window, count):
    played = Played(window)
    for _ in range(100):
        played.check(0.1)
    assert played.monitor.count == count


def test_samples_leave_the_window_with_their_age():
    played = Played()
    for _ in range(15):
        played.check(1.0)
    # A gap of 16 ms: of the 15 samples, 1 to 15 ms old, some are older than 20 ms now.
    played.stamp += 15 * MS
    played.check(0.0)
    assert played.monitor.count == 10
    assert played.monitor.mean == pytest.approx(0.9)
    # However long it is, nine of them remain.
    played.stamp += 400 * MS
    played.check(0.0)
    assert played.monitor.count == 10
    assert played.monitor.mean == pytest.approx(0.8)


def test_the_mean_is_that_of_the_window():
    assert Played().monitor.mean == 0.0
    played = Played()
    for index in range(40):
        played.check(float(index % 5))
    assert played.monitor.mean == pytest.approx(np.mean([index % 5 for index in range(19, 40)]))


def test_restart_empties_the_window():
    played = Played()
    for _ in range(9):
        played.check(2.0)
    played.monitor.restart()
    assert (played.monitor.count, played.monitor.mean) == (0, 0.0)
    assert played.alert(2.0) == 10


def test_rounding_does_not_add_up():
    """The sum is made again from the window's samples after a thousand."""
    played = Played(window=0.005)
    for parity in (1e17, 1.0, 1e17, 1.0):
        played.check(parity, bias=2e17)
    for _ in range(995):
        assert played.check(0.25, bias=2e17) is None
    assert played.monitor.mean != 0.25
    for _ in range(3):
        played.check(0.25)
        assert played.monitor.mean == 0.25
