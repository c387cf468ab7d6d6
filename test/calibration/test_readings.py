# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings of a free motion made ready: noise, spikes, gaps, turns, and what is refused."""

from dataclasses import replace
from math import radians, tau

from free_motions import DEVIATIONS, SHORT
import numpy as np
import pytest
from simulated_hand import readings
from spm_haptic_master.calibration.motion.readings import motion_readings, spread
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics.rotations import wrapped
from spm_haptic_master.simulation.rig import random_rig

N = 20000
STAMPS = np.arange(N, dtype=np.int64) * 1_000_000
NOISE = 7e-4


def motion(seed=1, noise=NOISE):
    """Return smooth readings on any turn, rad, and the same without noise."""
    random = np.random.default_rng(seed)
    t = STAMPS * 1e-9
    periods = np.array([5.0, 3.1, 4.3, 7.7])
    true = 3.0 + 0.5 * np.sin(tau * t[:, None] / periods)
    noisy = true + noise * random.normal(size=true.shape)
    return noisy % tau, true


def off(found, true):
    """Return the errors of the means, rad, shape (n, N)."""
    rows = np.round(found.seconds * 1000.0).astype(int)
    return (found.readings - true[rows] + np.pi) % tau - np.pi


@pytest.mark.parametrize(
    'rate, together, tolerance',
    [
        (1000, 2, 0.05),
        (250, 1, 0.1),
        (50, 1, 0.2),
        (10, 1, 0.5),
    ],
)
def test_means_are_of_the_readings_across_the_turn_at_any_rate(
    rate,
    together,
    tolerance,
):
    read, true = motion()
    every = slice(None, None, 1000 // rate)
    found = motion_readings(STAMPS[every], read[every])
    assert (found.together, found.sets, found.spikes) == (together, 20 * rate, 0)
    assert len(found.seconds) == 20 * rate // together
    # The mean of two is half a millisecond from the row that `seconds` rounds to.
    assert off(found, true).std() < 1.3 * NOISE
    assert np.allclose(found.noise, NOISE, rtol=tolerance)
    assert np.allclose(found.sigma, found.noise / np.sqrt(together))


@pytest.mark.parametrize('part', (0.01, 0.05))
def test_spikes_are_left_out(part):
    read, true = motion()
    random = np.random.default_rng(3)
    wrong = random.uniform(size=N) < part
    sensors = random.integers(0, 4, wrong.sum())
    read[wrong, sensors] = random.uniform(0.0, tau, wrong.sum())
    found = motion_readings(STAMPS, read)
    # One in a hundred of them is so near the true reading that it is none, and others pass where
    # two follow each other: the fit cuts these.
    assert found.spikes > 0.7 * wrong.sum()
    largest = np.abs(off(found, true)).max(axis=1)
    assert np.mean(largest > 0.02) < 0.3 * part


def test_a_gap_is_bridged_by_no_mean():
    read, true = motion()
    kept = np.ones(N, dtype=bool)
    kept[5001:9000] = False
    found = motion_readings(STAMPS[kept], read[kept])
    assert not ((found.seconds > 5.001) & (found.seconds < 8.999)).any()
    assert np.abs(off(found, true)).max() < 6.0 * NOISE


def test_too_few_sets_rest_and_nothing_but_spikes_are_refused():
    read, _ = motion()
    with pytest.raises(
        CalibrationError,
        match=r'^1999 sets of four encoders in 2\.0 s; a motion '
        r'needs at least 200 sets and 2 s$',
    ):
        motion_readings(STAMPS[:1999], read[:1999])
    with pytest.raises(CalibrationError, match=r'^150 sets of four encoders in 14\.9 s; '):
        motion_readings(STAMPS[::100][:150], read[::100][:150])
    still = read.copy()
    random = np.random.default_rng(2)
    still[:, 1] = 1.0 + NOISE * random.normal(size=N)
    with pytest.raises(CalibrationError, match='joint_1b moved by 0.[01]. deg; expected a motion'):
        motion_readings(STAMPS, still)
    # Neither does a joint move that is elsewhere for a twentieth of the time, as by spikes.
    for part, moves in ((20, False), (7, True)):
        still[-(N // part) + 1 :, 1] += 0.5
        still[: N // part, 1] -= 0.5
        if moves:
            motion_readings(STAMPS, still)
            break
        with pytest.raises(CalibrationError, match='joint_1b moved by 0.[01]. deg; expected'):
            motion_readings(STAMPS, still)
    still[:, 2] = 0.5
    with pytest.raises(CalibrationError, match=r'joint_1c moved by 0\.00 deg; expected'):
        motion_readings(STAMPS, still)
    random = np.random.default_rng(4)
    wrong = random.uniform(size=N) < 0.6
    read[wrong, 0] = random.uniform(0.0, tau, wrong.sum())
    with pytest.raises(CalibrationError, match='joint_1a has a noise of .* or spikes'):
        motion_readings(STAMPS, read)


def test_stamps_that_go_back_are_refused_and_a_jump_forward_is_none():
    read, _ = motion()
    back = STAMPS.copy()
    back[7000:] -= 5_000_000_000
    with pytest.raises(CalibrationError, match='the stamp of set 7001 is 4999000000 ns before'):
        motion_readings(back, read)
    ahead = STAMPS.copy()
    ahead[100:] += 1_700_000_000_000_000_000
    assert len(motion_readings(ahead, read).seconds) == N // 2


def test_sets_without_a_period_are_refused():
    read, _ = motion()
    steps = np.array([1_000_000, 50_000_000, 7_000_000_000])
    irregular = STAMPS[0] + np.cumsum(np.resize(steps, len(STAMPS)))
    with pytest.raises(CalibrationError, match='do not come at a regular interval'):
        motion_readings(irregular, read)


def test_readings_of_a_hand_with_outliers_rest_and_a_gap_are_made_ready():
    """The same hand without outliers and noise is the truth."""
    built = random_rig(3, DEVIATIONS)
    condition = replace(
        SHORT,
        seconds=12.0,
        outliers=0.05,
        dropout=0.05,
        rest=0.1,
    )
    stamps, raw, _, _ = readings(built, condition, 8)
    perfect = replace(condition, outliers=0.0, noise=0.0)
    true = readings(built, perfect, 8)[1]
    wrong = np.abs(wrapped(raw - true)).max(axis=1) > radians(1.0)
    found = motion_readings(stamps, raw)
    assert found.sets == len(stamps) == 11400
    assert found.spiked[wrong].mean() > 0.95
    assert found.spiked[~wrong].mean() < 0.002
    assert np.degrees(found.noise) == pytest.approx([0.041] * 4, rel=0.03)
    rows = np.searchsorted(stamps, found.seconds * 1e9 + stamps[0])
    errors = np.degrees(wrapped(found.readings - true[rows]))
    # A spike that is near the true reading is none.
    sizes = np.abs(errors).max(axis=1)
    assert np.median(sizes) < 0.08
    assert (sizes > 0.3).mean() < 0.003


def test_spread_takes_the_corners_first():
    along = np.linspace(0.0, 1.0, 5)
    grid = np.stack(np.meshgrid(along, along), -1).reshape(-1, 2)
    rows = spread(grid, 5)
    corners = {(x, y) for x in (0.0, 1.0) for y in (0.0, 1.0)}
    assert set(map(tuple, grid[rows[1:]])) == corners
    assert len(spread(grid, 100)) == 25
