# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a recording says about its sensors, on simulated ones with known errors."""

import numpy as np
import pytest
from spm_haptic_master.kinematics import Geometry, inverse, jacobian, workspace_pose
from spm_haptic_master.validation import parity_map

SIGMA = np.radians([0.04] * 4)


def joints(rotations):
    found = inverse(rotations)
    return np.column_stack([found.theta1, found.theta3a])


def mapped(angles, sigma=SIGMA):
    return parity_map.parity_map(
        angles,
        tuple(sigma),
        Geometry(),
        (1, 1, 1),
    )


def sweep(n):
    """Return a motion over the workspace, sampled at 1 kHz, and noise of 0.04 deg."""
    t = np.arange(n) * 1e-3
    rotations = workspace_pose(
        np.radians(9.0 * (1.0 - np.cos(0.8 * t))),
        1.3 * t,
        np.radians(25.0 + 25.0 * np.sin(0.4 * t)),
    )
    return rotations, np.random.default_rng(3).normal(size=(n, 4)) * SIGMA


def stamps(n):
    return 1_700_000_000_000_000_000 + 1_000_000 * np.arange(n)


@pytest.mark.parametrize('sigma_deg', [[0.04] * 4, [0.02, 0.04, 0.08, 0.05]])
def test_the_parity_is_the_null_vector_times_the_errors(sigma_deg):
    """Of the first four sensors: the fifth and the sixth have no reading."""
    rotations, _ = sweep(50)
    errors = np.radians([0.03, -0.05, 0.02, 0.08])
    without_reading = np.full((50, 2), np.nan)
    angles = np.hstack([joints(rotations) + errors, without_reading])
    found = mapped(angles, np.radians([*sigma_deg, 0.04, 0.04]))
    left, _, _ = np.linalg.svd(jacobian(rotations, sensors=4))
    normal = left[:, :, 3]
    expected = np.abs(np.degrees(normal @ errors))
    np.testing.assert_allclose(np.abs(found.parity_deg), expected, atol=1e-3)


def test_the_place_is_tilt_and_self_rotation():
    tilts = np.radians([0.0, 12.0, 20.0])
    turns = np.radians([10.0, 30.0, -20.0])
    rotation = workspace_pose(tilts, 2.0, turns)
    found = mapped(joints(rotation))
    np.testing.assert_allclose(found.tilt_deg, [0.0, 12.0, 20.0], atol=1e-4)
    np.testing.assert_allclose(found.phi_deg, [10.0, 30.0, -20.0], atol=1e-4)


# Which of 4000 samples were published, and their levels (deg).
PUBLISHED = np.arange(4000) % 4 > 0
LEVELS = np.linspace(0.5, 0.9, 4000)


@pytest.fixture(scope='module')
def swept():
    """Return the parity of a sweep of which two samples have no orientation."""
    rotations, noise = sweep(4000)
    angles = joints(rotations) + noise
    angles[3, 1] = np.nan
    angles[7] = [1.5, -1.5, 1.5, 1.0]
    return mapped(angles)


def in_region(found, row):
    """Return which samples are in a region."""
    in_tilt = (found.tilt_deg >= row.tilt_from_deg) & (found.tilt_deg < row.tilt_to_deg)
    in_turn = (found.phi_deg >= row.phi_from_deg) & (found.phi_deg < row.phi_to_deg)
    return in_tilt & in_turn


def test_regions_are_of_all_samples_with_an_orientation(swept):
    without = np.flatnonzero(np.isnan(swept.parity_deg))
    table = parity_map.regions(swept, PUBLISHED, LEVELS)
    assert without.tolist() == [3, 7]
    assert sum(row.samples for row in table) == 3998
    for row in table:
        inside = in_region(swept, row)
        parity = swept.parity_deg[inside]
        assert row.phi_to_deg - row.phi_from_deg == pytest.approx(15.0)
        assert row.samples == inside.sum()
        assert row.published == pytest.approx(PUBLISHED[inside].mean())
        assert row.mean_deg == pytest.approx(parity.mean())
        assert row.rms_deg == pytest.approx(np.sqrt(np.mean(parity**2)))
        assert row.level_deg == pytest.approx(np.median(LEVELS[inside & PUBLISHED]))


def test_a_region_without_a_published_sample_has_no_level(swept):
    nothing = np.zeros(4000, bool)
    for row in parity_map.regions(swept, nothing, LEVELS):
        assert np.isnan(row.level_deg)


def test_regions_are_written_as_a_table_from_the_centre_outwards(swept, tmp_path):
    table = parity_map.regions(swept, PUBLISHED, LEVELS)
    parity_map.write_regions(tmp_path / 'regions.csv', table)
    header, *lines = (tmp_path / 'regions.csv').read_text().splitlines()
    assert header == (
        'tilt_from_deg,tilt_to_deg,phi_from_deg,phi_to_deg,samples,published,mean_deg,rms_deg,'
        'level_deg'
    )
    written = [[float(field) for field in line.split(',')] for line in lines]
    assert written == [[float(value) for value in row] for row in table]
    tilts = [row.tilt_from_deg for row in table]
    assert tilts == sorted(tilts)


def test_noise_is_that_of_each_sensor_in_motion_and_at_rest():
    rotations, noise = sweep(20_000)
    expected = np.array([0.08, 0.04, 0.04, 0.16])
    noise *= expected / 0.04
    for angles in (joints(rotations) + noise, noise):
        found = parity_map.white_noise(stamps(20_000), angles)
        np.testing.assert_allclose(np.degrees(found), expected, rtol=0.03)


def test_noise_ignores_steps_gaps_and_missing_readings():
    rotations, noise = sweep(5000)
    angles = joints(rotations) + noise
    angles[3000:, 1] += 0.05
    angles[1000, 2] += 0.5
    angles[::10, 3] = np.nan
    times = stamps(5000)
    times[2000:] += 300_000_000
    angles[2000:, 0] += 0.3
    found = parity_map.white_noise(times, angles)
    np.testing.assert_allclose(np.degrees(found), 0.04, rtol=0.05)


def test_a_motion_within_many_gaps_is_no_noise():
    _, noise = sweep(5000)
    piece = np.arange(5000) // 8
    steps = np.random.default_rng(5).choice((-1.0, 1.0), 625)
    moved = 6.0 * SIGMA[0] * steps.cumsum()
    times = stamps(5000) + 5_000_000 * piece
    found = parity_map.white_noise(times, noise + moved[piece, None])
    np.testing.assert_allclose(np.degrees(found), 0.04, rtol=0.05)


def test_sets_at_irregular_times_with_their_stamps_are_not_noisy():
    """At 0.7 to 1.3 of a period of 10 ms, in a fast motion: equal steps would show 0.1 deg."""
    random = np.random.default_rng(9)
    seconds = 0.01 * (np.arange(5000) + random.uniform(-0.15, 0.15, 5000))
    moved = np.sin(2.0 * np.pi * seconds[:, None] * [0.5, 0.9, 0.7, 0.3])
    angles = moved + SIGMA[0] * random.normal(size=(5000, 4))
    times = np.round(seconds * 1e9).astype(np.int64) + 5_000_000
    found = parity_map.white_noise(times, angles)
    np.testing.assert_allclose(np.degrees(found), 0.04, rtol=0.05)
    regular = parity_map.white_noise(10_000_000 * np.arange(5000), angles)
    assert np.degrees(regular.max()) > 0.1


def test_noise_is_at_least_that_of_the_rounding():
    count = 2.0 * np.pi / 4096
    angles = np.zeros((1000, 4))
    angles[500:] = count
    angles[:, 3] = np.nan
    found = parity_map.white_noise(stamps(1000), angles)
    np.testing.assert_allclose(found[:3], count / np.sqrt(12.0))
    assert np.isnan(found[3])
    assert not parity_map.white_noise(stamps(9), np.zeros((9, 4))).any()
    # Of three samples there is no third difference.
    assert np.isnan(parity_map.white_noise(stamps(3), angles[:3])).all()


@pytest.mark.parametrize('errors', [(0.0, 0.0, 0.0, 0.0), (0.05, -0.04, 0.03, 0.05)])
def test_the_nominal_bias_covers_the_systematic_parity(errors):
    rotations, noise = sweep(8000)
    biased = joints(rotations) + np.radians(errors)
    every = np.ones(8000, bool), np.ones(8000)
    without_noise = parity_map.regions(mapped(biased), *every)
    largest = max(abs(row.mean_deg) for row in without_noise if row.samples >= 200)
    table = parity_map.regions(mapped(biased + noise), *every)
    small = [row for row in table if row.samples < 200]
    assert parity_map.nominal_bias(table) == pytest.approx(largest, abs=0.006)
    assert parity_map.nominal_bias(small) is None
