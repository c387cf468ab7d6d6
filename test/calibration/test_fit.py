# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fit of parameters to a free motion, and what its covariance says."""

from dataclasses import replace

from free_motions import model_of, poses, random_vector, SIGMA
import numpy as np
import pytest
from spm_haptic_master.calibration.motion import fit
from spm_haptic_master.calibration.motion.coverage import inverse
from spm_haptic_master.exceptions import CalibrationError


def readings_of(
    model,
    vector,
    count,
    seed,
    noise=SIGMA,
):
    """Return readings with noise at poses of a motion."""
    exact = model.readings(poses(count, seed), vector)
    exact = exact[np.isfinite(exact).all(axis=1)]
    random = np.random.default_rng(seed)
    return exact + noise * random.normal(size=exact.shape)


@pytest.mark.parametrize('sensors', (4, 6))
def test_readings_without_noise_give_the_parameters_back(sensors):
    """From zeros so far away that four sensors need damped steps."""
    model = model_of(sensors)
    true = random_vector(model, 8)
    start = np.zeros(model.layout.count)
    off = np.array([0.2, 0.2, -0.2, 0.2, 0.2, 0.2])
    start[:sensors] = true[:sensors] + off[:sensors]
    nothing_known = replace(
        model, layout=replace(model.layout, mechanism_tolerance=np.inf, harmonic_tolerance=np.inf)
    )
    found = fit.fit(
        nothing_known,
        readings_of(model, true, 100, 8, noise=0.0),
        start,
        range(model.layout.count),
    )
    assert found.rms < 1e-4
    assert np.abs(found.vector - true).max() < 2e-4


@pytest.mark.slow
def test_one_sample_in_twenty_that_is_wrong_changes_little():
    model = model_of()
    random = np.random.default_rng(9)
    true = random_vector(model, 9)
    turned = readings_of(model, true, 1500, 9)
    wrong = random.uniform(size=len(turned)) < 0.05
    spoilt = turned.copy()
    count = wrong.sum()
    signs = random.choice((-1, 1), count)
    sizes = random.uniform(0.05, 3.0, count)
    spoilt[wrong, random.integers(0, 4, count)] += signs * sizes
    places = range(model.layout.slices['platform axes'].stop)
    start = np.where(np.arange(len(true)) < 4, true, 0.0)
    clean = fit.fit(model, turned, start, places)
    found = fit.fit(model, spoilt, start, places)
    known_before = np.diag(model.layout.deviations[places] ** -2.0)
    covariance = inverse(clean.normal.matrix + known_before)
    deviations = np.sqrt(np.diag(covariance))
    change = np.abs(found.vector - clean.vector)
    assert (change[places] < deviations).all()
    assert not found.normal.kept[wrong].mean() > 0.1


def test_what_is_not_estimated_enters_the_covariance():
    """Against many draws of the linear model itself."""
    random = np.random.default_rng(10)
    rows = random.normal(size=(60, 5))
    deviations = np.array([np.inf, 0.5, 0.3, 0.2, 0.4])
    columns = (0, 1, 3)
    information = rows.T @ rows
    predicted = fit.considered_covariance(information, deviations, columns)
    true = random.normal(size=(20000, 5)) * [0.0, *deviations[1:]]
    read = true @ rows.T + random.normal(size=(20000, 60))
    inside = list(columns)
    errors = -true
    estimated = rows[:, inside]
    known_before = np.diag(deviations[inside] ** -2.0)
    normal = estimated.T @ estimated + known_before
    errors[:, inside] += np.linalg.solve(normal, estimated.T @ read.T).T
    assert np.allclose(np.cov(errors.T), predicted, atol=0.03 * predicted.max())


def test_a_motion_without_an_orientation_is_refused():
    model = model_of()
    vector = np.zeros(model.layout.count)
    turned = np.full((50, 4), np.nan)
    rotation = np.full((50, 3, 3), np.nan)
    with pytest.raises(CalibrationError, match='no sample of the motion has an orientation'):
        fit.fit(
            model,
            turned,
            vector,
            (0, 1),
            rotation,
        )
    assert not fit.normal_equations(
        model,
        turned,
        rotation,
        vector,
        (0,),
    ).kept.any()


def test_a_third_of_the_motion_in_pieces_of_seconds_confirms_the_fit():
    held = fit.held_out_part(np.arange(0.0, 90.0, 0.1))
    assert held.mean() == pytest.approx(1.0 / 3.0, abs=0.03)
    assert 10 < np.abs(np.diff(held.astype(int))).sum() < 90
    with pytest.raises(CalibrationError, match='the motion lasts 1.9 s; expected more than'):
        fit.held_out_part(np.arange(0.0, 2.0, 0.1))
