# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings of a free motion made ready: noise, spikes, gaps, turns, and what is refused."""

from dataclasses import replace
from math import radians, tau
import re

from free_motions import DEVIATIONS, SHORT
import numpy as np
import pytest
from simulated_hand import readings
from spm_haptic_master.calibration.motion import readings as motion_of
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


LIMIT = np.array([0.25, 0.125])


def test_a_mean_is_of_the_sets_whose_readings_are_all_within_the_limit_of_the_median():
    """Also across the turn; one that is just as far off as the limit is a spike."""
    begin = np.array([6.0, -3.0])
    offsets = np.array([[-0.1875, 0.0], [0.0, 0.0], [0.0625, 0.0], [0.0, 0.125], [0.25, 0.12]])
    pieces = (begin + offsets)[None]
    means, good = motion_of._means_without_spikes(pieces % tau, LIMIT)
    assert good.tolist() == [[True, True, True, False, False]]
    errors = wrapped(means[0] - begin - offsets[:3].mean(axis=0))
    np.testing.assert_allclose(errors, 0.0, atol=1e-12)


def test_a_piece_without_a_good_set_has_no_mean():
    pieces = np.array([[[0.0, 0.0], [2.0, 2.0]], [[0.5, 0.25], [0.5, 0.25]]])
    means, good = motion_of._means_without_spikes(pieces, LIMIT)
    assert good.tolist() == [[False, False], [True, True]]
    assert np.isnan(means[0]).all()
    assert means[1].tolist() == [0.5, 0.25]
    assert motion_of._has_enough(good).tolist() == [False, True]


def test_more_than_half_of_the_sets_of_a_piece_are_enough():
    numbers = np.arange(4)
    good = np.array([numbers < count for count in (0, 1, 2, 3, 4)])
    assert motion_of._has_enough(good).tolist() == [False, False, False, True, True]
    assert motion_of._has_enough(np.array([[True], [False]])).tolist() == [True, False]


@pytest.mark.parametrize(
    ('across', 'spike', 'alone'),
    [
        (0.0, 0.76, True),
        (0.0, 0.74, False),
        # Between neighbours that are apart: twice that more.
        (0.25, 1.51, True),
        (0.25, 1.49, False),
        (-0.25, 1.01, False),
    ],
)
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_reading_far_from_both_neighbours_is_alone(
    across,
    spike,
    alone,
    sign,
):
    """By three times the limit, and twice what these are apart; from the nearer one."""
    second = 0.1 + sign * np.array([0.0, spike, across, across])
    readings = np.column_stack([second, np.zeros(4)]) % tau
    assert motion_of._alone(readings, LIMIT).tolist() == [False, alone, False, False]
    # One that stays there has moved.
    stays = np.column_stack([[0.0, spike, spike, spike], np.zeros(4)])
    assert not motion_of._alone(stays, LIMIT).any()


def test_pieces_follow_each_other_and_bridge_no_gap():
    steps = np.array([10, 10, 10, 10, 100, 10, 10, 11, 9])
    assert motion_of._pieces(steps, 2).tolist() == [[0, 1], [2, 3], [5, 6], [7, 8]]
    assert motion_of._pieces(steps, 3).tolist() == [[0, 1, 2], [5, 6, 7]]
    assert motion_of._pieces(steps, 1).ravel().tolist() == list(range(10))


@pytest.mark.parametrize(
    ('sets', 'period_ms', 'together'),
    [
        (12_000, 1, 1),
        (12_001, 1, 2),
        (12_001, 5, 2),
        (12_001, 6, 1),
        (12_001, 10, 1),
        (30_000, 5, 2),
        (30_000, 1, 3),
    ],
)
def test_twelve_thousand_means_of_a_hundredth_of_a_second_are_enough(
    sets,
    period_ms,
    together,
):
    stamps = np.arange(sets) * 1_000_000 * period_ms
    turned = np.column_stack([np.sin(stamps * 1e-9 / period) for period in (0.9, 1.1, 1.3, 1.5)])
    noise = 1e-3 * np.random.default_rng(1).normal(size=turned.shape)
    found = motion_readings(stamps, turned + noise)
    assert found.together == together
    assert found.rate == pytest.approx(1000.0 / period_ms / together)


def test_a_spike_is_beyond_what_noise_and_the_fastest_hand_allow():
    """Eight deviations, and 10 rad/s in half a piece of two milliseconds."""
    read, _ = motion()
    limit = 8.0 * NOISE + 10.0 * 1e-3
    rows = np.arange(1000, N - 1000, 1000)
    spiked = {}
    for share in (0.85, 1.15):
        changed = read.copy()
        # Both readings of a piece are as far from their median.
        changed[rows, 1] = changed[rows + 1, 1] + 2.0 * share * limit
        spiked[share] = motion_readings(STAMPS, changed).spiked[rows].mean()
    assert spiked == {0.85: 0.0, 1.15: 1.0}


@pytest.mark.parametrize(
    ('spikes', 'any_mean', 'words'),
    [
        (300, True, ''),
        (301, True, '30 % of the sets have a spike; expected at most 30 %'),
        (480, True, '48 % of the sets have a spike; expected at most 30 %'),
        (0, False, '0 % of the sets have a spike; expected at most 30 %'),
    ],
)
def test_more_than_three_of_ten_sets_with_a_spike_are_refused(
    spikes,
    any_mean,
    words,
):
    try:
        motion_of._check_spikes(spikes, 1000, any_mean)
    except CalibrationError as error:
        assert str(error) == words
    else:
        assert words == ''


@pytest.mark.parametrize(('moved_deg', 'seen'), [(2.45, '1.96'), (2.55, None)])
def test_a_joint_moves_by_two_degrees_but_for_the_outermost_tenths(moved_deg, seen):
    """The last of four joints, whose angles pass the turn."""
    ramp = np.radians(moved_deg) * np.linspace(-0.5, 0.5, 101)
    means = np.column_stack([np.linspace(0.0, 9.0, 101)] * 3 + [ramp]) % tau
    if seen is None:
        motion_of._check_travel(means)
        return
    with pytest.raises(
        CalibrationError, match=f'^joint_3a moved by {seen} deg; expected a motion'
    ):
        motion_of._check_travel(means)


@pytest.mark.parametrize(
    ('sets', 'last', 'words'),
    [
        (200, 2.0, None),
        (199, 9.0, '199 sets of five encoders in 9.0 s; a motion needs at least 200 sets and 2 s'),
        (900, 1.9, '900 sets of five encoders in 1.9 s; a motion needs at least 200 sets and 2 s'),
        (0, 0.0, '0 sets of five encoders in 0.0 s; a motion needs at least 200 sets and 2 s'),
    ],
)
def test_a_motion_needs_two_hundred_sets_and_two_seconds(
    sets,
    last,
    words,
):
    stamps = 1_700_000_000_000_000_000 + np.rint(1e9 * np.linspace(0.0, last, sets)).astype(
        np.int64
    )
    if words is None:
        motion_of._check_stamps(stamps, 5)
        return
    with pytest.raises(CalibrationError, match=f'^{re.escape(words)}$'):
        motion_of._check_stamps(stamps, 5)


def test_stamps_increase_by_a_nanosecond_at_least():
    stamps = np.arange(300) * 10_000_000
    stamps[200] = stamps[199] + 1
    motion_of._check_stamps(stamps, 4)
    stamps[100] = stamps[99] + 1
    stamps[200] = stamps[199]
    with pytest.raises(CalibrationError, match='^the stamp of set 201 is 0 ns before that of the'):
        motion_of._check_stamps(stamps, 4)


@pytest.mark.parametrize(('noise_deg', 'refused'), [(0.46, False), (0.54, True)])
def test_a_sensor_may_have_a_noise_of_half_a_degree(noise_deg, refused):
    random = np.random.default_rng(7)
    read = np.full((2000, 4), 3.0)
    read[:, 2] += radians(noise_deg) * random.normal(size=2000)
    if not refused:
        found = motion_of._checked_noise(STAMPS[:2000], read)
        assert found == pytest.approx([0.0, 0.0, radians(noise_deg), 0.0], rel=0.1)
        return
    words = r'^joint_1c has a noise of 0\.5\d deg .* expected at most 0\.5 deg$'
    with pytest.raises(CalibrationError, match=words):
        motion_of._checked_noise(STAMPS[:2000], read)


def test_spread_measures_across_the_turn():
    """A joint that passes it: from the middle to both ends, of a turn on which they are near."""
    ramp = np.linspace(-2.9, 2.9, 101)
    read = np.column_stack([(ramp + 3.0) % tau, np.zeros(101)])
    assert spread(read, 3)[0] == 50
    assert set(spread(read, 3)[1:]) == {0, 100}


def test_a_motion_with_too_many_spikes_is_refused(monkeypatch):
    """One set in a hundred has one, and its neighbours in a piece count as well."""
    read, _ = motion()
    read[::100, 2] += 1.0
    motion_readings(STAMPS, read)
    monkeypatch.setattr(motion_of, 'SPIKES_MAXIMUM', 0.01)
    with pytest.raises(
        CalibrationError, match=r'^2 % of the sets have a spike; expected at most 1'
    ):
        motion_readings(STAMPS, read)
