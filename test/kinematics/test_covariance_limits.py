# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Where the first-order covariance of the estimate describes its errors, and where it does not.

The rows that docs/evidence.md states. `pytest -s` prints them.
"""

from contextlib import suppress
import math

from mechanism import CENTRE, SINGULAR_PHI, small_vector, tilted, zxz
import numpy as np
import pytest
from readings import estimated, four_angles, near_boundary, PAPER, SIGMA
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SpmError

# Samples of a row: rms to 0.5 %, a share of 1 in 1000 to a fifth.
COUNT = 20000
# Square of a rotation error over its covariance that one Gaussian sample in a thousand exceeds.
ONE_IN_A_THOUSAND = 16.266


def noisy(R, sigma=SIGMA):
    """Return readings of the four sensors with noise."""
    return four_angles(R) + sigma * np.random.default_rng(170).normal(size=(COUNT, 4))


def measure(R, rotation, covariance):
    """Return rms over stated rms, mean chi^2 / 3, share beyond 1 in 1000, share answered."""
    answered = np.isfinite(rotation[:, 0, 0])
    covariance = covariance[answered]
    error = small_vector(rotation[answered] @ R.T)
    squares = np.einsum('ni,nij,nj->n', error, np.linalg.inv(covariance), error)
    stated = np.median(np.trace(covariance, axis1=1, axis2=2))
    row = (
        math.sqrt((error**2).sum(-1).mean() / stated),
        squares.mean() / 3.0,
        (squares > ONE_IN_A_THOUSAND).mean(),
        answered.mean(),
    )
    print(
        'rms / stated {:.3f}, chi^2 / 3 {:.3f}, beyond 1 in 1000 {:.4f}, answered {:.4f}'.format(
            *row
        )
    )
    return row


def measure_four(R, sigma=SIGMA):
    found = estimated(noisy(R, sigma), sigma, prior=R)
    return measure(R, found.rotation, found.covariance)


# Poses, noise and largest share beyond 1 in 1000: over the workspace, the parallel singularity
# among them; with noise up to a degree; to ten sigma from the boundary of a working mode.
RIGHT = [
    *(
        pytest.param(
            tilted(math.radians(phi), math.radians(tilt), 1.0),
            SIGMA,
            2e-3,
            marks=[pytest.mark.slow] * (tilt < 20.0),
        )
        for phi in (0.0, 30.0, math.degrees(SINGULAR_PHI), 70.0)
        for tilt in (0.0, 13.0, 20.0)
    ),
    *(
        pytest.param(R, math.radians(sigma), 4e-3, marks=marks)
        for sigma, marks in ((0.004, pytest.mark.slow), (0.4, ()), (1.0, pytest.mark.evidence))
        for R in (tilted(SINGULAR_PHI, 0.0, 0.0), tilted(0.0, math.radians(26.0), 0.0))
    ),
    *(
        pytest.param(
            near_boundary(leg, distance * SIGMA),
            SIGMA,
            3e-3,
            marks=[pytest.mark.slow] * (distance > 10.0),
        )
        for leg in range(3)
        for distance in (100.0, 30.0, 10.0)
    ),
]


@pytest.mark.parametrize('R, sigma, most_beyond', RIGHT)
def test_the_covariance_of_four_sensors_describes_the_errors(R, sigma, most_beyond):
    rms, squares, beyond, answered = measure_four(R, sigma)
    assert rms == pytest.approx(1.0, abs=0.02)
    assert squares == pytest.approx(1.0, abs=0.03)
    assert beyond < most_beyond
    assert answered == 1.0


@pytest.mark.parametrize('leg', [0, 1, 2])
def test_tails_at_three_sigma_from_the_boundary_of_a_working_mode(leg):
    rms, squares, beyond, answered = measure_four(near_boundary(leg, 3.0 * SIGMA))
    assert rms == pytest.approx(1.0, abs=0.02)
    assert squares > 1.03
    assert 5e-3 < beyond < 2e-2
    assert answered > 0.99


@pytest.mark.slow
@pytest.mark.parametrize(
    'away_deg, rms, answered',
    [
        (8.0, 1.01, 1.0),
        pytest.param(4.0, 1.04, 1.0, marks=pytest.mark.evidence),
        pytest.param(2.0, 0.85, 0.86, marks=pytest.mark.evidence),
        (1.0, 0.91, 0.60),
        pytest.param(0.3, 1.27, 0.51, marks=pytest.mark.evidence),
    ],
)
def test_three_sensors_near_the_parallel_singularity(away_deg, rms, answered):
    """Without th3A half of the samples close no mechanism there, and the others are biased."""
    R = zxz(*CENTRE, SINGULAR_PHI + math.radians(away_deg))
    sensors = kinematics.UsedSensors((SIGMA,) * 4, (3,))
    prior = tuple(kinematics.quaternion_from_matrix(R).tolist())
    rotation, covariance = np.full((2, COUNT, 3, 3), np.nan)
    for index, readings in enumerate(noisy(R).tolist()):
        with suppress(SpmError):
            sample = kinematics.estimate_sample(tuple(readings), sensors, PAPER, prior)
            rotation[index] = kinematics.matrix_from_quaternion(sample.quaternion)
            covariance[index] = np.reshape(sample.covariance, (3, 3))
    row = measure(R, rotation, covariance)
    assert row[0] == pytest.approx(rms, abs=0.03)
    assert row[3] == pytest.approx(answered, abs=0.02)
    if away_deg < 2.0:
        assert row[1] > 1.2
        assert row[2] > 8e-3
