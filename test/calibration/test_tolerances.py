# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How well a rig was built is estimated from the rig, and never beyond the tolerances given."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from spm_haptic_master.calibration.motion.model import Layout
from spm_haptic_master.calibration.motion.tolerances import (
    _tolerance,
    estimated_tolerances,
    HARMONICS,
    MECHANISM,
)

LAYOUT = Layout(4, mechanism_tolerance=radians(0.5), harmonic_tolerance=radians(0.3))


def estimates(
    mechanism_deg,
    harmonic_deg,
    columns=range(32),
    error_deg=0.02,
):
    """Return the mean tolerances, deg, of 40 rigs whose parameters are known to `error_deg`."""
    true = replace(
        LAYOUT,
        mechanism_tolerance=radians(mechanism_deg),
        harmonic_tolerance=radians(harmonic_deg),
    )
    deviations = np.where(np.isinf(true.deviations), 1.0, true.deviations)
    random = np.random.default_rng(5)
    columns = tuple(columns)
    information = np.eye(len(columns)) * radians(error_deg) ** -2.0
    weights = LAYOUT.deviations[list(columns)] ** -2.0
    found = []
    for _ in range(40):
        vector = deviations * random.normal(size=LAYOUT.count)
        errors = radians(error_deg) * random.normal(size=len(columns))
        read = vector[list(columns)] + errors
        matrix = information + np.diag(weights)
        vector[list(columns)] = np.linalg.solve(matrix, information @ read)
        layout = estimated_tolerances(LAYOUT, vector, columns, information)
        found.append((layout.mechanism_tolerance, layout.harmonic_tolerance))
    return np.degrees(np.mean(found, axis=0))


@pytest.mark.parametrize('error_deg', [0.02, 0.15])
def test_parameters_show_the_tolerance_that_they_come_from(error_deg):
    """The one given counts as one parameter more: the estimate lies a little towards it."""
    mechanism, harmonic = estimates(0.2, 0.15, error_deg=error_deg)
    assert 0.19 < mechanism < 0.26
    assert 0.14 < harmonic < 0.22


def test_a_tolerance_is_never_larger_than_the_one_given():
    assert estimates(2.0, 1.0) == pytest.approx([0.5, 0.3])


def test_what_was_left_as_drawn_shows_nothing():
    without_harmonics = range(16)
    mechanism, harmonic = estimates(0.2, 0.05, columns=without_harmonics)
    assert mechanism < 0.26
    assert harmonic == pytest.approx(0.3)


def squares_of(**sizes):
    """Return squares of all parameters, by the group."""
    squares = np.zeros(LAYOUT.count)
    for group, size in sizes.items():
        squares[LAYOUT.slices[group.replace('_', ' ')]] = size**2
    return squares


def test_a_tolerance_is_the_root_of_the_mean_square_with_that_given_as_one_more():
    """Of 12 numbers of the mechanism, and of 16 harmonics, the second ones tenfold."""
    squares = squares_of(
        links=0.1,
        base_axes=0.2,
        platform_axes=0.3,
        first_harmonics=0.05,
        second_harmonics=0.03,
    )
    every = range(LAYOUT.count)
    mechanism = np.sqrt((1.0 + 6 * 0.01 + 3 * 0.04 + 3 * 0.09) / 13.0)
    assert _tolerance(
        LAYOUT,
        MECHANISM,
        1.0,
        squares,
        every,
    ) == pytest.approx(mechanism)
    harmonic = np.sqrt((1.0 + 8 * 0.0025 + 8 * 0.09) / 17.0)
    assert _tolerance(
        LAYOUT,
        HARMONICS,
        1.0,
        squares,
        every,
    ) == pytest.approx(harmonic)
    # A group of which a parameter was left as drawn does not count; one alone does.
    without = [column for column in every if column != LAYOUT.columns('base axes')[1]]
    mechanism = np.sqrt((1.0 + 6 * 0.01 + 3 * 0.09) / 10.0)
    assert _tolerance(
        LAYOUT,
        MECHANISM,
        1.0,
        squares,
        without,
    ) == pytest.approx(mechanism)
    alone = list(LAYOUT.columns('links'))
    mechanism = np.sqrt((1.0 + 6 * 0.01) / 7.0)
    assert _tolerance(
        LAYOUT,
        MECHANISM,
        1.0,
        squares,
        alone,
    ) == pytest.approx(mechanism)


@pytest.mark.parametrize('error_deg', [0.02, 0.1])
def test_estimated_tolerances_are_those_of_the_parameters_fitted_with_them(error_deg):
    """Their squares, and the variances that the fit leaves, have the tolerance as their mean."""
    true = replace(
        LAYOUT,
        mechanism_tolerance=radians(0.2),
        harmonic_tolerance=radians(0.1),
    )
    random = np.random.default_rng(7)
    deviations = np.where(np.isinf(true.deviations), 1.0, true.deviations)
    read = deviations * random.normal(size=LAYOUT.count)
    information = np.eye(LAYOUT.count) * radians(error_deg) ** -2.0
    vector = np.linalg.solve(information + np.diag(LAYOUT.deviations**-2.0), information @ read)
    found = estimated_tolerances(
        LAYOUT,
        vector,
        range(LAYOUT.count),
        information,
    )
    covariance = np.linalg.inv(information + np.diag(found.deviations**-2.0))
    squares = (covariance @ information @ read) ** 2 + np.diag(covariance)
    total = LAYOUT.mechanism_tolerance**2 + squares[4:16].sum()
    assert found.mechanism_tolerance == pytest.approx(np.sqrt(total / 13.0), rel=2e-3)
    total = LAYOUT.harmonic_tolerance**2 + squares[16:24].sum() + 100.0 * squares[24:].sum()
    assert found.harmonic_tolerance == pytest.approx(np.sqrt(total / 17.0), rel=2e-3)
