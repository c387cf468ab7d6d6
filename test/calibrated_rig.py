# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated rigs with what a calibration leaves: zeros fitted, second harmonics in no model."""

from __future__ import annotations

from math import ceil, radians

import numpy as np
from simulated_hand import deviations_of, joint_angles, MODE
from spm_haptic_master.calibration.watch.slip_evidence import parities, summed
from spm_haptic_master.kinematics import Geometry, matrix_from_zxz
from spm_haptic_master.simulation.rig import random_rig, Tolerances

NOISE = radians(0.04)
# Unit of bias_deg, rad, as calibrate rounds it up.
UNIT = radians(0.01)
# Links and axes, which the calibration knows, and second harmonics, which it does not.
TOLERANCES = Tolerances(
    links=radians(0.25),
    axes=radians(0.25),
    second_harmonic=radians(0.02),
)


def motion(
    seed: int, seconds: float, rate: float, tilt: float = 15.0, turn: float = 38.0
) -> np.ndarray:
    """Return the rotations of a motion by hand, (n, 3, 3); tilt and turn in deg."""
    random = np.random.default_rng(seed)
    times = np.arange(round(seconds * rate)) / rate

    def swing(amplitude: float) -> np.ndarray:
        slow = random.uniform(0.1, 0.3)
        fast = random.uniform(0.3, 0.6)
        phases = random.uniform(0.0, 2.0 * np.pi, 2)
        return amplitude * (
            0.7 * np.sin(2.0 * np.pi * slow * times + phases[0])
            + 0.3 * np.sin(2.0 * np.pi * fast * times + phases[1])
        )

    return matrix_from_zxz(
        np.radians(135.0 + swing(tilt)),
        np.radians(54.7 + swing(tilt)),
        np.radians(48.0 + swing(turn)),
    )


class CalibratedRig:
    """A rig whose geometry is known and whose zeros were fitted to a motion of 90 s."""

    def __init__(self, seed: int, sensors: int = 4, tolerances: Tolerances = TOLERANCES):
        self.rig = random_rig(seed, tolerances, sensors=sensors)
        self.geometry: Geometry = self.rig.geometry
        self.sigma = np.full(sensors, NOISE)
        self._random = np.random.default_rng(seed)
        self._zeros = np.zeros(sensors)
        rotation = motion(1000 + seed, 90.0, 50.0)
        angles = self.angles(rotation)
        sums = summed(angles, parities(angles, rotation, self.sigma, self.geometry, MODE))
        self._zeros = np.linalg.solve(
            sums.information.sum(0) + np.eye(sensors) * radians(1) ** -2, sums.score.sum(0)
        )
        # As calibrate has it: what the mean parity of 99 % of the pieces does not exceed.
        after = summed(
            angles - self._zeros,
            parities(angles - self._zeros, rotation, self.sigma, self.geometry, MODE),
        )
        values, vectors = np.linalg.eigh(after.information)
        slow = np.einsum('mik,mi->mk', vectors, after.score)[:, 3:] / values[:, 3:]
        bound = float(np.percentile(np.abs(slow[after.samples > 20]), 99.0))
        self.bias = np.full(sensors, ceil(bound / UNIT) * UNIT)

    def angles(self, rotation: np.ndarray) -> np.ndarray:
        """Return the joint angles by the calibration, rad, (n, N)."""
        true = joint_angles(rotation, self.rig)
        return (
            true
            + deviations_of(self.rig, true)
            - self._zeros
            + self._random.normal(0.0, NOISE, true.shape)
        )
