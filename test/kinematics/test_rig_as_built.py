# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording of a rig with ordinary tolerances, from its CAN frames to orientations."""

import csv
from functools import cache
import gzip
import json
import math

import can
from encoder_frames import decoder
from harness import DATA
import numpy as np
import pytest
from spm_haptic_master.kinematics import estimate, Geometry, matrix_from_quaternion

pytestmark = pytest.mark.slow

RIG = DATA / 'rig'
SIGMA = math.radians(0.04)


@cache
def recording():
    """Return the rig, the SYNC times in us and the angles of its joints, rad, (20000, 4)."""
    rig = json.loads((RIG / 'rig.json').read_text())
    taker = decoder(encoders__zero_count=tuple(rig['zero']),
                    encoders__direction=tuple(rig['direction']))
    with can.LogReader(RIG / 'dev_check.log.gz') as log:
        samples = [sample for sample in map(taker.feed, log) if sample is not None]
    stamps = np.array([round(sample.stamp / 1e3) for sample in samples])
    measured = np.array([sample.angles for sample in samples])
    # The encoders' first harmonic, removed by inversion; the second is known to no model.
    cosine, sine = np.radians(rig['eccentricity_deg_cos_sin']).T
    angles = measured
    for _ in range(10):
        angles = measured - cosine * np.cos(angles) - sine * np.sin(angles)
    return rig, stamps, angles


def errors_deg(geometry):
    """Return the orientation errors, deg, at the true orientations, and the estimate of all."""
    _, stamps, angles = recording()
    found = estimate(angles[:, :3], angles[:, 3], SIGMA, geometry)
    with gzip.open(RIG / 'dev_check_truth.csv.gz', 'rt') as file:
        rows = list(csv.reader(file))[1:]
    times = np.array([round(float(row[0]) * 1e6) for row in rows])
    truth = matrix_from_quaternion(np.array([row[1:] for row in rows], dtype=float))
    index = np.searchsorted(stamps, times - 100)
    assert np.abs(stamps[index] - times).max() < 100
    turned, base, platform = found.rotation[index], np.eye(3), np.eye(3)
    # One constant rotation on each side, in turns, by the nearest rotation to the mean.
    for _ in range(20):
        platform = nearest(np.swapaxes(base @ turned, 1, 2) @ truth)
        base = nearest(truth @ np.swapaxes(turned @ platform, 1, 2))
    difference = base @ turned @ platform - truth
    half = np.linalg.norm(difference, axis=(1, 2)) / math.sqrt(8.0)
    return np.degrees(2.0 * np.arcsin(half)), found


def nearest(matrices):
    """Return the rotation nearest to the mean of some."""
    u, _, v = np.linalg.svd(matrices.mean(0))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def test_the_mechanism_as_built_explains_the_recording():
    rig, stamps, _ = recording()
    assert len(stamps) == 20000
    errors, found = errors_deg(Geometry.from_axes(
        rig['base_axes'], rig['platform_axes'], np.radians(rig['alpha_deg']),
        np.radians(rig['beta_deg'])))
    rms = math.sqrt((errors**2).mean())
    print(f'rms {rms:.4f} deg, largest {errors.max():.3f} deg, parity {found.parity.std():.3f}')
    assert len(errors) == 2000
    assert rms <= 0.055 and errors.max() <= 0.3
    assert found.consistent.mean() >= 0.999
    # What is left beside the noise are the second harmonics.
    assert found.parity.std() < 1.2


def test_the_nominal_mechanism_does_not():
    errors, found = errors_deg(Geometry())
    assert math.sqrt((errors**2).mean()) > 3.0 * 0.0433
    assert found.parity.std() > 3.0
