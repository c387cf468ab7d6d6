# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which samples a lower rate takes, by their stamps."""

import random

import numpy as np
import pytest
from spm_haptic_master.timing import StampGrid

MS = 1_000_000
BEGIN = 1_700_000_000_000 * MS


def chosen(rate, stamps, sample_rate=1000.0):
    grid = StampGrid(rate, sample_rate)
    return [stamp for stamp in stamps if grid.is_due(stamp)]


@pytest.mark.parametrize('rate', [0.0, 1000.0, 5000.0])
def test_every_sample(rate):
    stamps = [BEGIN + k * MS for k in range(50)]
    assert chosen(rate, stamps) == stamps


@pytest.mark.parametrize('rate', [10.0, 200.0, 333.0, 999.0])
def test_the_rate_is_kept_whatever_the_jitter(rate):
    generator = random.Random(1)
    stamps = [BEGIN + k * MS + generator.randrange(-MS // 3, MS // 3) for k in range(10_000)]
    found = chosen(rate, stamps)
    assert len(found) == pytest.approx(10.0 * rate, rel=3e-3, abs=1.5)
    # No two are nearer than the rate allows, but for one sample and the jitter.
    assert np.diff(found).min() >= 1e9 / rate - 1.7 * MS


def test_after_a_pause_there_is_one_not_a_burst():
    stamps = [BEGIN + k * MS for k in (*range(100), *range(5000, 5100))]
    found = chosen(200.0, stamps)
    assert np.diff(found).min() == 5 * MS


def test_a_clock_that_is_set_back_ends_no_output():
    stamps = [BEGIN + k * MS for k in range(100)]
    stamps += [stamp - 3_600_000 * MS for stamp in stamps]
    assert len(chosen(200.0, stamps)) == 40
