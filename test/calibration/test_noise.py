# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Noise is what the parity allows: sets at irregular times are not noisy."""

from dataclasses import replace

import free_motions
import numpy as np
import pytest
from simulated_hand import readings
from spm_haptic_master.calibration.motion.fit import normal_equations
from spm_haptic_master.calibration.motion.noise import allowed_noise

EQUAL = np.full(4, 7e-4)
UNEQUAL = np.array([5e-4, 7e-4, 5e-4, 9e-4])


@pytest.mark.parametrize(
    ('true', 'factors', 'allowed'),
    [
        (UNEQUAL, 1.0, UNEQUAL),
        # Motion between a reading and its stamp makes the fast joints look noisy.
        (EQUAL, np.array([1.6, 1.0, 1.9, 1.0]), EQUAL),
        (EQUAL, 0.8, 0.8 * EQUAL),
    ],
)
def test_the_parity_bounds_the_noise(
    true,
    factors,
    allowed,
):
    model = replace(free_motions.model_of(), sigma=true * factors)
    vector = free_motions.random_vector(model, 8)
    read = model.readings(free_motions.poses(4000), vector)
    read = read[np.isfinite(read).all(axis=1)]
    turned = read + true * np.random.default_rng(3).normal(size=read.shape)
    normal = normal_equations(
        model,
        turned,
        model.orientations(turned, vector),
        vector,
        (),
    )
    np.testing.assert_allclose(allowed_noise(model, turned, vector, normal), allowed, rtol=0.04)


def test_sets_at_irregular_times_are_reported_and_are_no_noise():
    """Each set is 0.7 ms early or late, and its stamp does not show it."""
    fast = replace(free_motions.SHORT, pace=2.0, noise=0.0)
    stamps, raw, direction, zeros = readings(free_motions.RIG, fast, free_motions.SEED)
    random = np.random.default_rng(6)
    rows = 10 * np.arange(2400) + random.integers(0, 2, 2400) * 3
    noise = np.radians(0.04) * random.normal(size=(2400, 4))
    noisy = raw[rows] + noise
    found = free_motions.calibrated(
        np.arange(2400) * 10_000_000,
        noisy,
        direction,
        zeros,
    )
    assert np.degrees(found.readings.noise.max()) > 0.06
    np.testing.assert_allclose(np.degrees(found.noise), 0.04, rtol=0.1)
    (caution,) = (each for each in found.cautions if 'irregular' in each)
    assert 'the sets come at irregular times: differences of the readings of joint_' in caution
