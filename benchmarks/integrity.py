# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the supervision publishes of healthy and of faulty sensors, and how wrong it is.

Simulated readings go through `supervise`, which is what fkm runs, with its default parameters.
A wrong orientation is one that is off by more than its protection level; it is undeclared while
the faulty sensor counts as checked by the others.

Run it with the tests' requirements installed (make integrity ARGS='--seconds 1000'):
python -m benchmarks.integrity [--seconds S] [FILE.md]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import groupby, product
import os
from pathlib import Path
import sys
import time
from typing import Any, NamedTuple

import numpy as np
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.kinematics import (
    estimate_sample,
    Geometry,
    inverse,
    quaternion_from_matrix,
    workspace_pose,
)
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.settings import complete
from spm_haptic_master.supervision import supervise
from spm_haptic_master.supervision.protection import integrity, MISSED_DETECTION
from spm_haptic_master.supervision.settings import FKM_SETTINGS, limits_from, sigma_from
from spm_haptic_master.validation.parity_map import nominal_bias, parity_map, regions

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'supervision'))

from device import encoders, errors, joint_angles, motion, stamps  # noqa: E402, I100

# Samples of one piece of the long run (20 s at 1 kHz), and fewest of a reachable stretch.
PIECE, STRETCH = 20_000, 2000
# Samples after which a start is over: 0.1 s.
STARTED = 100
# Beginning of a fault (s), and the length of its run (s).
ONSET, LENGTH = 1.5, 4.0
# Motions of the fault matrix, by column.
PLACES = {'centre': 'rest', 'rim': 'rim', 'singular': 'singular', 'crossing': 'crossing',
          'moving': 'sweep'}
# Tolerances of a calibrated mechanism: links and axes, and harmonics of the encoders (deg).
TOLERANCE, HARMONIC = 0.05, 0.03

Array = Any


# Healthy sensors -----------------------------------------------------------------------------

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
        np.radians(tilt), np.arctan2(along, across), np.radians(smooth(-60.0, 100.0, 2.0)))
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
    alarms = sum(text.startswith('silent') and 'protection level' not in text
                 and 'not determined' not in text for _, text in result.state)
    ratio = error[out] / result.protection_level[out]
    return Long(len(out), int(out.sum()), alarms, int((ratio > 1.0).sum()),
                float(error[out].max(initial=0.0)), float(ratio.max(initial=0.0)))


def long_run(seconds: float, pool: ProcessPoolExecutor) -> Iterator[str]:
    """Yield the rows of the long healthy run."""
    wanted = round(seconds * 1000.0)
    total = Long(0, 0, 0, 0, 0.0, 0.0)
    seed = 1
    while total.samples < wanted:
        batch = range(seed, seed + 4 * (os.cpu_count() or 1))
        seed = batch.stop
        for piece in pool.map(long_piece, batch):
            total = Long(*(a + b for a, b in zip(total[:4], piece[:4], strict=True)),
                         *(max(a, b) for a, b in zip(total[4:], piece[4:], strict=True)))
        show(f'{total.samples / 1e6:.2f} of {wanted / 1e6:.2f} million healthy samples')
    yield ('| samples | published | false alarms | beyond their level | largest error, deg '
           '| largest error over its level |')
    yield '|---|---|---|---|---|---|'
    yield (f'| {total.samples} | {100.0 * total.published / total.samples:.2f} % | {total.alarms} '
           f'| {total.beyond} | {total.worst_deg:.2f} | {total.worst_ratio:.2f} |')


@dataclass(frozen=True, slots=True)
class Condition:
    """
    A healthy device under one condition.

    Attributes
    ----------
    label : str
        Row of the table.
    kinds : tuple of str
        Motions.
    noise, bits, rate, hold, jitter, loss : number
        Noise (deg), resolution (bit), rate (Hz), samples that repeat a reading, largest error of
        a stamp (s), share of lost samples.
    tolerance : float
        Errors of links and axes, 1 sigma, deg; harmonics in proportion.
    fastest : bool
        Whether the motion is sped up until a joint moves at 15 rad/s.

    """

    label: str
    kinds: tuple[str, ...]
    noise: float = 0.04
    bits: int = 14
    rate: float = 1000.0
    hold: int = 1
    jitter: float = 0.0
    loss: float = 0.0
    tolerance: float = 0.0
    fastest: bool = False


MOTIONS = ('rest', 'singular', 'crossing', 'tremor', 'sweep', 'fast')
CONDITIONS = (
    *(Condition(f'{bits} bit, noise {noise:g} deg', MOTIONS, noise, bits)
      for bits in (12, 14, 16, 17) for noise in (0.0, 0.005, 0.04, 0.08)),
    Condition('motion to 15 rad/s', ('fast',), fastest=True),
    *(Condition(f'{rate:g} Hz', MOTIONS[:-1], rate=rate) for rate in (100.0, 250.0, 4000.0)),
    Condition('stamps off by 300 us', MOTIONS, jitter=3e-4),
    Condition('10 % of the samples lost', MOTIONS, loss=0.1),
    Condition('sensors at 250 Hz on a bus at 1 kHz', MOTIONS[:-1], hold=4),
    Condition(f'links and axes off by {TOLERANCE} deg, harmonics {HARMONIC} deg, bias_deg by '
              '`supervise`', MOTIONS, tolerance=TOLERANCE),
)


def as_built(seed: int, tolerance: float) -> Geometry:
    """Return a mechanism whose links and axes are off by normal deviates, deg (1 sigma)."""
    rng = np.random.default_rng(seed)
    nominal = Geometry()

    def off(axes: Array) -> Array:
        moved = np.array(axes) + np.radians(tolerance) * rng.normal(size=(3, 3))
        return moved / np.linalg.norm(moved, axis=1, keepdims=True)

    return Geometry.from_axes(
        off(nominal.base_axes), off(nominal.platform_axes),
        nominal.alpha + np.radians(tolerance) * rng.normal(size=3),
        nominal.beta + np.radians(tolerance) * rng.normal(size=3))


class AsBuilt:
    """The joint angles of a mechanism as built, its zeros set at the centre of the workspace."""

    def __init__(self, seed: int, tolerance: float, harmonic: float) -> None:
        rng = np.random.default_rng(seed + 1000)
        self._geometry = as_built(seed, tolerance)
        self._harmonics = np.radians(harmonic) * rng.normal(size=(2, 4))
        self._zeros = np.zeros(4)
        centre = workspace_pose(0.0, 0.0, np.radians([20.0]))
        self._zeros = (self.angles(centre) - joint_angles(centre))[0]

    def angles(self, rotations: Array) -> Array:
        """Return th1A, th1B, th1C, th3A as its encoders have them, rad, (n, 4)."""
        joints = inverse(rotations, self._geometry)
        angles = np.column_stack([joints.theta1, joints.theta3a])
        return angles + self._harmonics[0] * np.cos(angles) \
            + self._harmonics[1] * np.sin(angles) - self._zeros


def readings(condition: Condition, kind: str, angles_of: Callable[[Array], Array],
             seed: int) -> tuple[Array, Array, Array]:
    """Return orientations, stamps and readings of a motion."""
    rng = np.random.default_rng(seed)
    rotations = motion(kind, 4.0 if condition.rate <= 1000.0 else 2.0, condition.rate)
    if condition.fastest:
        speed = np.abs(np.diff(joint_angles(rotations), axis=0)).max() * condition.rate
        rotations = motion(kind, 4.0, condition.rate * speed / 15.0)
    angles = angles_of(rotations)
    kept = np.arange(len(angles)) // condition.hold * condition.hold
    angles = encoders(angles, condition.noise, condition.bits, seed)[kept]
    times = stamps(len(angles), condition.rate)
    if condition.jitter:
        times = times + np.round(condition.jitter * 1e9 * rng.uniform(-1.0, 1.0, len(times))
                                 ).astype(np.int64)
    keep = rng.random(len(angles)) >= condition.loss
    return rotations[keep], times[keep], angles[keep]


def healthy(condition: Condition) -> str:
    """Return the row of one condition."""
    out = total = 0
    worst = ratio = 0.0
    bias = []
    for seed, kind in enumerate(condition.kinds):
        angles_of: Callable[[Array], Array] = joint_angles
        parameters: dict[str, Any] = {}
        if condition.tolerance:
            built = AsBuilt(seed, condition.tolerance, HARMONIC)
            angles_of = built.angles
            parameters['bias_deg'] = [calibrated_bias(built)] * 4
            bias.append(parameters['bias_deg'][0])
        rotations, times, angles = readings(condition, kind, angles_of, seed)
        result = supervise(times, angles, **parameters)
        error = errors(result, rotations)
        started = result.published[STARTED:]
        out, total = out + int(started.sum()), total + len(started)
        known = result.published
        worst = max(worst, float(error[known].max(initial=0.0)))
        ratio = max(ratio, float(
            (error[known] / result.protection_level[known]).max(initial=0.0)))
    label = condition.label + (f' ({min(bias):.2f} .. {max(bias):.2f})' if bias else '')
    return f'| {label} | {100.0 * out / total:.2f} % | {worst:.2f} | {ratio:.2f} |'


def calibrated_bias(built: AsBuilt) -> float:
    """Return the nominal bias that `supervise` proposes for a device, deg."""
    rotations = motion('sweep', 20.0)
    angles = encoders(built.angles(rotations))
    found = parity_map(angles, (np.radians(0.04),) * 4, Geometry(), RIG_WORKING_MODE)
    table = regions(found, np.ones(len(angles), bool), np.ones(len(angles)))
    proposed = nominal_bias(table)
    return float(0.01 * np.ceil(100.0 * (proposed or 0.0)))


# Faulty sensors ------------------------------------------------------------------------------

Change = Callable[[Array, Array], Array]


def fault(name: str, value: float, sensor: int, seed: int) -> Change:
    """Return what a fault makes of angles (n, 4), rad, at times s."""
    def change(angles: Array, t: Array) -> Array:
        angles = angles.copy()
        after = t >= ONSET
        if name == 'step':
            angles[after, sensor] += np.radians(value)
        elif name == 'ramp':
            angles[after, sensor] += np.radians(value) * (t[after] - ONSET)
        elif name == 'scale':
            angles[:, sensor] *= value
        elif name == 'offset before the start':
            angles[:, sensor] += np.radians(value)
        elif name == 'noise':
            rng = np.random.default_rng(seed + 77)
            angles[after, sensor] += np.radians(value) * rng.normal(size=int(after.sum()))
        elif name == 'two that cancel':
            angles[after, :2] += np.radians(value) * CANCEL
        return angles
    return change


# Jumps of th1A and th1B that leave the parity at the centre as it is, over that of th1A (unit 1).
CANCEL = np.array([1.0, -0.935])
# Lowest rate at which two that jump by 2 deg are detected (Hz): below, a human may move a joint as
# far from one sample to the next.
PAIR_RATE = 250.0
FAULTS = (
    *(('step', value, 'deg') for value in (0.3, 0.5, 1.0, 5.0)),
    *(('ramp', value, 'deg/s') for value in (0.1, 1.0, 10.0, 100.0)),
    ('stuck', 0.0, ''),
    *(('scale', value, '') for value in (1.01, 1.1, 2.0)),
    ('noise', 0.08, 'deg'),
    *(('offset before the start', value, 'deg') for value in (2.0, 20.0)),
    ('two that cancel', 2.0, 'deg'),
)
# Noise (deg), resolution (bit) and rate (Hz) of the encoders in the fault matrix.
ENCODERS = ((0.04, 14, 1000.0), (0.0, 16, 1000.0), (0.005, 17, 1000.0), (0.04, 12, 1000.0),
            (0.04, 14, 250.0), (0.04, 14, 4000.0), (0.04, 14, 100.0))
# The same of five and six sensors.
MORE_ENCODERS = ENCODERS[0], ENCODERS[2], ENCODERS[4]


class Outcome(NamedTuple):
    """
    Outcome of one fault in one run.

    Attributes
    ----------
    undeclared : float
        Longest time off by more than the level with the faulty sensor checked, s, over the time
        to alert.
    declared_deg : float
        Largest error while the faulty sensor is declared unchecked, deg.
    silent : bool
        Whether the run ends silent.
    pause : float
        Longest time without an orientation after the start, s, where the run does not end silent.
    excluded : str
        Sensor that is excluded at the end.

    """

    undeclared: float
    declared_deg: float
    silent: bool
    pause: float
    excluded: str


Task = tuple[str, float, int, str, int]


def faulty(task: Task) -> list[Outcome]:
    """Return the outcomes of a fault of a sensor in a motion, one for each kind of encoders."""
    name, value, sensor, kind, sensors = task
    outcomes = []
    for seed, (noise, bits, rate) in enumerate(ENCODERS if sensors == 4 else MORE_ENCODERS):
        if name == 'two that cancel' and rate < PAIR_RATE:
            continue
        rotations = motion(kind, LENGTH, rate)
        t = np.arange(len(rotations)) / rate
        true = joint_angles(rotations, sensors)
        angles = encoders(fault(name, value, sensor, seed)(true, t), noise, bits, seed)
        if name == 'stuck':
            angles[t >= ONSET, sensor] = angles[np.flatnonzero(t >= ONSET)[0], sensor]
        result = supervise(stamps(len(angles), rate), angles)
        error, out = errors(result, rotations), result.published
        known = out & (result.unchecked[:, sensor] > 0.0)
        last = result.state[-1][1].removeprefix('degraded: ')
        outcomes.append(Outcome(
            longest((error > result.protection_level) & (result.unchecked[:, sensor] == 0.0))
            / rate / max(0.02, 10.0 / rate),
            float(error[known].max(initial=0.0)), not out[-1],
            longest(~out[t >= 0.1]) / rate if out[-1] else 0.0,
            last.removesuffix(' excluded') if last.endswith(' excluded') else ''))
    return outcomes


def longest(flags: Array) -> int:
    """Return the most samples in a row that are flagged."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags, [0]])))
    return int(max(edges[1::2] - edges[::2], default=0))


def cases(sensors: int) -> list[tuple[str, float, str, int]]:
    """Return the faults and the sensors that have them: name, value, unit, sensor."""
    return [(name, value, unit, sensor) for name, value, unit in FAULTS
            for sensor in (range(sensors) if name != 'two that cancel' else range(1))]


def fault_rows(pool: ProcessPoolExecutor) -> Iterator[str]:
    """Yield the rows of the fault matrix."""
    yield '| fault | ' + ' | '.join(PLACES) + ' |'
    yield '|---' * (len(PLACES) + 1) + '|'
    rows = cases(4)
    found = pool.map(faulty, [(name, value, sensor, kind, 4) for name, value, _, sensor in rows
                              for kind in PLACES.values()])
    worst = 0.0
    for index, (name, value, unit, sensor) in enumerate(rows):
        row = [next(found) for _ in PLACES]
        show(f'{index + 1} of {len(rows)} faults')
        worst = max(worst, *(run.undeclared for cell in row for run in cell))
        who = JOINT_NAMES[sensor] if name != 'two that cancel' else 'joint_1a, joint_1b'
        yield f'| {labelled(name, value, unit)}, {who} | ' + ' | '.join(map(described, row)) + ' |'
    yield ''
    yield (f'Longest time that an orientation was off by more than its level with the faulty '
           f'sensor checked, over the time to alert (20 ms, ten samples at least): {worst:.2f}')


def labelled(name: str, value: float, unit: str) -> str:
    """Return a fault in words."""
    return f'{name} {value:g} {unit}'.strip() if name != 'stuck' else name


def described(cell: list[Outcome]) -> str:
    """Return a cell of the table."""
    text = f'{sum(run.silent for run in cell)}/{len(cell)} silent'
    undeclared = max(run.undeclared for run in cell)
    declared = max(run.declared_deg for run in cell)
    if undeclared:
        text += f', undeclared for {100.0 * undeclared:.0f} % of the time to alert'
    if declared > 0.3:
        text += f', declared {declared:.1f} deg'
    return text


def more_rows(sensors: int, pool: ProcessPoolExecutor) -> Iterator[str]:
    """Yield what each fault does to five or six sensors, over all of them and all places."""
    yield ('| fault | runs | silent at the end | the faulty one excluded | another one | longest '
           'pause of those that go on, ms | off by more than the level, of the time to alert |')
    yield '|---' * 7 + '|'
    rows = cases(sensors)
    found = pool.map(faulty, [(name, value, sensor, kind, sensors)
                              for name, value, _, sensor in rows for kind in PLACES.values()])
    for fault_name, group in groupby(rows, key=lambda row: row[:3]):
        right = other = 0
        runs: list[Outcome] = []
        for *_, sensor in group:
            for _ in PLACES:
                new = next(found)
                runs += new
                right += sum(run.excluded == ALL_JOINT_NAMES[sensor] for run in new)
                other += sum(run.excluded not in ('', ALL_JOINT_NAMES[sensor]) for run in new)
        show(f'{sensors} sensors: {labelled(*fault_name)}')
        yield (f'| {labelled(*fault_name)} | {len(runs)} | {sum(run.silent for run in runs)} '
               f'| {right} | {other} | {1e3 * max(run.pause for run in runs):.0f} '
               f'| {100.0 * max(run.undeclared for run in runs):.0f} % |')


def jump_rows(pool: ProcessPoolExecutor) -> Iterator[str]:
    """Yield the least jumps that are always detected where no parity shows them, by rate."""
    rates, missing = (100.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0), (0, 1, 5)
    tasks = [(rate, lost, pair) for rate in rates
             for lost, pair in (*((lost, False) for lost in missing), (0, True))]
    found = pool.map(least_jump, tasks)
    yield '| rate, Hz | ' + ' | '.join(
        f'th3A at the singularity, {lost} samples lost before it, deg'
        for lost in missing) + ' | th1A and th1B that cancel, deg |'
    yield '|---' * (len(missing) + 2) + '|'
    for rate in rates:
        yield f'| {rate:g} | ' + ' | '.join(
            f'{next(found):.2f}' for _ in range(len(missing) + 1)) + ' |'
        show(f'jumps at {rate:g} Hz')


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
        keep[begin - lost:begin] = False
        result = supervise(stamps(len(angles), rate)[keep], encoders(angles, seed=seed)[keep])
        return not result.published[-1]

    low, high = 0.1, 60.0
    while high > 1.02 * low:
        middle = np.sqrt(low * high)
        fine = all(detected(sign * middle, seed) for seed in range(5) for sign in (-1.0, 1.0))
        low, high = (low, middle) if fine else (middle, high)
    return high


# Theory --------------------------------------------------------------------------------------

def coverage_rows() -> Iterator[str]:
    """Yield the share of poses at which each sensor is checked, by alert limit."""
    values = complete(FKM_SETTINGS, {})
    sigma, bias = sigma_from(values), tuple(np.radians(values['bias_deg']).tolist())
    reach = (limits_from(values).threshold + MISSED_DETECTION) / np.sqrt(20.0)
    worths = []
    for tilt, azimuth, phi in product(range(0, 21, 5), range(0, 360, 30), range(0, 96, 5)):
        rotation = workspace_pose(*np.radians([tilt, azimuth, phi]))
        try:
            joints = inverse(rotation)
            found = estimate_sample(
                *joints.theta1.tolist(), float(joints.theta3a), sigma, Geometry(),
                tuple(quaternion_from_matrix(rotation).tolist()))
        except SpmError:
            continue
        worths.append(integrity(found, bias, 1.0))
    healthy_deg = np.degrees([worth.healthy for worth in worths])
    levels_deg = np.degrees([worth.levels(reach) for worth in worths])
    yield '| alert_limit_deg | published | ' + ' | '.join(
        f'{name} checked' for name in JOINT_NAMES) + ' |'
    yield '|---' * 6 + '|'
    for limit in (0.3, 0.5, 1.0, 2.0):
        shares = [(healthy_deg <= limit).mean(), *(levels_deg <= limit).mean(axis=0)]
        yield f'| {limit:g} | ' + ' | '.join(f'{100.0 * share:.0f} %' for share in shares) + ' |'
    yield ''
    yield (f'{len(worths)} reachable poses, tilt 0 .. 20 deg, phi 0 .. 95 deg, default sigma_deg '
           f'and bias_deg; the healthy part of the level is {healthy_deg.max():.2f} deg at most.')


# Output --------------------------------------------------------------------------------------

def show(text: str) -> None:
    """Show the progress on stderr."""
    print(f'integrity: {text}', file=sys.stderr, flush=True)


def sections(seconds: float, pool: ProcessPoolExecutor) -> Iterator[str]:
    """Yield the lines of all tables."""
    yield '## Poses at which each sensor is checked'
    yield ''
    yield from coverage_rows()
    yield ''
    yield '## Healthy sensors anywhere in the reachable workspace'
    yield ''
    yield from long_run(seconds, pool)
    yield ''
    yield '## Healthy sensors by condition'
    yield ''
    yield '| condition | published | largest error, deg | largest error over its level |'
    yield '|---|---|---|---|'
    for row in pool.map(healthy, CONDITIONS):
        show(row)
        yield row
    yield ''
    yield '## Faults'
    yield ''
    yield from fault_rows(pool)
    yield ''
    for sensors in (5, 6):
        yield f'## Faults with {sensors} sensors'
        yield ''
        yield from more_rows(sensors, pool)
        yield ''
    yield '## Least jump that is detected where no parity shows it'
    yield ''
    yield from jump_rows(pool)


def main(args: Iterable[str] | None = None) -> int:
    """Print the tables; write them to a file where one is given."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seconds', type=float, default=10_000.0,
                        help='length of the healthy run, s (default 10000)')
    parser.add_argument('file', nargs='?', type=Path, help='Markdown file to write')
    options = parser.parse_args(None if args is None else list(args))
    begin = time.monotonic()
    lines = []
    with ProcessPoolExecutor() as pool:
        for line in sections(options.seconds, pool):
            print(line, flush=True)
            lines.append(line)
    show(f'{time.monotonic() - begin:.0f} s')
    if options.file:
        options.file.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
