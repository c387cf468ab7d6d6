# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibrates simulated rigs of which nothing is known from free motion, and prints what comes out.

Links and axes of each rig are off by 0.3 deg, first harmonics by 0.12 deg, second ones by 0.015
deg (one standard deviation), zero counts and directions are anywhere. A rig is right if its
orientations are, on another motion and without noise; wrong without a word if the calibration was
written and its error is more than the file's figures allow.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from math import degrees, radians, tau
import os
import sys

import numpy as np
from spm_haptic_master.calibration.free_motion import MotionCalibration, MotionCalibrator
from spm_haptic_master.calibration.mechanism_parameters import Tolerances as Priors
from spm_haptic_master.calibration.motion_coverage import aligned_changes
from spm_haptic_master.calibration.motion_model import MotionModel
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import Geometry, inverse, workspace_pose
from spm_haptic_master.simulation.rig import random_rig, Rig, Tolerances
from spm_haptic_master.validation.alignment import rotation_vectors

# Deviations of the rigs.
DEVIATIONS = Tolerances(radians(0.3), radians(0.3), radians(0.12), radians(0.015))
# Number of rigs of each condition.
RIGS = 30
RATE = 1000.0
MODE = (1, 1, 1)
# Periods of a hand's motion (s): random ones between these.
PERIODS = 1.5, 12.0
# Waves of each of its three coordinates.
WAVES = 6
# Seed of the motion that the result is tried on, apart from those of the rigs.
CHECK_SEED = 9_000_000
# Standard deviations of the predicted error that a right result may be off by.
RIGHT_SIGMAS = 3.5


@dataclass(frozen=True, slots=True)
class Condition:
    """
    How a rig is moved and read.

    Attributes
    ----------
    name : str
        In the table.
    seconds : float
        Length of the motion, s.
    tilt, turn_from, turn_to : float
        Largest tilt, and range of the self-rotation, deg.
    noise : float
        Of each sensor, deg, 1 standard deviation.
    bits : int
        Of each encoder.
    pace : float
        Speed against that of the usual motion (unit 1).
    outliers : float
        Part of the sets with a wrong reading (unit 1).
    rest : float
        Part of the time at rest, in the middle (unit 1).
    dropout : float
        Part of the sets missing, in one piece (unit 1).

    """

    name: str
    seconds: float = 90.0
    tilt: float = 20.0
    turn_from: float = -5.0
    turn_to: float = 95.0
    noise: float = 0.04
    bits: int = 14
    pace: float = 1.0
    outliers: float = 0.0
    rest: float = 0.0
    dropout: float = 0.0


USUAL = Condition('90 s, tilt 20 deg, 0.04 deg, 14 bits')
CONDITIONS = (
    USUAL,
    replace(USUAL, name='30 s', seconds=30.0),
    replace(USUAL, name='tilt 10 deg, self-rotation 30 .. 70', tilt=10.0, turn_from=30.0,
            turn_to=70.0),
    replace(USUAL, name='noise 0.1 deg', noise=0.1),
    replace(USUAL, name='12 bits', bits=12),
    replace(USUAL, name='5 % outliers, dropout of 5 s, 20 s at rest', outliers=0.05,
            dropout=0.055, rest=0.22),
    replace(USUAL, name='slower by 2.5, clipped at 14 deg', pace=0.4, tilt=14.0),
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """
    What came of one rig.

    Attributes
    ----------
    refused : str or None
        Why nothing was written.
    zeros, directions : bool
        Whether they are right.
    error, predicted : float
        Orientation error on another motion, frames aligned, deg rms, and as predicted.
    distance : float
        Mean squared error of the parameters over their predicted variance (unit 1).
    bias : float
        Bound of the systematic error that the file has, deg.

    """

    refused: str | None
    zeros: bool = True
    directions: bool = True
    error: float = 0.0
    predicted: float = 0.0
    distance: float = 0.0
    bias: float = 0.0


def hand_motion(rig: Rig, condition: Condition, seed: int) -> np.ndarray:
    """Return the orientations of a hand's motion within the rig's reach, shape (n, 3, 3)."""
    random = np.random.default_rng(seed)
    t = np.arange(int(condition.seconds * RATE)) / RATE
    if condition.rest:
        middle, half = 0.5 * t[-1], 0.5 * condition.rest * t[-1]
        t = np.where(t < middle - half, t, np.maximum(middle - half, t - 2.0 * half))
    waves = []
    for _ in range(3):
        periods = random.uniform(*PERIODS, WAVES) / condition.pace
        sizes = periods ** 0.5
        wave = sum(size * np.sin(tau * t / period + random.uniform(0.0, tau))
                   for size, period in zip(sizes, periods, strict=True))
        waves.append(wave / np.sqrt(np.sum(sizes ** 2) / 2.0))
    x, y, turn = waves
    size = np.hypot(x, y)
    tilt = radians(condition.tilt) * np.tanh(0.8 * size)
    middle = 0.5 * (condition.turn_from + condition.turn_to)
    width = 0.5 * (condition.turn_to - condition.turn_from)
    phi = np.radians(middle + width * np.tanh(0.8 * turn))
    # A hand stops where the mechanism does: less tilt where a pose is out of reach.
    poses = workspace_pose(tilt, np.arctan2(y, x), phi)
    for _ in range(30):
        beyond = np.isnan(inverse(poses, rig.geometry, MODE).theta1).any(axis=1)
        if not beyond.any():
            break
        near = np.convolve(beyond, np.ones(201), 'same') > 0
        tilt = np.where(near, 0.9 * tilt, tilt)
        phi = np.where(near, 0.9 * phi + 0.1 * np.radians(middle), phi)
        poses = workspace_pose(tilt, np.arctan2(y, x), phi)
    return poses


def joint_angles(poses: np.ndarray, geometry: Geometry) -> np.ndarray:
    """Return th1A, th1B, th1C, th3A, rad, shape (n, 4)."""
    found = inverse(poses, geometry, MODE)
    return np.column_stack([found.theta1, found.theta3a])


def deviations_of(rig: Rig, angles: np.ndarray) -> np.ndarray:
    """Return what the encoders' harmonics add to joint angles, rad, shape (n, 4)."""
    added = np.empty_like(angles)
    for column, sensor in enumerate(rig.sensors):
        angle = angles[:, column]
        (c1, s1), (c2, s2) = sensor.first_harmonic, sensor.second_harmonic
        added[:, column] = c1 * np.cos(angle) + s1 * np.sin(angle) \
            + c2 * np.cos(2.0 * angle) + s2 * np.sin(2.0 * angle)
    return added


def readings(rig: Rig, condition: Condition, seed: int,
             ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps, raw angles, and the true directions and zeros (rad) of a motion."""
    poses = hand_motion(rig, condition, seed)
    random = np.random.default_rng(seed + 1)
    angles = joint_angles(poses, rig.geometry)
    read = angles + deviations_of(rig, angles)
    read += random.normal(size=read.shape) * radians(condition.noise)
    direction = random.choice((-1, 1), 4)
    zeros = random.uniform(0.0, tau, 4)
    per_turn = 2 ** condition.bits
    counts = np.round((direction * (read + zeros)) * per_turn / tau) % per_turn
    wrong = random.uniform(size=len(counts)) < condition.outliers
    counts[wrong, random.integers(0, 4, wrong.sum())] = random.integers(0, per_turn, wrong.sum())
    stamps = (np.arange(len(counts)) * 1e9 / RATE).astype(np.int64)
    kept = np.ones(len(counts), dtype=bool)
    lost = int(condition.dropout * len(counts))
    kept[len(counts) // 4:len(counts) // 4 + lost] = False
    return stamps[kept], counts[kept] * tau / per_turn, direction, zeros


def truth(calibration: MotionCalibration, rig: Rig, zeros: np.ndarray) -> np.ndarray:
    """Return the true parameter vector of a rig."""
    layout = calibration.layout
    vector = np.zeros(layout.count)
    nominal, built = layout.nominal, rig.geometry
    s = layout.slices
    vector[s['zeros']] = zeros
    vector[s['links']] = [*np.subtract(built.alphas, nominal.alphas),
                          *np.subtract(built.betas, nominal.betas)]
    base = np.array(built.base_axes)
    third = np.array(nominal.base_axes)[2]
    towards, across = layout.base_tangents
    along = base[2] @ third
    vector[s['base axes']] = (np.arctan2(base[1, 0], base[1, 2]) - np.pi / 2.0,
                              base[2] @ towards / along, base[2] @ across / along)
    drawn = np.array(nominal.platform_axes)
    axes = np.array(built.platform_axes)
    off = axes / np.sum(axes * drawn, axis=1, keepdims=True) - drawn
    vector[s['platform axes']] = np.tensordot(layout.platform_tangents, off, 2)
    vector[s['first harmonics']] = [each for sensor in rig.sensors
                                    for each in sensor.first_harmonic]
    vector[s['second harmonics']] = [each for sensor in rig.sensors
                                     for each in sensor.second_harmonic]
    return vector


def tried(condition: Condition, number: int) -> Outcome:
    """Calibrate one rig."""
    rig = random_rig(number, DEVIATIONS)
    stamps, raw, direction, zeros = readings(rig, condition, 100 * number + 7)
    priors = Priors()
    try:
        found = MotionCalibrator(Geometry(), MODE, priors).calibrate(stamps, raw)
    except CalibrationError as error:
        return Outcome(str(error))
    true = truth(found, rig, zeros)
    off = found.vector - true
    off[:4] = np.angle(np.exp(1j * off[:4]))
    directions = tuple(direction.tolist()) == found.direction
    right = float(np.abs(off[:4]).max())
    # The error on another motion over the same part of the workspace, without noise.
    poses = hand_motion(rig, replace(condition, seconds=20.0, rest=0.0), CHECK_SEED + number)[::20]
    angles = joint_angles(poses, rig.geometry)
    turned = angles + deviations_of(rig, angles) + zeros
    model = MotionModel(found.layout, MODE, found.noise)
    estimated = model.orientations(turned, found.vector)
    vectors = aligned(estimated, poses)
    error = float(np.sqrt(np.mean(np.sum(vectors ** 2, axis=1))))
    changes = aligned_changes(model, poses, true)
    predicted = float(np.sqrt(np.einsum(
        'nip,pq,niq->', changes, found.covariance, changes) / len(changes)))
    distance = float(np.mean((off / found.deviations) ** 2))
    return Outcome(None, right < radians(2.0), directions, degrees(error), degrees(predicted),
                   distance, degrees(float(found.bias.max())))


def aligned(estimated: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return the rotation vectors between orientations, one rotation of either frame taken off."""
    base, platform = np.eye(3), np.eye(3)
    for _ in range(30):
        base = nearest(np.einsum('nij,nkj->ik', true, estimated @ platform))
        platform = nearest(np.einsum('nji,njk->ik', base @ estimated, true))
    return rotation_vectors(base @ estimated @ platform @ true.swapaxes(1, 2))


def nearest(matrix: np.ndarray) -> np.ndarray:
    """Return the rotation nearest to a matrix."""
    left, _, right = np.linalg.svd(matrix)
    return left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right


def wrong(outcome: Outcome) -> bool:
    """Return whether a calibration was written that is not what it says."""
    return outcome.refused is None and (
        not outcome.zeros or not outcome.directions
        or outcome.error > RIGHT_SIGMAS * outcome.predicted)


def row(condition: Condition, outcomes: Sequence[Outcome]) -> str:
    """Return a row of the table."""
    written = [each for each in outcomes if each.refused is None]
    refused = len(outcomes) - len(written)
    if not written:
        return f'| {condition.name} | {refused} | 0 | - | - | - | - |'
    error = [each.error for each in written]
    return (f'| {condition.name} | {refused} | {sum(map(wrong, outcomes))} '
            f'| {np.median(error):.3f}, {max(error):.3f} '
            f'| {np.median([each.predicted for each in written]):.3f} '
            f'| {np.mean([each.distance for each in written]):.2f} '
            f'| {np.median([each.bias for each in written]):.2f}, '
            f'{max(each.bias for each in written):.2f} |')


def main() -> int:
    """Print the table; 1 if a calibration is wrong without a word."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rigs', type=int, default=RIGS, help='number of rigs (default: 30)')
    parser.add_argument('--first', type=int, default=0, help='seed of the first rig')
    parser.add_argument('--condition', type=int, action='append',
                        help='number of a condition from 0 on (default: all)')
    options = parser.parse_args()
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    chosen = [CONDITIONS[number] for number in options.condition or range(len(CONDITIONS))]
    print('| motion and encoders | refused | wrong | error, deg: median, largest | predicted, deg '
          '| squared error over variance | bias_deg: median, largest |')
    print('|---|---|---|---|---|---|---|')
    failed = 0
    with ProcessPoolExecutor() as pool:
        for condition in chosen:
            numbers = range(options.first, options.first + options.rigs)
            outcomes = []
            for number, outcome in zip(numbers, pool.map(
                    tried, [condition] * len(numbers), numbers), strict=True):
                outcomes.append(outcome)
                print(f'{condition.name}, rig {number}: {outcome}', file=sys.stderr, flush=True)
            print(row(condition, outcomes), flush=True)
            failed += sum(map(wrong, outcomes))
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main())
