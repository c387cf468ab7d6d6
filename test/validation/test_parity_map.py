# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a recording says about its sensors, on simulated ones with known errors."""

import csv
from math import radians

import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import Geometry, inverse, jacobian, workspace_pose
from spm_haptic_master.validation.parity_map import (
    nominal_bias,
    parity_map,
    regions,
    white_noise,
    write_regions,
)

SIGMA = (radians(0.04),) * 4
MODE = (1, 1, 1)


def joints(rotations):
    found = inverse(rotations)
    return np.column_stack([found.theta1, found.theta3a])


def sweep(n, seed=3):
    """Return a motion over the workspace, sampled at 1 kHz, and noise of 0.04 deg."""
    t = np.arange(n) * 1e-3
    rotations = workspace_pose(np.radians(9.0 * (1.0 - np.cos(0.8 * t))), 1.3 * t,
                               np.radians(25.0 + 25.0 * np.sin(0.4 * t)))
    noise = np.random.default_rng(seed).normal(size=(n, 4)) * SIGMA
    return rotations, noise


def stamps(n):
    return 1_700_000_000_000_000_000 + 1_000_000 * np.arange(n)


def test_the_parity_is_the_null_vector_times_the_errors():
    rotations, _ = sweep(50)
    errors = np.radians([0.03, -0.05, 0.02, 0.08])
    found = parity_map(joints(rotations) + errors, SIGMA, Geometry(), MODE)
    normal = np.linalg.svd(jacobian(rotations, sensors=4))[0][:, :, 3]
    np.testing.assert_allclose(np.abs(found.parity_deg), np.abs(np.degrees(normal @ errors)),
                               atol=1e-3)


def test_with_unequal_sensors_the_parity_stays_in_deg():
    rotations, _ = sweep(50)
    errors = np.radians([0.03, -0.05, 0.02, 0.08])
    sigma = tuple(np.radians([0.02, 0.04, 0.08, 0.05]))
    found = parity_map(joints(rotations) + errors, sigma, Geometry(), MODE)
    normal = np.linalg.svd(jacobian(rotations, sensors=4))[0][:, :, 3]
    np.testing.assert_allclose(np.abs(found.parity_deg), np.abs(np.degrees(normal @ errors)),
                               atol=1e-3)


def test_the_place_is_tilt_and_self_rotation():
    rotation = workspace_pose(np.radians([0.0, 12.0, 20.0]), 2.0, np.radians([10.0, 30.0, -20.0]))
    found = parity_map(joints(rotation), SIGMA, Geometry(), MODE)
    np.testing.assert_allclose(found.tilt_deg, [0.0, 12.0, 20.0], atol=1e-4)
    np.testing.assert_allclose(found.phi_deg, [10.0, 30.0, -20.0], atol=1e-4)


def test_angles_without_an_orientation_have_no_parity():
    rotations, _ = sweep(20)
    angles = joints(rotations)
    angles[3, 1] = np.nan
    angles[7] = [1.5, -1.5, 1.5, 1.0]
    found = parity_map(angles, SIGMA, Geometry(), MODE)
    assert np.flatnonzero(np.isnan(found.parity_deg)).tolist() == [3, 7]
    assert sum(row.samples for row in regions(found, np.ones(20, bool), np.ones(20))) == 18


def test_regions_are_of_all_samples_and_of_theirs():
    rotations, noise = sweep(4000)
    found = parity_map(joints(rotations) + noise, SIGMA, Geometry(), MODE)
    published = np.arange(4000) % 4 > 0
    table = regions(found, published, np.full(4000, 0.7))
    assert sum(row.samples for row in table) == 4000
    for row in table:
        inside = (found.tilt_deg >= row.tilt_from_deg) & (found.tilt_deg < row.tilt_to_deg) \
            & (found.phi_deg >= row.phi_from_deg) & (found.phi_deg < row.phi_to_deg)
        parity = found.parity_deg[inside]
        assert row.samples == inside.sum()
        assert row.mean_deg == pytest.approx(parity.mean())
        assert row.rms_deg == pytest.approx(np.sqrt(np.mean(parity ** 2)))
        assert row.published == pytest.approx(published[inside].mean())
        assert row.level_deg == pytest.approx(0.7)


@pytest.mark.parametrize('sensor', range(4))
def test_noise_is_that_of_each_sensor_in_motion_and_at_rest(sensor):
    rotations, noise = sweep(20_000)
    noise[:, sensor] *= 2.0
    for angles in (joints(rotations) + noise, noise):
        found = np.degrees(white_noise(stamps(20_000), angles))
        expected = [0.08 if each == sensor else 0.04 for each in range(4)]
        np.testing.assert_allclose(found, expected, rtol=0.03)


def test_noise_ignores_steps_and_gaps():
    rotations, noise = sweep(5000)
    angles = joints(rotations) + noise
    angles[3000:, 1] += 0.05
    angles[1000, 2] += 0.5
    times = stamps(5000)
    times[2000:] += 300_000_000
    angles[2000:, 0] += 0.3
    np.testing.assert_allclose(np.degrees(white_noise(times, angles)), 0.04, rtol=0.05)


def test_noise_is_at_least_that_of_the_rounding():
    count = 2.0 * np.pi / 4096
    angles = np.zeros((1000, 4))
    angles[500:] = count
    np.testing.assert_allclose(white_noise(stamps(1000), angles), count / np.sqrt(12.0))
    assert np.isnan(white_noise(stamps(3), angles[:3])).all()


@pytest.mark.parametrize('errors', [(0.0, 0.0, 0.0, 0.0), (0.05, -0.04, 0.03, 0.05)])
def test_the_nominal_bias_covers_the_systematic_parity(errors):
    rotations, noise = sweep(8000)
    found = parity_map(joints(rotations) + noise + np.radians(errors), SIGMA, Geometry(), MODE)
    table = regions(found, np.ones(8000, bool), np.ones(8000))
    systematic = parity_map(joints(rotations) + np.radians(errors), SIGMA, Geometry(), MODE)
    largest = max(abs(row.mean_deg) for row in regions(
        systematic, np.ones(8000, bool), np.ones(8000)) if row.samples >= 200)
    assert nominal_bias(table) == pytest.approx(largest, abs=0.006)


def test_without_enough_samples_there_is_no_bias():
    rotations, _ = sweep(100)
    found = parity_map(joints(rotations), SIGMA, Geometry(), MODE)
    assert nominal_bias(regions(found, np.ones(100, bool), np.ones(100))) is None


def test_regions_are_written_as_csv(tmp_path):
    rotations, _ = sweep(300)
    found = parity_map(joints(rotations), SIGMA, Geometry(), MODE)
    table = regions(found, np.ones(300, bool), np.ones(300))
    write_regions(tmp_path / 'regions.csv', table)
    with open(tmp_path / 'regions.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert [int(row['samples']) for row in rows] == [row.samples for row in table]
    with pytest.raises(InputError, match='cannot be written'):
        write_regions(tmp_path / 'none' / 'regions.csv', table)
