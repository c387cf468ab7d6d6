# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What bias_deg promises: no sensor is off by more, at any pose of the region of the file."""

from dataclasses import replace
from math import radians

import free_motions
import numpy as np
import pytest
from simulated_hand import readings
from spm_haptic_master.calibration.motion import coverage
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.simulation.rig import random_rig


@pytest.mark.slow
@pytest.mark.parametrize(
    'number, changes',
    [
        (0, {'seconds': 15.0}),
        (0, {'tilt': 5.0, 'seconds': 40.0}),
        pytest.param(1, {'seconds': 40.0}, marks=pytest.mark.evidence),
    ],
)
def test_no_sensor_is_off_by_more_than_its_bias(number, changes):
    """Neither over the workspace, where a motion of small tilts says little, nor where it went."""
    rig = random_rig(number, free_motions.DEVIATIONS)
    stamps, raw, direction, zeros = readings(
        rig,
        replace(free_motions.SHORT, **changes),
        100 * number + 7,
    )
    found = free_motions.calibrated(
        stamps[::5],
        raw[::5],
        direction,
        zeros,
    )
    for each in (found, replace(found, region=coverage.region_of(found.rotation))):
        assert (free_motions.sensor_errors(each, rig, zeros) <= each.bias).all()


def test_the_bound_covers_what_the_covariance_draws_and_the_mechanism_turns():
    """Errors of zeros and harmonics drawn by it: a twentieth are beyond two deviations at most."""
    model = free_motions.model_of()
    vector = free_motions.random_vector(model, 3)
    random = np.random.default_rng(4)
    count = model.layout.count
    half = 1e-3 * random.normal(size=(count, count)) / np.sqrt(count)
    there = coverage.WORKSPACE.poses(model, vector)
    bound = coverage.sensor_bounds(
        model,
        vector,
        half @ half.T,
        there,
        np.zeros(4),
    )
    angles = model.joint_angles(there, model.layout.geometry(vector))
    read = model.readings(there, vector)
    beyond = []
    for _ in range(200):
        off = vector + half @ random.normal(size=len(vector))
        # The mechanism known: its errors are no sensor's.
        off[4:16] = vector[4:16]
        differences = model.corrected(read, off) - angles
        errors = np.angle(np.exp(1j * differences))
        beyond.append((np.abs(errors) > bound).any(axis=0))
    assert np.mean(beyond) < 0.1
    wider = coverage.sensor_bounds(
        model,
        vector,
        half @ half.T,
        there,
        np.array([0.0, 0.01, 0.0, 0.0]),
    )
    assert wider[1] > bound[1] + 0.009
    # Where links alone are unknown, the bounds cover what they do to the orientation.
    deviations = np.zeros(model.layout.count)
    deviations[:4] = radians(0.001)
    few = coverage.sensor_bounds(
        model,
        vector,
        np.diag(deviations**2),
        there,
        np.zeros(4),
    )
    deviations[4:10] = radians(0.2)
    many = coverage.sensor_bounds(
        model,
        vector,
        np.diag(deviations**2),
        there,
        np.zeros(4),
    )
    assert (many > 5.0 * few).all()


def test_what_a_motion_showed_bounds_the_parity_far_below_the_sensors_bounds():
    """Rigs drawn by the covariance of a calibration: their parity over the region of its file."""
    found = free_motions.short_calibration()
    poses = coverage.WORKSPACE.poses(found.model, found.vector)
    unweighted = replace(found.model, sigma=np.ones(4))
    values, vectors = np.linalg.eigh(found.covariance)
    half = vectors * np.sqrt(np.maximum(values, 0.0))
    random = np.random.default_rng(4)
    largest = []
    for _ in range(40):
        rig = found.vector + half @ random.normal(size=len(values))
        read = unweighted.readings(poses, rig)
        turned = read[np.isfinite(read).all(axis=1)]
        there = unweighted.orientations(turned, found.vector)
        linear = unweighted.linearised(turned, there, found.vector)
        largest.append(np.abs(linear.parity).max())
    assert np.mean(np.array(largest) > found.parity_bias) < 0.1
    assert max(largest) < 1.3 * found.parity_bias
    assert found.parity_bias < 0.3 * found.bias.max()


def test_the_region_of_a_motion_is_within_it():
    seconds = np.linspace(0.0, 60.0, 6000)
    rotation = workspace_pose(
        np.radians(12.4) * np.abs(np.sin(seconds)),
        2.3 * seconds,
        np.radians(170.0 + 30.3 * np.sin(0.7 * seconds)),
    )
    rotation[:100] = np.nan
    found = coverage.region_of(rotation)
    assert 11.0 <= found.tilt_deg <= 12.4
    assert 139.7 <= found.from_deg <= 142.0
    assert 198.0 <= found.to_deg <= 200.3
    assert found.is_large
    assert coverage.Region(8.0, 30.0, 50.0).is_large
    assert not coverage.Region(7.9, 0.0, 80.0).is_large
    assert not coverage.Region(16.0, 30.0, 49.0).is_large
