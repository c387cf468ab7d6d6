# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Joint angles with noise, without quantisation, of a master that follows a trajectory."""

from __future__ import annotations

import random

from spm_haptic_master.kinematics import Geometry, inverse_angles, zxz_rotation
from spm_haptic_master.simulation.trajectories import Trajectory


class NoisyMotion:
    """
    Measured angles of four sensors with noise and without quantisation.

    Parameters
    ----------
    trajectory : callable
        Time in s to (psi, theta, phi) in rad.
    noise : float
        Standard deviation of each sensor, rad.
    seed : int
        Seed of the noise: the same seed gives the same noise.
    geometry : Geometry
        Link angles of the manipulator.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.

    """

    def __init__(self, trajectory: Trajectory, noise: float, seed: int, geometry: Geometry,
                 working_mode: tuple[int, int, int]):
        self._trajectory = trajectory
        self._noise = noise
        self._gauss = random.Random(seed).gauss
        self._geometry = geometry
        self._working_mode = working_mode

    def angles(self, t: float) -> tuple[float, float, float, float]:
        """Return th1A, th1B, th1C, th3A with noise, rad, `t` seconds into the motion."""
        th1a, th1b, th1c, _, th3a = inverse_angles(
            zxz_rotation(*self._trajectory(t)), self._geometry, self._working_mode)
        gauss, noise = self._gauss, self._noise
        return (th1a + gauss(0.0, noise), th1b + gauss(0.0, noise),
                th1c + gauss(0.0, noise), th3a + gauss(0.0, noise))
