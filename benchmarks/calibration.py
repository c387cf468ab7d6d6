# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibrates simulated rigs of which nothing is known from free motion, and prints what comes out.

Links and axes of each rig are off by 0.3 deg, first harmonics by 0.12 deg, second ones by 0.015
deg (one standard deviation), zero counts and directions are anywhere. A rig is right if its
orientations are, on another motion and without noise; wrong without a word if the calibration was
written and its error is more than the file's figures allow, of the orientation or of any sensor at
any pose of the region that the file states. Files are refused as `calibrate --motion` does, with
the default parameters of fkm; the figures of these are what a larger alert limit would write.

With `--results FILE` each rig becomes a line of that file as soon as it is done, the rigs in it
are not repeated, and the table has all of them.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
import json
from math import degrees, radians
import os
from pathlib import Path
import sys

import numpy as np
from spm_haptic_master.calibration.motion.calibration import MotionCalibration
from spm_haptic_master.calibration.motion.coverage import aligned_changes, WORKSPACE
from spm_haptic_master.calibration.motion.free_motion import calibrate_motion
from spm_haptic_master.calibration.motion.model import Layout
from spm_haptic_master.calibration.motion.motion_file import Origin
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics.rotations import wrapped
from spm_haptic_master.simulation.rig import random_rig, Rig, Tolerances
from spm_haptic_master.tools.calibration_verdict import FkmValues, published_share, supported
from spm_haptic_master.validation.alignment import nearest_rotation, rotation_vectors

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from simulated_hand import (  # noqa: E402, I100
    Condition,
    deviations_of,
    hand_motion,
    joint_angles,
    readings,
)

# Deviations of the rigs.
DEVIATIONS = Tolerances(radians(0.3), radians(0.3), radians(0.12), radians(0.015))
# Number of rigs of each condition, and of each poor motion.
RIGS, POOR_RIGS = 30, 10
# Seed of the motion that the result is tried on, apart from those of the rigs.
CHECK_SEED = 9_000_000
# Standard deviations of the predicted error that a right result may be off by.
RIGHT_SIGMAS = 3.5
# Largest error of a sensor over its bound.
RIGHT_BOUND = 1.3

USUAL = Condition('90 s, tilt 20 deg, 0.04 deg, 14 bits')
CONDITIONS = (
    USUAL,
    replace(USUAL, name='30 s', seconds=30.0),
    replace(
        USUAL, name='tilt 10 deg, self-rotation 30 .. 70', tilt=10.0, turn_from=30.0, turn_to=70.0
    ),
    replace(USUAL, name='noise 0.1 deg', noise=0.1),
    replace(USUAL, name='12 bits', bits=12),
    replace(
        USUAL,
        name='5 % outliers, dropout of 5 s, 20 s at rest',
        outliers=0.05,
        dropout=0.055,
        rest=0.22,
    ),
    replace(USUAL, name='slower by 2.5, clipped at 14 deg', pace=0.4, tilt=14.0),
    replace(USUAL, name='poor: tilt 5 deg', tilt=5.0),
    replace(USUAL, name='poor: no self-rotation', turn_from=44.0, turn_to=46.0),
    replace(USUAL, name='poor: 15 s', seconds=15.0),
    replace(USUAL, name='poor: tilted to one side only', one_sided=True),
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one rig."""

    # Why nothing was written. What a larger alert limit would have written has figures, too.
    refused: str | None
    zeros: bool = True  # whether they are right
    directions: bool = True  # whether they are right
    error: float = 0.0  # of the orientation on another motion, frames aligned, deg rms
    predicted: float = 0.0  # the same as predicted
    distance: float = 0.0  # mean squared error of the parameters over its variance (unit 1)
    bias: float = 0.0  # largest bound of a sensor's error, deg; 0 where there is no calibration
    exceeded: float = 0.0  # largest error of a sensor over its bound, over its region (unit 1)
    parity_exceeded: float = 0.0  # largest parity by these errors over its bound, there (unit 1)
    everywhere: bool = True  # whether that region is the workspace


def truth(calibration: MotionCalibration, rig: Rig, zeros: np.ndarray) -> np.ndarray:
    """Return the true parameter vector of a rig."""
    layout = calibration.layout
    vector = np.zeros(layout.count)
    nominal, built = layout.nominal, rig.geometry
    s = layout.slices
    vector[s['zeros']] = zeros
    vector[s['links']] = [
        *np.subtract(built.alphas, nominal.alphas),
        *np.subtract(built.betas, nominal.betas),
    ]
    base = np.array(built.base_axes)
    third = np.array(nominal.base_axes)[2]
    # The directions of Z1C that `Layout.geometry` takes: towards Z1A, and across.
    first = np.array(nominal.base_axes)[0]
    towards = first - (first @ third) * third
    towards /= np.linalg.norm(towards)
    across = np.cross(third, towards)
    along = base[2] @ third
    vector[s['base axes']] = (
        np.arctan2(base[1, 0], base[1, 2]) - np.pi / 2.0,
        base[2] @ towards / along,
        base[2] @ across / along,
    )
    drawn = np.array(nominal.platform_axes)
    axes = np.array(built.platform_axes)
    off = axes / np.sum(axes * drawn, axis=1, keepdims=True) - drawn
    vector[s['platform axes']] = np.tensordot(layout.platform_tangents, off, 2)
    vector[s['first harmonics']] = [
        each for sensor in rig.sensors for each in sensor.first_harmonic
    ]
    vector[s['second harmonics']] = [
        each for sensor in rig.sensors for each in sensor.second_harmonic
    ]
    return vector


def tried(condition: Condition, number: int) -> Outcome:
    """Calibrate one rig."""
    rig = random_rig(number, DEVIATIONS)
    stamps, raw, direction, zeros = readings(rig, condition, 100 * number + 7)
    refused = None
    try:
        found = calibrate_motion(Layout(4), stamps, raw)
    except CalibrationError as reason:
        return Outcome(str(reason))
    try:
        fkm = FkmValues({}, Origin('', 'simulated', '', '', (2**condition.bits,) * 4, {}))
        found, _ = supported(found, fkm)
        published_share(found, (stamps, raw), fkm, lambda text, share: None)
    except CalibrationError as reason:
        refused = str(reason)
    true = truth(found, rig, zeros)
    off = found.vector - true
    off[:4] = wrapped(off[:4])
    directions = tuple(direction.tolist()) == found.direction
    right = float(np.abs(off[:4]).max())
    # The error on another motion over the same part of the workspace, without noise.
    poses = hand_motion(rig, replace(condition, seconds=20.0, rest=0.0), CHECK_SEED + number)[::20]
    angles = joint_angles(poses, rig)
    turned = angles + deviations_of(rig, angles) + zeros
    model = found.model
    estimated = model.orientations(turned, found.vector)
    vectors = aligned(estimated, poses)
    error = float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
    changes = aligned_changes(model, poses, true)
    predicted = float(
        np.sqrt(np.einsum('nip,pq,niq->', changes, found.covariance, changes) / len(changes))
    )
    distance = float(np.mean((off / found.deviations) ** 2))
    return Outcome(
        refused,
        right < radians(2.0),
        directions,
        degrees(error),
        degrees(predicted),
        distance,
        degrees(float(found.bias.max())),
        exceeded(found, rig, zeros),
        parity_exceeded(found, rig, zeros),
        found.region == WORKSPACE,
    )


def exceeded(found: MotionCalibration, rig: Rig, zeros: np.ndarray) -> float:
    """Return the largest error of a sensor over its bound, over the region of a file."""
    model = found.model
    angles = joint_angles(found.region.poses(model, found.vector), rig)
    angles = angles[np.isfinite(angles).all(axis=1)]
    corrected = model.corrected(angles + deviations_of(rig, angles) + zeros, found.vector)
    errors = np.abs(wrapped(corrected - angles))
    return float((errors / found.bias).max())


def parity_exceeded(found: MotionCalibration, rig: Rig, zeros: np.ndarray) -> float:
    """Return the largest parity without noise over its bound, over the region of a file."""
    # With a noise of 1 rad the parity is the length of the part that no rotation explains.
    model = replace(found.model, sigma=np.ones(found.layout.sensors))
    angles = joint_angles(found.region.poses(model, found.vector), rig)
    angles = angles[np.isfinite(angles).all(axis=1)]
    turned = angles + deviations_of(rig, angles) + zeros
    there = model.linearised(turned, model.orientations(turned, found.vector), found.vector)
    return float(np.linalg.norm(there.parity, axis=1).max() / found.parity_bias)


def aligned(estimated: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return the rotation vectors between orientations, one rotation of either frame taken off."""
    base, platform = np.eye(3), np.eye(3)
    for _ in range(30):
        base = nearest_rotation(np.einsum('nij,nkj->ik', true, estimated @ platform))
        platform = nearest_rotation(np.einsum('nji,njk->ik', base @ estimated, true))
    return rotation_vectors(base @ estimated @ platform @ true.swapaxes(1, 2))


def wrong(outcome: Outcome) -> bool:
    """Return whether a calibration was written, or a bound found, that is not what it says."""
    return (
        max(outcome.exceeded, outcome.parity_exceeded) > RIGHT_BOUND
        or outcome.refused is None
        and (
            not outcome.zeros
            or not outcome.directions
            or outcome.error > RIGHT_SIGMAS * outcome.predicted
        )
    )


def row(condition: Condition, outcomes: Sequence[Outcome]) -> str:
    """Return a row of the table."""
    refused = sum(each.refused is not None for each in outcomes)
    part = sum(each.refused is None and not each.everywhere for each in outcomes)
    begin = (
        f'| {condition.name} | {len(outcomes)} | {refused} | {part} | {sum(map(wrong, outcomes))} '
    )
    found = [each for each in outcomes if each.bias]
    if not found:
        return f'{begin}| - | - | - | - | - | - |'
    error = [each.error for each in found]
    return (
        f'{begin}| {np.median(error):.3f}, {max(error):.3f} '
        f'| {np.median([each.predicted for each in found]):.3f} '
        f'| {np.mean([each.distance for each in found]):.2f} '
        f'| {np.median([each.bias for each in found]):.2f}, '
        f'{max(each.bias for each in found):.2f} '
        f'| {max(each.exceeded for each in found):.2f} '
        f'| {max(each.parity_exceeded for each in found):.2f} |'
    )


def rigs_of(condition: Condition) -> int:
    """Return how many rigs a row of the table has."""
    return POOR_RIGS if condition.name.startswith('poor') else RIGS


def read_results(path: Path | None) -> dict[tuple[str, int], Outcome]:
    """Return the outcomes of a file of results by condition and rig; none if it does not exist."""
    if path is None or not path.exists():
        return {}
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    return {(line.pop('condition'), line.pop('rig')): Outcome(**line) for line in lines}


def run(
    chosen: Sequence[Condition], first: int, rigs: int | None, workers: int, results: Path | None
) -> dict[tuple[str, int], Outcome]:
    """Return the outcomes by condition and rig: one rig of every condition, then the next."""
    outcomes = read_results(results)
    tasks = [
        (condition, number)
        for number in range(first, first + (rigs or RIGS))
        for condition in chosen
        if number < first + (rigs or rigs_of(condition))
        and (condition.name, number) not in outcomes
    ]
    with ProcessPoolExecutor(workers) as pool:
        for (condition, number), outcome in zip(
            tasks, pool.map(tried, *zip(*tasks, strict=True)) if tasks else (), strict=True
        ):
            outcomes[condition.name, number] = outcome
            line = json.dumps({'condition': condition.name, 'rig': number} | asdict(outcome))
            print(line, file=sys.stderr, flush=True)
            if results is not None:
                with results.open('a') as file:
                    file.write(f'{line}\n')
    return outcomes


def main() -> int:
    """Print the table; 1 if a calibration is wrong without a word."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        '--rigs',
        type=int,
        help=f'number of rigs (default: {RIGS}, {POOR_RIGS} of each poor motion)',
    )
    parser.add_argument('--first', type=int, default=0, help='seed of the first rig')
    parser.add_argument(
        '--condition',
        type=int,
        action='append',
        help='number of a condition from 0 on (default: all)',
    )
    parser.add_argument('--results', type=Path, help='file of the rigs that are done')
    parser.add_argument(
        '--workers',
        type=int,
        default=os.cpu_count(),
        help='number of processes (default: one for each core)',
    )
    options = parser.parse_args()
    chosen = [CONDITIONS[number] for number in options.condition or range(len(CONDITIONS))]
    outcomes = run(chosen, options.first, options.rigs, options.workers, options.results)
    print(
        '| motion and encoders | rigs | refused | for its region only | wrong | error, deg: '
        'median, largest | predicted, deg | squared error over variance | bias_deg: median, '
        'largest | largest error of a sensor over its bias '
        '| largest parity over its bound |'
    )
    print('|---|---|---|---|---|---|---|---|---|---|---|')
    failed = 0
    for condition in chosen:
        own = [outcome for (name, _), outcome in outcomes.items() if name == condition.name]
        print(row(condition, own))
        failed += sum(map(wrong, own))
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main())
