# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The forward models to choose from, where they disagree, and solutions in other working modes."""

from math import radians

from device import joint_angles
import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.parameters.fkm import METHODS, SUPERVISION_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.sensor_set import Solver, total_deviation
from spm_haptic_master.supervision.supervisor import make_supervisor

SIGMA = (radians(0.04),) * 4
FOUR = kinematics.UsedSensors(SIGMA)
# The same pose in the working modes (+, +, +) and (-, -, -), joints in deg.
MIRRORED = tuple(np.radians([166.55321231] * 3 + [125.15989244]).tolist())


def solved(angles, prior=None, method='estimate'):
    """Return the solution of all four sensors."""
    return Solver(kinematics.Geometry(), SIGMA, method).solve(tuple(angles), FOUR, prior)


def pose(phi, tilt=0.0, azimuth=0.0):
    """Return the quaternion and the four angles of a pose, given in deg."""
    rotation = kinematics.workspace_pose(*np.radians((tilt, azimuth, phi)))
    return (
        tuple(kinematics.quaternion_from_matrix(rotation).tolist()),
        tuple(joint_angles(rotation[None])[0].tolist()),
    )


def moved(angles, sensor, degrees):
    changed = list(angles)
    changed[sensor] += radians(degrees)
    return tuple(changed)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('phi', [20.0, 70.0])
def test_every_method_finds_the_pose(method, phi):
    truth, angles = pose(phi)
    for prior in (None, pose(phi + 1.0)[0]):
        estimate = solved(angles, prior, method)[0]
        assert rotation_distance(estimate.quaternion, truth) < 1e-6
        assert abs(estimate.parity) < 1e-3
        assert estimate.determined
        assert 0.0 < total_deviation(estimate) < radians(0.2)


@pytest.mark.parametrize('place', [(30.0, 10.0, 30.0), (0.0, 25.0, 115.0)])
def test_theta3a_has_the_covariance_of_the_closed_form(place):
    """Up to five times that of the estimate at the workspace's edge."""
    truth, angles = pose(*place)
    claimed = total_deviation(solved(angles, None, 'theta3a')[0])
    readings = np.array(angles) + SIGMA[0] * np.random.default_rng(3).normal(size=(20_000, 4))
    # Its parity is that of all four.
    found, apart = solved(readings[0], None, 'theta3a')
    four = solved(readings[0])[0]
    assert found.parity == four.parity
    assert apart == rotation_distance(found.quaternion, four.quaternion) > 0.0
    chord = np.linalg.norm(
        kinematics.forward_theta3a(readings[:, :3], readings[:, 3])
        - kinematics.matrix_from_quaternion(truth),
        axis=(1, 2),
    )
    assert np.sqrt(np.mean(chord**2 / 2.0)) == pytest.approx(claimed, rel=0.03)
    assert claimed >= total_deviation(solved(angles)[0])


def test_classic_does_not_use_th3a():
    truth, angles = pose(20.0)
    estimate = solved(moved(angles, 3, 0.1), truth, 'classic')[0]
    assert rotation_distance(estimate.quaternion, truth) < 1e-6
    assert abs(estimate.parity) > 0.5
    active = kinematics.UsedSensors(SIGMA, (3,))
    three = Solver(kinematics.Geometry(), SIGMA).solve(angles, active, truth)[0]
    assert estimate.covariance == pytest.approx(three.covariance)
    assert total_deviation(estimate) > total_deviation(solved(angles, truth)[0])


@pytest.mark.parametrize(
    ('phi', 'prior', 'text'),
    [
        (49.3586, 49.3586, 'too close to distinguish'),
        # The prior is in the other mode; th3A shows that it is wrong.
        (30.0, 70.0, 'classic is .* rad from the estimate'),
    ],
)
def test_classic_refuses_where_modes_meet_and_the_wrong_mode(phi, prior, text):
    with pytest.raises(SingularityError, match=text):
        solved(pose(phi)[1], pose(prior)[0], 'classic')


def test_what_the_last_step_leaves_is_a_small_part_of_the_deviation():
    """The solver stops early; beside the converged estimate, all over the workspace."""
    rng = np.random.default_rng(31)
    left = []
    while len(left) < 150:
        truth, angles = pose(*np.degrees(rng.uniform((-1.05, 0.0, 0.0), (1.75, 0.52, 6.28))))
        angles = tuple((np.array(angles) + SIGMA[0] * rng.normal(size=4)).tolist())
        try:
            converged = kinematics.estimate_sample(
                angles, FOUR, kinematics.Geometry(), truth, working_mode=(1, 1, 1)
            )
            found = solved(angles, truth)[0]
        except (UnreachableError, SingularityError):
            continue
        left.append(
            rotation_distance(found.quaternion, converged.quaternion) / total_deviation(converged)
        )
        assert total_deviation(found) == pytest.approx(total_deviation(converged), rel=0.03)
        assert found.parity == pytest.approx(converged.parity, abs=0.03)
    assert max(left) < 0.03
    assert np.sqrt(np.mean(np.square(left))) < 0.003


def test_angles_of_another_working_mode_are_no_orientation():
    with pytest.raises(SingularityError, match='another working mode'):
        solved(MIRRORED)
    mirrored = Solver(kinematics.Geometry(), SIGMA, working_mode=(-1, -1, -1))
    assert mirrored.solve(MIRRORED, FOUR, None)[0].determined
    for changed, expected in (({}, 0), ({'working_mode': (-1, -1, -1)}, 16)):
        supervisor = make_supervisor(complete(SUPERVISION_SETTINGS, changed))
        assert (
            sum(
                supervisor.take(1 + index * 1_000_000, MIRRORED).estimate is not None
                for index in range(20)
            )
            == expected
        )
