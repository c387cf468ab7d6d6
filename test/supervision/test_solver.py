# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The forward model of the supervision, and solutions in other working modes."""

from math import radians

from device import joint_angles
import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.parameters.fkm import SUPERVISION_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.solver import Solver
from spm_haptic_master.supervision.supervisor import make_supervisor

SIGMA = (radians(0.04),) * 4
FOUR = kinematics.UsedSensors(SIGMA)
# The same pose in the working modes (+, +, +) and (-, -, -), joints in deg.
MIRRORED = tuple(np.radians([166.55321231] * 3 + [125.15989244]).tolist())


def solver(working_mode):
    """Return the solver of the paper's mechanism with encoders without bias."""
    return Solver(kinematics.Geometry(), SIGMA, working_mode, (0.0,) * 4)


def solved(angles, prior=None):
    """Return the solution of all four sensors."""
    return solver((1, 1, 1)).solve(tuple(angles), FOUR, prior)


def pose(phi, tilt=0.0, azimuth=0.0):
    """Return the quaternion and the four angles of a pose, given in deg."""
    rotation = kinematics.workspace_pose(*np.radians((tilt, azimuth, phi)))
    return (
        tuple(kinematics.quaternion_from_matrix(rotation).tolist()),
        tuple(joint_angles(rotation[None])[0].tolist()),
    )


@pytest.mark.parametrize('phi', [20.0, 70.0])
def test_it_finds_the_pose(phi):
    truth, angles = pose(phi)
    for prior in (None, pose(phi + 1.0)[0]):
        estimate = solved(angles, prior)
        assert rotation_distance(estimate.quaternion, truth) < 1e-6
        assert abs(estimate.parity) < 1e-3
        assert estimate.determined
        assert 0.0 < estimate.total_deviation < radians(0.2)


def test_what_the_last_step_leaves_is_a_small_part_of_the_deviation():
    """The solver stops early; beside the converged estimate, all over the workspace."""
    rng = np.random.default_rng(31)
    smallest = (-1.05, 0.0, 0.0)
    largest = (1.75, 0.52, 6.28)
    left = []
    while len(left) < 150:
        truth, exact = pose(*np.degrees(rng.uniform(smallest, largest)))
        noise = SIGMA[0] * rng.normal(size=4)
        angles = tuple((exact + noise).tolist())
        try:
            converged = kinematics.estimate_sample(
                angles,
                FOUR,
                kinematics.Geometry(),
                truth,
                working_mode=(1, 1, 1),
            )
            found = solved(angles, truth)
        except (UnreachableError, SingularityError):
            continue
        deviation = converged.total_deviation
        distance = rotation_distance(found.quaternion, converged.quaternion)
        left.append(distance / deviation)
        assert found.total_deviation == pytest.approx(deviation, rel=0.03)
        assert found.parity == pytest.approx(converged.parity, abs=0.03)
    assert max(left) < 0.03
    assert np.sqrt(np.mean(np.square(left))) < 0.003


def test_angles_of_another_working_mode_are_no_orientation():
    with pytest.raises(SingularityError, match='another working mode'):
        solved(MIRRORED)
    mirrored = solver((-1, -1, -1))
    assert mirrored.solve(MIRRORED, FOUR, None).determined


@pytest.mark.parametrize(
    ('settings', 'expected'),
    [
        ({}, 0),
        ({'working_mode': (-1, -1, -1)}, 16),
    ],
)
def test_angles_of_another_working_mode_than_the_supervisors_are_withheld(settings, expected):
    supervisor = make_supervisor(complete(SUPERVISION_SETTINGS, settings))
    published = 0
    for index in range(20):
        verdict = supervisor.take(1 + index * 1_000_000, MIRRORED)
        published += verdict.estimate is not None
    assert published == expected
