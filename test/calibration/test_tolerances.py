# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How well a rig was built is estimated from the rig, and never beyond the tolerances given."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from spm_haptic_master.calibration.motion.model import Layout
from spm_haptic_master.calibration.motion.tolerances import estimated_tolerances

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
