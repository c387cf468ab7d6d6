# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Searches of `benchmarks.integrity`: poses that check each sensor, a long motion, least jumps."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
import os
from typing import Any, NamedTuple

from benchmarks.integrity_records import Runner
from benchmarks.integrity_runs import CANCEL, encoders, errors, joint_angles, motion, stamps
import numpy as np
from paper.verdicts import COLUMN
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics import (
    estimate_sample,
    Geometry,
    inverse,
    quaternion_from_matrix,
    UsedSensors,
    workspace_pose,
)
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.parameters.fkm import FKM_SETTINGS, limits_from, sigma_from
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision import supervise
from spm_haptic_master.supervision.orientation_state import received_state, STARTING
from spm_haptic_master.supervision.protection import integrity, MISSED_DETECTION

# Samples of one piece of the long run (20 s at 1 kHz), and fewest of a reachable stretch.
PIECE, STRETCH = 20_000, 2000

Array = Any


def coverage_rows() -> Iterator[str]:
    """Yield the share of poses at which each sensor is checked, by alert limit."""
    values = complete(FKM_SETTINGS, {})
    sensors, bias = UsedSensors(sigma_from(values)), tuple(np.radians(values['bias_deg']).tolist())
    reach = (limits_from(values).threshold() + MISSED_DETECTION) / np.sqrt(20.0)
    worths = []
    for tilt, azimuth, phi in product(range(0, 21, 5), range(0, 360, 30), range(0, 96, 5)):
        rotation = workspace_pose(*np.radians([tilt, azimuth, phi]))
        try:
            joints = inverse(rotation)
            found = estimate_sample(
                (*joints.theta1.tolist(), float(joints.theta3a)),
                sensors,
                Geometry(),
                tuple(quaternion_from_matrix(rotation).tolist()),
            )
        except SpmError:
            continue
        worths.append(integrity(found, bias, (1.0,) * 4))
    healthy_deg = np.degrees([worth.healthy for worth in worths])
    levels_deg = np.degrees([worth.parts(reach) for worth in worths])
    yield (
        '| alert_limit_deg | published | '
        + ' | '.join(f'{name} checked' for name in JOINT_NAMES)
        + f' | {COLUMN} |'
    )
    yield '|---' * 7 + '|'
    for limit in (0.3, 0.5, 1.0, 2.0):
        shares = [(healthy_deg <= limit).mean(), *(levels_deg <= limit).mean(axis=0)]
        yield (
            f'| {limit:g} | '
            + ' | '.join(f'{100.0 * share:.0f} %' for share in shares)
            + f' | published {"everywhere" if shares[0] == 1.0 else "in part"} |'
        )
    yield ''
    yield (
        f'{len(worths)} reachable poses, tilt 0 .. 20 deg, phi 0 .. 95 deg, default sigma_deg '
        f'and bias_deg; the healthy part of the level is {healthy_deg.max():.2f} deg at most.'
    )


class Long(NamedTuple):
    """Sums over healthy samples of the reachable workspace."""

    samples: int
    published: int
    alarms: int
    beyond: int
    worst_deg: float
    worst_ratio: float


def wandering(seed: int) -> tuple[Array, Array]:
    """
    Return orientations and joint angles of a random motion that a human can make.

    Tilt to 30 deg, phi from -60 to 100 deg; the longest stretch that the device reaches within the
    human motion limits of the joints.
    """
    rng = np.random.default_rng(seed)

    def smooth(low: float, high: float, period: float) -> Array:
        knots = rng.uniform(low, high, int(PIECE * 1e-3 / period) + 4)
        x = np.linspace(0.0, len(knots) - 2.0, PIECE)
        i = np.minimum(x.astype(int), len(knots) - 2)
        weight = 0.5 * (1.0 - np.cos(np.pi * (x - i)))
        return knots[i] * (1.0 - weight) + knots[i + 1] * weight

    across, along = smooth(-30.0, 30.0, 2.0), smooth(-30.0, 30.0, 2.3)
    tilt = np.minimum(np.hypot(across, along), 30.0)
    rotations = workspace_pose(
        np.radians(tilt), np.arctan2(along, across), np.radians(smooth(-60.0, 100.0, 2.0))
    )
    angles = joint_angles(rotations)
    limits = complete(FKM_SETTINGS, {})
    fine = np.isfinite(angles).all(axis=1)
    steps = np.abs(np.diff(np.where(fine[:, None], angles, 0.0), axis=0)).max(axis=1)
    fine[1:] &= steps < 1e-3 * limits['joint_speed']
    curve = np.abs(np.diff(np.where(fine[:, None], angles, 0.0), n=2, axis=0)).max(axis=1)
    fine[2:] &= curve < 1e-6 * limits['joint_acceleration']
    edges = np.flatnonzero(np.diff(np.concatenate([[0], fine, [0]]))).reshape(-1, 2)
    if not len(edges):
        return rotations[:0], angles[:0]
    begin, end = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    return rotations[begin:end], angles[begin:end]


def long_piece(seed: int) -> Long:
    """Return the sums of one piece."""
    rotations, angles = wandering(seed)
    if len(angles) < STRETCH:
        return Long(0, 0, 0, 0, 0.0, 0.0)
    result = supervise(stamps(len(angles)), encoders(angles, seed=seed))
    error = errors(result, rotations)
    out = result.published
    silences = [
        state.why
        for state in (received_state(text) for _, text in result.state)
        if not state.publishes and state != STARTING
    ]
    alarms = sum('protection level' not in why and 'not determined' not in why for why in silences)
    ratio = error[out] / result.protection_level[out]
    return Long(
        len(out),
        int(out.sum()),
        alarms,
        int((ratio > 1.0).sum()),
        float(error[out].max(initial=0.0)),
        float(ratio.max(initial=0.0)),
    )


def long_run(seconds: float, runner: Runner) -> Long:
    """Return the sums of random motions that are as long together, s, at least."""
    wanted = round(seconds * 1000.0)
    total = Long(0, 0, 0, 0, 0.0, 0.0)
    seed = 1
    while total.samples < wanted:
        batch = range(seed, seed + 4 * (os.cpu_count() or 1))
        seed = batch.stop
        for piece in runner.results(long_piece, batch):
            total = Long(
                *(a + b for a, b in zip(total[:4], piece[:4], strict=True)),
                *(max(a, b) for a, b in zip(total[4:], piece[4:], strict=True)),
            )
        runner.show(f'{total.samples / 1e6:.2f} of {wanted / 1e6:.2f} million healthy samples')
    return total


def jump_rows(runner: Runner) -> Iterator[str]:
    """Yield the least jumps that are always detected where no parity shows them, by rate."""
    rates, missing = (100.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0), (0, 1, 5)
    tasks = [
        (rate, lost, pair)
        for rate in rates
        for lost, pair in (*((lost, False) for lost in missing), (0, True))
    ]
    found = runner.results(least_jump, tasks)
    yield (
        '| rate, Hz | '
        + ' | '.join(
            f'th3A at the singularity, {lost} samples lost before it, deg' for lost in missing
        )
        + ' | th1A and th1B that cancel, deg |'
    )
    yield '|---' * (len(missing) + 2) + '|'
    for rate in rates:
        yield (
            f'| {rate:g} | '
            + ' | '.join(f'{next(found):.2f}' for _ in range(len(missing) + 1))
            + ' |'
        )


def least_jump(task: tuple[float, int, bool]) -> float:
    """Return the least jump, deg, above which all of five in both directions are detected."""
    rate, lost, pair = task
    begin, count = max(20, round(0.1 * rate)), max(40, round(0.15 * rate))
    true = joint_angles(motion('rest' if pair else 'singular', count / rate, rate))

    def detected(step: float, seed: int) -> bool:
        angles = true.copy()
        if pair:
            angles[begin:, :2] += np.radians(step) * CANCEL
        else:
            angles[begin:, 3] += np.radians(step)
        keep = np.ones(len(angles), bool)
        keep[begin - lost : begin] = False
        result = supervise(stamps(len(angles), rate)[keep], encoders(angles, seed=seed)[keep])
        return not result.published[-1]

    low, high = 0.1, 60.0
    while high > 1.02 * low:
        middle = np.sqrt(low * high)
        fine = all(detected(sign * middle, seed) for seed in range(5) for sign in (-1.0, 1.0))
        low, high = (low, middle) if fine else (middle, high)
    return high
