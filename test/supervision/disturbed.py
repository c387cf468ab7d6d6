# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Impacts and vibrations of a healthy device: orientations about an axis, at 1 kHz."""

from __future__ import annotations

from device import encoders, joint_angles, Outcome
import numpy as np
from spm_haptic_master.kinematics import matrix_from_quaternion, workspace_pose

# Noise (1 sigma, deg) and resolution (bits) of two kinds of encoders.
ENCODERS = {'14 bits': (0.04, 14), '17 bits': (0.006, 17)}
# Disturbances of a healthy device.
DISTURBANCES = ('end stop', 'vibration')
# Fastest acceleration of the hand (rad/s^2), and what is left of a speed after an end stop.
HAND, REBOUND = 300.0, 0.3


def about(pose: np.ndarray, axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the orientations of a pose that is turned about an axis by angles, rad, (n, 3, 3)."""
    half = 0.5 * angles[:, None]
    quaternions = np.hstack([axis / np.linalg.norm(axis) * np.sin(half), np.cos(half)])
    return matrix_from_quaternion(quaternions) @ pose


def random_pose(rng: np.random.Generator) -> np.ndarray:
    """Return a pose of the inner workspace."""
    return workspace_pose(*np.radians(
        [rng.uniform(0.0, 12.0), rng.uniform(0.0, 360.0), rng.uniform(5.0, 60.0)]))


def end_stop(speed: float, contact: float) -> np.ndarray:
    """Return the angle, rad, of a turn that an end stop reverses after 10 deg."""
    step = 1e-5
    up, travel, down = speed / HAND, np.radians(10.0) / speed, REBOUND * speed / HAND
    time = np.arange(0.0, 0.4 + up + travel + contact + down, step)
    begin, hit = 0.15, 0.15 + up + travel
    push = HAND * ((time >= begin) & (time < begin + up))
    phase = (time - hit) / contact
    push -= (1.0 + REBOUND) * speed * np.pi / 2.0 / contact * np.sin(np.pi * phase) * (
        (phase >= 0.0) & (phase < 1.0))
    push += HAND * ((phase >= 1.0) & (time < hit + contact + down))
    return (np.cumsum(np.cumsum(push)) * step * step)[::round(1e-3 / step)]


def vibration(hertz: float, seconds: float = 2.0) -> np.ndarray:
    """Return the angle, rad, of a vibration of 0.2 deg that begins after 0.2 s."""
    time = np.arange(round(1000.0 * seconds)) * 1e-3
    return np.radians(0.2) * np.sin(2.0 * np.pi * hertz * time) * (time >= 0.2)


def disturbance(kind: str, seed: int) -> np.ndarray:
    """Return the orientations of an end stop or a vibration: pose, axis and size by the seed."""
    rng = np.random.default_rng(seed)
    if kind == 'end stop':
        angles = end_stop(rng.uniform(1.0, 6.0), rng.uniform(0.003, 0.005))
    else:
        angles = vibration(rng.uniform(60.0, 150.0))
    return about(random_pose(rng), rng.normal(size=3), angles)


def run(rotations: np.ndarray, sensors: int, encoder: str = '14 bits', seed: int = 1, change=None,
        keep=None, **parameters) -> Outcome | None:
    """Return what the supervision makes of it; None where the device does not reach it."""
    noise, bits = ENCODERS[encoder]
    true = joint_angles(rotations, sensors)
    if not np.isfinite(true).all():
        return None
    angles = encoders(true, noise, bits, seed)
    if change is not None:
        angles = change(angles.copy())
    times = 1_000_000_000 + np.arange(len(angles)) * 1_000_000
    if keep is not None:
        rotations, angles, times = rotations[keep], angles[keep], times[keep]
    return Outcome(rotations, angles, times, sigma_deg=[noise] * 4, **parameters)
