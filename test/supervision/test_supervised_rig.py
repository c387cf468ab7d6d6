# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A rig with ordinary tolerances through the supervision: with its own mechanism and drawn."""

from dataclasses import replace
from functools import cache
from math import pi, radians

from device import offset, Outcome
import numpy as np
import pytest
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.simulation.noisy_motion import NoisyMotion
from spm_haptic_master.simulation.rig import random_rig, Tolerances
from spm_haptic_master.simulation.trajectories import sweep

# Standard deviations of ordinary tolerances (rad), and seeds of rigs that have them.
TOLERANCES = Tolerances(*np.radians([0.25, 0.25, 0.12, 0.01]))
SEEDS = (1, 2)
SAMPLES, COUNT = 1500, 2.0 * pi / 2**14


@cache
def recording(seed):
    """Return a rig, three seconds of its true orientations and its counted readings."""
    rig = random_rig(seed, TOLERANCES, noise=radians(0.04))
    motion = NoisyMotion(sweep(radians(20.0)), rig, seed, (1, 1, 1))
    # The sweep eight times as fast: it crosses much of the workspace.
    times = 8e-3 * np.arange(SAMPLES)
    readings = np.array([motion.angles(t) for t in times])
    truth = matrix_from_quaternion(np.array([motion.orientation(t) for t in times]))
    return rig, truth, COUNT * np.round(readings / COUNT)


def as_built(seed, change=None):
    """Return what is published of it with its mechanism, first harmonics and bias known."""
    rig, truth, readings = recording(seed)
    grid = np.linspace(-1.1 * pi, 1.1 * pi, 4001)
    first = [replace(sensor, second_harmonic=(0.0, 0.0)) for sensor in rig.sensors]
    corrected = np.column_stack([
        np.interp(column, [sensor.with_harmonics(angle) for angle in grid], grid)
        for sensor, column in zip(first, readings.T, strict=True)])
    if change is not None:
        change(corrected)
    g = rig.geometry
    return Outcome(
        truth, corrected, geometry__base_axes=g.base_axes, geometry__platform_axes=g.platform_axes,
        geometry__proximal_deg=np.degrees(g.alphas), geometry__distal_deg=np.degrees(g.betas),
        bias_deg=np.degrees([np.hypot(*each.second_harmonic) + 1e-4 for each in rig.sensors]))


@pytest.mark.parametrize('seed', SEEDS)
def test_with_its_own_mechanism_and_bias_it_is_published(seed):
    found = as_built(seed)
    # The first four samples of a start are withheld.
    assert found.published.sum() >= 0.999 * SAMPLES - 4
    error = found.error[found.published]
    assert np.sqrt((error**2).mean()) <= 0.055 and error.max() <= 0.3


@pytest.mark.parametrize(('sensor', 'fault_deg'), [
    (0, 2.0), (3, -0.5), *(pytest.param(*each, marks=pytest.mark.slow)
                           for each in ((1, -0.5), (2, 2.0)))])
def test_no_fault_turns_it_by_more_than_its_protection_level(sensor, fault_deg):
    found = as_built(1, offset(600, sensor, fault_deg))
    assert found.published[4:600].all()
    assert found.longest_undeclared(sensor) <= 0.02
    # A large fault is seen.
    assert abs(fault_deg) < 1.0 or not found.published[602:].any()


def test_with_the_drawn_mechanism_it_is_silent_much_of_the_time():
    published = [Outcome(truth, readings).published.mean()
                 for _, truth, readings in map(recording, SEEDS)]
    assert np.median(published) < 0.5 and min(published) < 0.05
