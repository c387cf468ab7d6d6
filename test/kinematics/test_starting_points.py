# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum likelihood where two solutions explain the readings, and the prior that selects."""

import math

from mechanism import angle_between, chain, reachable_rotation, tilted, turn
import numpy as np
import pytest
from readings import all_angles, bound, case_2_determinant, estimated, four_angles, PAPER, SIGMA
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics import forward_theta3a, inverse, workspace_pose
from spm_haptic_master.kinematics.leg_kernels import both_turns, linkage, turn_equation
from spm_haptic_master.kinematics.number_backends import FLOATS


def degenerate_pose(rng, g=PAPER):
    """Find a pose at which the closed form's determinant vanishes, by bisection along a turn."""
    while True:
        R, axis = reachable_rotation(rng, g, slack=0.1), 0.1 * rng.normal(size=3)
        try:
            start, end = (case_2_determinant(four_angles(each, g)) for each in (R, turn(axis) @ R))
            if start * end >= 0.0:
                continue
            low, high = 0.0, 1.0
            for _ in range(55):
                middle = 0.5 * (low + high)
                if case_2_determinant(four_angles(turn(middle * axis) @ R, g)) * start > 0.0:
                    low = middle
                else:
                    high = middle
        except UnreachableError:
            continue
        return turn(low * axis) @ R


def test_where_the_closed_form_is_degenerate_a_prior_or_a_further_sensor_selects():
    rng = np.random.default_rng(66)
    ambiguous = 0
    for _ in range(30):
        R = degenerate_pose(rng)
        readings = all_angles(R)
        angles = readings[:4]
        with pytest.raises(SingularityError):
            forward_theta3a(angles[:3], angles[3])
        prior = turn(math.radians(1.0) * rng.normal(size=3)) @ R
        found = estimated(angles, prior=prior)
        assert angle_between(found.rotation, R) < 1e-7
        np.testing.assert_allclose(
            found.covariance, bound(R, SIGMA), rtol=1e-3, atol=1e-3 * np.trace(found.covariance))
        for sensors in (5, 6):
            assert angle_between(estimated(readings[:sensors]).rotation, R) < 1e-7
        try:
            alone = estimated(angles)
        except SingularityError as error:
            ambiguous += 1
            assert 'prior selects' in str(error)
            rows = estimated(angles[None])
            assert np.isnan(rows.rotation).all() and not rows.determined[0]
        else:
            assert angle_between(alone.rotation, R) < 1e-7
    assert ambiguous > 0


def rival_of(R):
    """Return the other root of leg B's turn equation at a pose, as an orientation."""
    th1a, th1b, th1c, th3a = four_angles(R).tolist()
    _, _, leg_b, _ = linkage(th1a, th1b, th1c, th3a, PAPER, FLOATS)
    th2a = max(both_turns(turn_equation(*leg_b)), key=lambda th2a: abs(
        math.remainder(th2a - inverse(R).theta2a, 2.0 * math.pi)))
    return chain(th1a, th2a, th3a, PAPER)


@pytest.mark.parametrize(('squared', 'ambiguous', 'selectable'), [
    (8.8, True, True), (9.2, False, True), (99.0, False, True), (101.0, False, False)])
def test_two_solutions_are_ambiguous_up_to_three_sigma(squared, ambiguous, selectable):
    """A prior selects the worse of them up to 10 sigma, as noise and bias may have made it so."""
    R = turn([1e-3, 2e-3, -1e-3]) @ degenerate_pose(np.random.default_rng(72))
    readings, prior = four_angles(R), rival_of(R)
    # With a large sigma the prior selects the rival. Its parity is inversely proportional to it.
    rival = estimated(readings, 1.0, prior=prior)
    assert angle_between(rival.rotation, R) > 0.1
    sigma = abs(rival.parity) / math.sqrt(squared)
    assert abs(case_2_determinant(readings)) < 10.0 * sigma
    if ambiguous:
        with pytest.raises(SingularityError, match='prior selects'):
            estimated(readings, sigma)
    else:
        assert angle_between(estimated(readings, sigma).rotation, R) < 1e-9
    found = estimated(readings, sigma, prior=prior)
    assert angle_between(found.rotation, rival.rotation if selectable else R) < 1e-6


def test_a_prior_has_no_weight():
    angles = four_angles(tilted(0.3, 0.1, 0.0)) + SIGMA * np.array([1.0, -1.0, 2.0, 0.5])
    np.testing.assert_array_equal(
        estimated(angles).rotation, estimated(angles, prior=tilted(0.2, 0.2, 2.0)).rotation)


def test_where_no_leg_gives_a_start_the_solutions_of_all_legs_are_tried():
    R = workspace_pose(0.1, 1.0, 0.4)
    for prior in (None, turn([0.02, 0.0, 0.0]) @ R):
        assert angle_between(estimated(all_angles(R), 0.3, prior=prior).rotation, R) < 1e-9
