# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated device for the tests of the supervision: motions, encoders, faults, errors."""

from __future__ import annotations

import numpy as np
from spm_haptic_master.kinematics import inverse, quaternion_from_matrix, workspace_pose
from spm_haptic_master.supervision import supervise

SINGULAR = 49.358591780  # deg; central singularity of the rig's working mode


def motion(kind: str, seconds: float, rate: float = 1000.0) -> np.ndarray:
    """Return the orientations of a motion, (n, 3, 3)."""
    t = np.arange(round(seconds * rate)) / rate
    zero = np.zeros(len(t))

    def swing(amplitude, hertz):
        return amplitude * np.sin(2.0 * np.pi * hertz * t)

    tilt, azimuth, phi = {
        'rest': (zero, zero, zero + 20.0),
        'singular': (zero, zero, zero + SINGULAR),
        'crossing': (zero, zero, 45.0 + swing(10.0, 0.05)),
        'through': (zero, zero, 42.0 + 7.0 * np.cos(0.5 * np.pi * t)),
        'turning': (zero, zero, 20.0 + swing(10.0, 0.5)),
        'rim': (zero + 18.0, 200.0 + swing(40.0, 0.16), 25.0 + swing(5.0, 0.32)),
        'tremor': (8.0 + swing(0.05, 10.0), 30.0 + swing(1.0, 9.0), 30.0 + swing(0.06, 11.0)),
        'sweep': (8.0 * (1.0 - np.cos(0.9 * t)), 72.0 * t, 42.0 + swing(40.0, 0.08)),
        'fast': (6.0 + swing(2.0, 3.0), 90.0 + swing(20.0, 2.0), 30.0 + swing(20.0, 4.5)),
    }[kind]
    return workspace_pose(*map(np.radians, (tilt, azimuth, phi)))


def joint_angles(rotations: np.ndarray, sensors: int = 4) -> np.ndarray:
    """Return the true th1A, th1B, th1C, th3A, and th3B and th3C if asked, rad, (n, sensors)."""
    joints = inverse(rotations)
    return np.column_stack(
        [joints.theta1, joints.theta3a, joints.theta3b, joints.theta3c])[:, :sensors]


def encoders(angles: np.ndarray, noise: float = 0.04, bits: int = 14, seed: int = 1) -> np.ndarray:
    """Return readings, rad: noise (1 sigma, deg) and quantisation on the angles."""
    rng = np.random.default_rng(seed)
    count = 2.0 * np.pi / 2**bits
    return np.round((angles + np.radians(noise) * rng.normal(size=angles.shape)) / count) * count


def stamps(n: int, rate: float = 1000.0) -> np.ndarray:
    """Return the stamps of a regular sampling, ns."""
    return 1_000_000_000 + np.round(np.arange(n) * 1e9 / rate).astype(np.int64)


def errors(result, rotations: np.ndarray) -> np.ndarray:
    """Return the rotation error of each orientation, deg; NaN where none is published."""
    true = quaternion_from_matrix(rotations)
    chord = np.minimum(np.linalg.norm(true - result.quaternion, axis=1),
                       np.linalg.norm(true + result.quaternion, axis=1))
    return np.degrees(4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))


class Outcome:
    """What the supervision makes of readings on a known motion."""

    def __init__(self, rotations, readings, times=None, rate=1000.0, **parameters):
        times = stamps(len(readings), rate) if times is None else times
        self.result = supervise(times, readings, **parameters)
        self.published = self.result.published
        self.error = errors(self.result, rotations)
        self.states = [text for _, text in self.result.state]

    def longest_undeclared(self, sensor: int, rate: float = 1000.0) -> float:
        """Return the longest time, s, off by more than the level with the sensor checked."""
        wrong = (self.error > self.result.protection_level) \
            & (self.result.unchecked[:, sensor] == 0.0)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], wrong, [0]])))
        return max(edges[1::2] - edges[::2], default=0) / rate
