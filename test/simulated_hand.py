# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motions by a hand of simulated rigs, and what their encoders read: for calibrations."""

from dataclasses import dataclass
from math import radians, tau

import numpy as np
from spm_haptic_master.kinematics import inverse, workspace_pose
from spm_haptic_master.simulation.rig import Rig

# Sample rate (Hz), and working mode.
RATE = 1000.0
MODE = (1, 1, 1)
# Periods of a hand's motion (s): random ones between these.
PERIODS = 1.5, 12.0
# Waves of each of its three coordinates.
WAVES = 6
# Half of the time in which it slows down (samples).
EASE = 200


@dataclass(frozen=True, slots=True)
class Condition:
    """How a rig is moved and read."""

    name: str  # in the table
    seconds: float = 90.0  # length of the motion, s
    tilt: float = 20.0  # largest tilt, deg
    turn_from: float = -5.0  # least self-rotation, deg
    turn_to: float = 95.0  # largest self-rotation, deg
    noise: float = 0.04  # of each sensor, deg, 1 standard deviation
    bits: int = 14  # of each encoder
    pace: float = 1.0  # speed against that of the usual motion (unit 1)
    outliers: float = 0.0  # part of the sets with a wrong reading (unit 1)
    rest: float = 0.0  # part of the time at rest, in the middle (unit 1)
    dropout: float = 0.0  # part of the sets missing, in one piece (unit 1)
    one_sided: bool = False  # whether the tilts are towards azimuth 0 only


def hand_motion(rig: Rig, condition: Condition, seed: int) -> np.ndarray:
    """Return the orientations of a hand's motion within the rig's reach, shape (n, 3, 3)."""
    random = np.random.default_rng(seed)
    t = np.arange(int(condition.seconds * RATE)) / RATE
    if condition.rest:
        middle = 0.5 * t[-1]
        half = 0.5 * condition.rest * t[-1]
        t = np.where(t < middle - half, t, np.maximum(middle - half, t - 2.0 * half))
    waves = []
    for _ in range(3):
        periods = random.uniform(*PERIODS, WAVES) / condition.pace
        sizes = periods**0.5
        wave = sum(
            size * np.sin(tau * t / period + random.uniform(0.0, tau))
            for size, period in zip(sizes, periods, strict=True)
        )
        waves.append(wave / np.sqrt(np.sum(sizes**2) / 2.0))
    x, y, turn = waves
    if condition.one_sided:
        x = 0.5 + 0.5 * np.tanh(x)
        y = 0.5 * np.tanh(y)
    size = np.hypot(x, y)
    tilt = radians(condition.tilt) * np.tanh(0.8 * size)
    middle = 0.5 * (condition.turn_from + condition.turn_to)
    width = 0.5 * (condition.turn_to - condition.turn_from)
    phi = np.radians(middle + width * np.tanh(0.8 * turn))
    # A hand stops where the mechanism does, and slows down before: nearer to the middle where a
    # pose is out of reach.
    nearer = np.ones(len(t))
    while True:
        part = _eased(nearer)
        poses = workspace_pose(
            part * tilt, np.arctan2(y, x), np.radians(middle) + part * (phi - np.radians(middle))
        )
        beyond = np.isnan(inverse(poses, rig.geometry, MODE).theta1).any(axis=1)
        if not beyond.any():
            return poses
        nearer[beyond] *= 0.9


def _eased(values: np.ndarray) -> np.ndarray:
    """Return values without steps, at most as large."""
    padded = np.pad(values, EASE, mode='edge')
    least = np.lib.stride_tricks.sliding_window_view(padded, 2 * EASE + 1).min(axis=1)
    weights = np.hanning(2 * EASE + 3)[1:-1]
    return np.convolve(
        np.pad(least, EASE, mode='edge'),
        weights / weights.sum(),
        'valid',
    )


def joint_angles(poses: np.ndarray, rig: Rig) -> np.ndarray:
    """Return th1A, th1B, th1C, th3A and those of further sensors, rad, shape (n, N)."""
    found = inverse(poses, rig.geometry, MODE)
    return np.column_stack([found.theta1, found.theta3a, found.theta3b, found.theta3c])[
        :, : len(rig.sensors)
    ]


def deviations_of(rig: Rig, angles: np.ndarray) -> np.ndarray:
    """Return what the encoders' harmonics add to joint angles, rad, shape (n, N)."""
    c1, s1, c2, s2 = np.transpose(
        [(*sensor.first_harmonic, *sensor.second_harmonic) for sensor in rig.sensors]
    )
    return (
        c1 * np.cos(angles)
        + s1 * np.sin(angles)
        + c2 * np.cos(2.0 * angles)
        + s2 * np.sin(2.0 * angles)
    )


def readings(
    rig: Rig,
    condition: Condition,
    seed: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps, raw angles, and the true directions and zeros (rad) of a motion."""
    poses = hand_motion(rig, condition, seed)
    random = np.random.default_rng(seed + 1)
    angles = joint_angles(poses, rig)
    read = angles + deviations_of(rig, angles)
    read += random.normal(size=read.shape) * radians(condition.noise)
    direction = random.choice((-1, 1), len(rig.sensors))
    zeros = random.uniform(0.0, tau, len(rig.sensors))
    per_turn = 2**condition.bits
    counts = np.round((direction * (read + zeros)) * per_turn / tau) % per_turn
    wrong = random.uniform(size=len(counts)) < condition.outliers
    counts[wrong, random.integers(0, len(rig.sensors), wrong.sum())] = random.integers(
        0, per_turn, wrong.sum()
    )
    stamps = (np.arange(len(counts)) * 1e9 / RATE).astype(np.int64)
    kept = np.ones(len(counts), dtype=bool)
    lost = int(condition.dropout * len(counts))
    kept[len(counts) // 4 : len(counts) // 4 + lost] = False
    return stamps[kept], counts[kept] * tau / per_turn, direction, zeros
