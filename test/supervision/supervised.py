# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motions of the device, noisy readings of them, and what a supervisor makes of those."""

from math import radians

import numpy as np
from product_limits import product_limits
from spm_haptic_master.kinematics import Geometry, inverse, matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.supervision.solver import Solver
from spm_haptic_master.supervision.supervisor import Supervisor

SIGMA = radians(0.04)
COUNT = 2.0 * np.pi / 16384
PERIOD = 1_000_000
CENTRE = np.degrees(np.arccos(1.0 / np.sqrt(3.0)))


def rest(phi, psi=135.0, theta=CENTRE):
    return lambda t: np.broadcast_arrays(psi + 0.0 * t, theta, phi)


def turning(amplitude, hertz, middle=30.0):
    return lambda t: np.broadcast_arrays(
        135.0 + 0.0 * t, CENTRE, middle + amplitude * np.sin(2.0 * np.pi * hertz * t))


def swinging(degrees, hertz):
    """Return a motion that tilts and turns around phi = 25 deg."""
    def at(t):
        swing = 2.0 * np.pi * hertz * t
        return (135.0 + degrees * np.sin(swing), CENTRE + 0.6 * degrees * np.sin(0.71 * swing),
                25.0 + degrees * np.sin(1.31 * swing))
    return at


FAST = swinging(10.0, 3.0)
PLACES = {
    'centre': rest(20.0),
    'edge': rest(25.0, psi=115.0, theta=45.0),
    'crossing slowly': turning(10.0, 0.05, 45.0),
    'turning': turning(10.0, 0.5, 20.0),
    'swinging': swinging(8.0, 0.7),
}


def readings(motion, count, seed=1, noise=SIGMA, counts=True):
    """Return the true rotations and the four noisy, quantised readings, (n, 4)."""
    rotations = matrix_from_zxz(*np.radians(motion(np.arange(count) * PERIOD * 1e-9)))
    joints = inverse(rotations)
    angles = np.column_stack([joints.theta1, joints.theta3a])
    angles += np.random.default_rng(seed).normal(0.0, 1.0, angles.shape) * noise
    return rotations, np.round(angles / COUNT) * COUNT if counts else angles


def supervisor(method='estimate', **limits):
    sigma = (SIGMA,) * 4
    return Supervisor(Solver(Geometry(), sigma, method), sigma, product_limits(**limits))


class Run:
    """
    What a supervisor made of readings.

    Errors, protection levels and bounds (three standard deviations) are in rad, NaN where nothing
    is published.
    """

    def __init__(self, subject, angles, rotations=None, first=0):
        self.states, self.reasons, self.error, self.bound = [], [], [], []
        level, unchecked = [], []
        true = None if rotations is None else quaternion_from_matrix(rotations)
        for index, row in enumerate(angles):
            verdict = subject.take((first + index) * PERIOD, tuple(row.tolist()))
            estimate = verdict.estimate
            if estimate is None:
                self.reasons.append(verdict.cause.words)
                self.error.append(np.nan)
                self.bound.append(np.nan)
                level.append(np.nan)
            else:
                self.reasons.append(None)
                level.append(verdict.protection_level)
                if true is not None:
                    self.error.append(rotation_distance(estimate.quaternion, tuple(true[index])))
                    self.bound.append(3.0 * np.sqrt(sum(estimate.covariance[::4])))
            self.states.append(verdict.text)
            unchecked.append(subject.unchecked())
        self.out = np.array([reason is None for reason in self.reasons])
        self.error, self.bound = np.array(self.error), np.array(self.bound)
        self.level, self.unchecked = np.array(level), np.array(unchecked)

    def covered(self, sensor):
        """
        Whether no error exceeded its level for long while the others checked the sensor.

        Long is the time to alert, 20 samples here.
        """
        wrong = (self.error > self.level) & (self.unchecked[:, sensor] == 0.0)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], wrong, [0]])))
        return max(edges[1::2] - edges[::2], default=0) <= 20
