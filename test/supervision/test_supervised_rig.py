# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A rig with ordinary tolerances through the supervision: with its own mechanism and drawn."""

from dataclasses import replace
from functools import cache
from math import hypot, pi, radians

import numpy as np
from product_limits import product_limits
import pytest
from spm_haptic_master.kinematics import Geometry, matrix_from_quaternion
from spm_haptic_master.simulation.noisy_motion import NoisyMotion
from spm_haptic_master.simulation.rig import random_rig, Tolerances
from spm_haptic_master.simulation.trajectories import sweep
from spm_haptic_master.supervision.solver import Solver
from spm_haptic_master.supervision.supervisor import Supervisor
from supervised import COUNT, Run, SIGMA

# Standard deviations of ordinary tolerances (rad), and seeds of rigs that have them.
TOLERANCES = Tolerances(*np.radians([0.25, 0.25, 0.12, 0.01]))
SEEDS = (1, 2, 3)
SAMPLES = 3000


@cache
def recording(seed):
    """Return a rig, three seconds of its true orientations and its counted readings."""
    rig = random_rig(seed, TOLERANCES, noise=SIGMA)
    motion = NoisyMotion(sweep(radians(20.0)), rig, seed, (1, 1, 1))
    # The sweep four times as fast: three seconds of it cross much of the workspace.
    times = 4e-3 * np.arange(SAMPLES)
    readings = np.array([motion.angles(t) for t in times])
    truth = matrix_from_quaternion(np.array([motion.orientation(t) for t in times]))
    return rig, truth, COUNT * np.round(readings / COUNT)


def without_first_harmonics(rig, readings):
    """Return readings corrected as a calibration does: the first harmonics inverted."""
    first = [replace(sensor, second_harmonic=(0.0, 0.0)) for sensor in rig.sensors]
    grid = np.linspace(-1.1 * pi, 1.1 * pi, 4001)
    return np.column_stack([
        np.interp(column, [sensor.with_harmonics(angle) for angle in grid], grid)
        for sensor, column in zip(first, readings.T, strict=True)])


def supervised(geometry, readings, truth, bias):
    sigma = (SIGMA,) * 4
    return Run(Supervisor(Solver(geometry, sigma), sigma, product_limits(bias=bias)), readings,
               truth)


@pytest.mark.parametrize('seed', SEEDS)
def test_with_its_own_mechanism_and_bias_it_is_published(seed):
    rig, truth, readings = recording(seed)
    bias = tuple(hypot(*sensor.second_harmonic) + 1e-4 for sensor in rig.sensors)
    run = supervised(rig.geometry, without_first_harmonics(rig, readings), truth, bias)
    # The first four samples of a start are withheld.
    assert run.out.sum() >= 0.999 * SAMPLES - 4
    error = np.degrees(run.error[run.out])
    assert np.sqrt((error**2).mean()) <= 0.055 and error.max() <= 0.3


def test_with_the_drawn_mechanism_it_is_silent_much_of_the_time():
    published = [supervised(Geometry(), readings, truth, (radians(0.05),) * 4).out.mean()
                 for _, truth, readings in map(recording, SEEDS)]
    print(f'published with the drawn mechanism: {published}')
    assert np.median(published) < 0.5 and min(published) < 0.05
