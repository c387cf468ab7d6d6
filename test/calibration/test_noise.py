# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Noise is what the parity allows: sets at irregular times are not noisy."""

from dataclasses import replace

import free_motions
from linear_model import layout_of, LinearModel, no_rotation, samples_of
import numpy as np
import pytest
from simulated_hand import readings
from spm_haptic_master.calibration.motion.fit import Normal, normal_equations
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


def allowed_by(
    measured_over_predicted,
    count=500,
    kept=None,
):
    """Return noise by differences, and what a parity allows of it that is so large, squared."""
    random = np.random.default_rng(2)
    gains = random.normal(size=(count, 2, 4)) / UNEQUAL
    # Of many samples every second one is taken: those in between have no gain.
    if count > 3000:
        gains[1::2] = 0.0
    samples = samples_of(np.zeros((count, 2)), gains)
    model = LinearModel(layout_of([np.inf] * 4), 2)
    model.sigma = UNEQUAL
    chosen = gains[:: 2 if count > 3000 else 1]
    squares = np.mean((chosen**2).sum(axis=1), axis=0)
    measured = measured_over_predicted * squares @ UNEQUAL**2
    parity = np.where(np.arange(2 * count) % 2, 1.0, -1.0).reshape(count, 2) * np.sqrt(
        measured / 2
    )
    normal = Normal(
        cost=0.0,
        matrix=np.zeros((0, 0)),
        right=np.zeros(0),
        parity=parity,
        kept=np.ones(count, dtype=bool),
        rotation=no_rotation(samples),
        limit=6.0,
    )
    return (
        allowed_noise(
            model,
            samples,
            np.zeros(4),
            normal,
        ),
        squares,
        measured,
    )


@pytest.mark.parametrize('count', [500, 6000])
def test_noise_is_cut_where_it_predicts_more_parity_than_there_is(count):
    """By more than a twentieth: to a common noise with which it predicts just that."""
    noise, _, _ = allowed_by(1.0 / 1.04, count)
    np.testing.assert_array_equal(noise, UNEQUAL)
    noise, _, _ = allowed_by(3.0, count)
    np.testing.assert_array_equal(noise, UNEQUAL)
    for part in (1.0 / 1.06, 0.5, 0.01):
        noise, squares, measured = allowed_by(part, count)
        assert squares @ noise**2 == pytest.approx(measured, rel=1e-4)
        cut = noise < UNEQUAL
        assert cut[3]
        np.testing.assert_allclose(noise[cut], noise.max())
        np.testing.assert_array_equal(noise[~cut], UNEQUAL[~cut])
