# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum likelihood where two solutions explain the readings, and the prior that selects."""

import math

from mechanism import (
    angle_between,
    chain,
    reachable_rotation,
    tilted,
    turn,
)
import numpy as np
import pytest
from readings import bound, four_angles, PAPER, SIGMA
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics import (
    estimate,
    estimate_sample,
    forward_theta3a,
    Geometry,
    inverse,
    matrix_from_quaternion,
    measured_angles,
    quaternion_from_matrix,
    UsedSensors,
)
from spm_haptic_master.kinematics.leg_kernels import (
    both_turns,
    linkage,
    turn_equation,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.number_backends import FLOATS


def degenerate_pose(rng, g):
    """Find a pose at which the closed form's determinant vanishes, by bisection along a turn."""
    def determinant(R):
        th1a, th1b, th1c, th3a = measured_angles(
            tuple(R.ravel().tolist()), g, (1, 1, 1), 4)
        _, _, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
        return turn_of_second_joint(leg_b, leg_c)[2]

    while True:
        R, axis = reachable_rotation(rng, g, slack=0.1), 0.1 * rng.normal(size=3)
        try:
            start, end = determinant(R), determinant(turn(axis) @ R)
            if start * end >= 0.0:
                continue
            low, high = 0.0, 1.0
            for _ in range(55):
                middle = 0.5 * (low + high)
                if determinant(turn(middle * axis) @ R) * start > 0.0:
                    low = middle
                else:
                    high = middle
        except UnreachableError:
            continue
        return turn(low * axis) @ R


def test_where_the_closed_form_is_degenerate_a_prior_selects():
    rng = np.random.default_rng(66)
    g = Geometry()
    ambiguous = 0
    for _ in range(30):
        R = degenerate_pose(rng, g)
        angles = four_angles(R, g)
        with pytest.raises(SingularityError):
            forward_theta3a(angles[:3], angles[3], g)
        prior = turn(math.radians(1.0) * rng.normal(size=3)) @ R
        found = estimate(angles[:3], angles[3], SIGMA, g, prior=prior)
        assert angle_between(found.rotation, R) < 1e-7
        np.testing.assert_allclose(
            found.covariance, bound(R, SIGMA, g), rtol=1e-3,
            atol=1e-3 * np.trace(found.covariance))
        try:
            alone = estimate(angles[:3], angles[3], SIGMA, g)
        except SingularityError as error:
            ambiguous += 1
            assert 'prior selects' in str(error)
            rows = estimate(angles[None, :3], angles[None, 3], SIGMA, g)
            assert np.isnan(rows.rotation).all() and not rows.determined[0]
        else:
            assert angle_between(alone.rotation, R) < 1e-7
    assert ambiguous > 0


def rival_of(R):
    """Return readings at a pose, the other root of leg B's turn equation as an orientation."""
    joints = inverse(R)
    readings = four_angles(R)
    th1a, th1b, th1c, th3a = readings.tolist()
    _, _, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, PAPER, FLOATS)
    rival = max(
        both_turns(turn_equation(*leg_b)),
        key=lambda th2a: abs(math.remainder(th2a - joints.theta2a, 2.0 * math.pi)))
    return readings, chain(th1a, rival, th3a, PAPER), turn_of_second_joint(leg_b, leg_c)[2]


@pytest.mark.parametrize(('squared', 'ambiguous', 'selectable'), [
    (8.8, True, True), (9.2, False, True), (99.0, False, True), (101.0, False, False)])
def test_two_solutions_are_ambiguous_up_to_three_sigma(squared, ambiguous, selectable):
    """A prior selects the worse of them up to 10 sigma, as noise and bias may have made it so."""
    rng = np.random.default_rng(72)
    R = turn([1e-3, 2e-3, -1e-3]) @ degenerate_pose(rng, PAPER)
    readings, prior, determinant = rival_of(R)
    # With a large sigma the prior selects the rival. Its parity is inversely proportional to it.
    large = 1.0
    rival = estimate(readings[:3], readings[3], large, prior=prior)
    assert angle_between(rival.rotation, R) > 0.1
    sigma = large * abs(rival.parity) / math.sqrt(squared)
    assert abs(determinant) < 10.0 * sigma
    if ambiguous:
        with pytest.raises(SingularityError, match='prior selects'):
            estimate(readings[:3], readings[3], sigma)
    else:
        found = estimate(readings[:3], readings[3], sigma)
        assert angle_between(found.rotation, R) < 1e-9
    found = estimate(readings[:3], readings[3], sigma, prior=prior)
    assert angle_between(found.rotation, rival.rotation if selectable else R) < 1e-6


def test_a_prior_has_no_weight():
    angles = four_angles(tilted(0.3, 0.1, 0.0)) + SIGMA * np.array([1.0, -1.0, 2.0, 0.5])
    plain = estimate(angles[:3], angles[3], SIGMA)
    other = estimate(angles[:3], angles[3], SIGMA, prior=tilted(0.2, 0.2, 2.0))
    np.testing.assert_array_equal(plain.rotation, other.rotation)
    sample = estimate_sample(
        tuple(angles.tolist()), UsedSensors((SIGMA,) * 4), Geometry(),
        prior=tuple(quaternion_from_matrix(tilted(0.2, 0.2, 2.0)).tolist()))
    np.testing.assert_allclose(
        matrix_from_quaternion(sample.quaternion), plain.rotation, atol=1e-14)
