# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The unrolled step of a healthy sample gives what Gauss-Newton gives."""

import math

import numpy as np
import pytest
from readings import all_angles, PAPER, SIGMA
from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics import UsedSensors, workspace_pose
from spm_haptic_master.kinematics.estimation.gauss_newton import fit, one_step
from spm_haptic_master.kinematics.leg_kernels import linkage, turn_of_second_joint
from spm_haptic_master.kinematics.number_backends import FLOATS

MODE = (1, 1, 1)
# Largest last step with which one step is enough on healthy samples (rad).
LAST_STEP = math.sqrt(0.01 * SIGMA)
SETS = [UsedSensors(tuple(SIGMA * (1.0 + 0.2 * place) for place in range(mounted)), left_out)
        for mounted, left_out in ((4, ()), (5, ()), (5, (4,)), (6, ()), (6, (4,)), (6, (5,)))]
# Sensors of which one counts far more than another.
SETS += [UsedSensors(tuple(SIGMA * factor for factor in factors), ()) for factors in (
    (1.0, 1.0, 1.0, 1.0, 30.0), (1.0, 0.1, 1.0, 1.0, 1.0, 30.0), (0.1, 1.0, 1.0, 3.0, 0.1, 1.0))]


def start_of(readings):
    """Return state and linkage of Case 2."""
    th1a, th1b, th1c, th3a = readings[:4]
    view = linkage(th1a, th1b, th1c, th3a, PAPER, FLOATS)
    cosine, sine, determinant = turn_of_second_joint(*view[2:])
    th2a = math.atan2(sine * determinant, cosine * determinant)
    return (th1a, th2a, th3a, th1b, th1c), view


def samples(sensors, number=200):
    """Yield readings of the mounted sensors at random poses, with noise."""
    rng = np.random.default_rng(sensors.count)
    poses = workspace_pose(rng.uniform(0.0, 0.35, number), rng.uniform(0.0, 6.3, number),
                           rng.uniform(-0.5, 0.7, number))
    angles = all_angles(poses)[:, :len(sensors.sigma)]
    yield from map(tuple, (angles + sensors.sigma * rng.normal(size=angles.shape)).tolist())


@pytest.mark.parametrize('sensors', SETS, ids=lambda sensors: str(sensors.used))
def test_one_step_is_the_first_of_gauss_newton(sensors):
    done, tolerance = 0, 1e-12 * (sensors.largest / min(sensors.sigma)) ** 2
    for readings in samples(sensors):
        arguments = *start_of(readings), readings, sensors, PAPER, MODE, LAST_STEP
        found, expected = one_step(*arguments), fit(*arguments)
        if found is None:
            continue
        done += 1
        for name in ('quaternion', 'covariance', 'parity', 'parity_vector', 'parity_sizes',
                     'parity_gains', 'gains', 'gain_sizes'):
            value = np.array(getattr(expected, name))
            np.testing.assert_allclose(
                getattr(found, name), value, rtol=0.0, atol=tolerance * np.abs(value).max())
        assert found.determined == expected.determined and found.sensors is sensors
    assert done > 150


def test_one_step_leaves_what_it_cannot_decide_to_gauss_newton():
    sensors = SETS[0]
    for readings in samples(sensors, 20):
        state, view = start_of(readings)
        assert one_step(state, view, readings, sensors, PAPER, MODE, 1e-9) is None
        for wrong in ((-1, 1, 1), (1, -1, 1), (1, 1, -1)):
            arguments = state, view, readings, sensors, PAPER, wrong, LAST_STEP
            assert one_step(*arguments) is None
            with pytest.raises(SingularityError, match='working mode'):
                fit(*arguments)


@pytest.mark.parametrize('mounted', [5, 6])
@pytest.mark.parametrize('place', [0, 3])
def test_one_step_takes_a_sensor_that_the_others_cannot_check(mounted, place):
    sigma = [0.1] * mounted
    sigma[place] = 1e-9
    sensors, exact = UsedSensors(tuple(sigma)), UsedSensors((1e-9,) * mounted)
    for readings in samples(exact, 20):
        found = one_step(*start_of(readings), readings, sensors, PAPER, MODE, LAST_STEP)
        assert found is not None and found.parity_sizes[place] == 0.0
        assert min(size for other, size in enumerate(found.parity_sizes) if other != place) > 0.0
