# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The runs of `benchmarks.integrity`: healthy sensors, disturbed and faulty ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
import sys
from typing import Any, NamedTuple

from benchmarks.integrity_records import Record
import numpy as np
from spm_haptic_master.kinematics import Geometry, inverse, workspace_pose
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.supervision import supervise
from spm_haptic_master.validation.parity_map import nominal_bias, parity_map, regions

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'supervision'))

from device import (  # noqa: E402, I100
    disturbance,
    DISTURBANCES,
    ENCODER_KINDS,
    encoders,
    errors,
    joint_angles,
    motion,
    stamps,
)

# Beginning of a fault (s), and the length of its run (s).
ONSET, LENGTH = 1.5, 4.0
# Motions of the fault matrix, by column.
PLACES = {
    'centre': 'rest',
    'rim': 'rim',
    'singular': 'singular',
    'crossing': 'crossing',
    'moving': 'sweep',
}
# Tolerances of a calibrated mechanism: links and axes, and harmonics of the encoders (deg).
TOLERANCE, HARMONIC = 0.05, 0.03
# Disturbances of a healthy device, numbers of sensors and kinds of encoders; runs of each.
DISTURBED = tuple(product(DISTURBANCES, (4, 5, 6), ENCODER_KINDS))
DISTURBED_RUNS = 25

Array = Any


def record(
    group: str,
    name: str,
    rotations: Array,
    times: Array,
    angles: Array,
    rate: float = 1000.0,
    onset: int | None = None,
    faulty: int | None = None,
    **parameters: Any,
) -> Record:
    """Return what `supervise` makes of readings, rad, on true orientations, (n, 3, 3)."""
    result = supervise(times, angles, **parameters)
    n, sensors = angles.shape
    samples = np.zeros(
        n,
        [
            ('published', '?'),
            ('quaternion', 'f4', 4),
            ('level', 'f4'),
            ('error', 'f4'),
            ('checked', '?', sensors),
        ],
    )
    samples['published'] = result.published
    samples['quaternion'] = result.quaternion
    samples['level'] = result.protection_level
    samples['error'] = errors(result, rotations)
    samples['checked'] = result.unchecked == 0.0
    return Record(group, name, n if onset is None else onset, rate, faulty, samples, result.state)


# Healthy sensors -----------------------------------------------------------------------------


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
    *(
        Condition(f'{bits} bit, noise {noise:g} deg', MOTIONS, noise, bits)
        for bits in (12, 14, 16, 17)
        for noise in (0.0, 0.005, 0.04, 0.08)
    ),
    Condition('motion to 15 rad/s', ('fast',), fastest=True),
    *(Condition(f'{rate:g} Hz', MOTIONS[:-1], rate=rate) for rate in (100.0, 250.0, 4000.0)),
    Condition('stamps off by 300 us', MOTIONS, jitter=3e-4),
    Condition('10 % of the samples lost', MOTIONS, loss=0.1),
    Condition('sensors at 250 Hz on a bus at 1 kHz', MOTIONS[:-1], hold=4),
    Condition(
        f'links and axes off by {TOLERANCE} deg, harmonics {HARMONIC} deg, bias_deg by '
        '`supervise`',
        MOTIONS,
        tolerance=TOLERANCE,
    ),
)


def as_built(seed: int, tolerance: float) -> Geometry:
    """Return a mechanism whose links and axes are off by normal deviates, deg (1 sigma)."""
    rng = np.random.default_rng(seed)
    nominal = Geometry()

    def off(axes: Array) -> Array:
        moved = np.array(axes) + np.radians(tolerance) * rng.normal(size=(3, 3))
        return moved / np.linalg.norm(moved, axis=1, keepdims=True)

    return Geometry.from_axes(
        off(nominal.base_axes),
        off(nominal.platform_axes),
        nominal.alpha + np.radians(tolerance) * rng.normal(size=3),
        nominal.beta + np.radians(tolerance) * rng.normal(size=3),
    )


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
        return (
            angles
            + self._harmonics[0] * np.cos(angles)
            + self._harmonics[1] * np.sin(angles)
            - self._zeros
        )


def readings(
    condition: Condition, kind: str, angles_of: Callable[[Array], Array], seed: int
) -> tuple[Array, Array, Array]:
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
        times = times + np.round(
            condition.jitter * 1e9 * rng.uniform(-1.0, 1.0, len(times))
        ).astype(np.int64)
    keep = rng.random(len(angles)) >= condition.loss
    return rotations[keep], times[keep], angles[keep]


def healthy(condition: Condition) -> list[Record]:
    """Return the records of one condition, one for each motion."""
    runs, bias = [], []
    for seed, kind in enumerate(condition.kinds):
        angles_of: Callable[[Array], Array] = joint_angles
        if condition.tolerance:
            built = AsBuilt(seed, condition.tolerance, HARMONIC)
            angles_of = built.angles
            bias.append(calibrated_bias(built))
        runs.append(readings(condition, kind, angles_of, seed))
    group = condition.label + (f' ({min(bias):.2f} .. {max(bias):.2f})' if bias else '')
    return [
        record(
            group, kind, *run, condition.rate, **({'bias_deg': [bias[seed]] * 4} if bias else {})
        )
        for seed, (kind, run) in enumerate(zip(condition.kinds, runs, strict=True))
    ]


def calibrated_bias(built: AsBuilt) -> float:
    """Return the nominal bias that `supervise` proposes for a device, deg."""
    rotations = motion('sweep', 20.0)
    angles = encoders(built.angles(rotations))
    found = parity_map(angles, (np.radians(0.04),) * 4, Geometry(), RIG_WORKING_MODE)
    table = regions(found, np.ones(len(angles), bool), np.ones(len(angles)))
    proposed = nominal_bias(table)
    return float(0.01 * np.ceil(100.0 * (proposed or 0.0)))


def disturbances(task: tuple[str, int, str]) -> list[Record]:
    """Return the records of healthy sensors under a kind of disturbance, by kind of encoders."""
    kind, sensors, encoder = task
    noise, bits = ENCODER_KINDS[encoder]
    records = []
    for seed in range(DISTURBED_RUNS):
        rotations = disturbance(kind, seed)
        true = joint_angles(rotations, sensors)
        if np.isfinite(true).all():
            records.append(
                record(
                    f'{kind}, {sensors} sensors, {encoder}',
                    f'seed {seed}',
                    rotations,
                    stamps(len(true)),
                    encoders(true, noise, bits, seed),
                    sigma_deg=[noise] * 4,
                )
            )
    return records


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
        elif name == PAIR:
            angles[after, :2] += np.radians(value) * CANCEL
        return angles

    return change


# The fault of two sensors, and those that are there from the first sample on.
PAIR, WHOLE_RUN = 'two that cancel', ('scale', 'offset before the start')
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
    (PAIR, 2.0, 'deg'),
)
# Noise (deg), resolution (bit) and rate (Hz) of the encoders in the fault matrix.
ENCODERS = (
    (0.04, 14, 1000.0),
    (0.0, 16, 1000.0),
    (0.005, 17, 1000.0),
    (0.04, 12, 1000.0),
    (0.04, 14, 250.0),
    (0.04, 14, 4000.0),
    (0.04, 14, 100.0),
)
# The same of five and six sensors.
MORE_ENCODERS = ENCODERS[0], ENCODERS[2], ENCODERS[4]


class Fault(NamedTuple):
    """A fault, as in `FAULTS`, of one of four to six sensors, at one of `PLACES`."""

    name: str
    value: float
    sensor: int
    place: str
    sensors: int


def faulty(task: Fault) -> list[Record]:
    """Return the records of a fault of a sensor in a motion, one for each kind of encoders."""
    name, value, sensor, place, sensors = task
    unit = next(each for fault_name, _, each in FAULTS if fault_name == name)
    who = ' and '.join(JOINT_NAMES[:2]) if name == PAIR else ALL_JOINT_NAMES[sensor]
    records = []
    for seed, (noise, bits, rate) in enumerate(ENCODERS if sensors == 4 else MORE_ENCODERS):
        if name == PAIR and rate < PAIR_RATE:
            continue
        rotations = motion(PLACES[place], LENGTH, rate)
        t = np.arange(len(rotations)) / rate
        true = joint_angles(rotations, sensors)
        angles = encoders(fault(name, value, sensor, seed)(true, t), noise, bits, seed)
        onset = 0 if name in WHOLE_RUN else int(np.flatnonzero(t >= ONSET)[0])
        if name == 'stuck':
            angles[onset:, sensor] = angles[onset, sensor]
        records.append(
            record(
                f'{sensors} sensors, {bits} bit, {noise:g} deg, {rate:g} Hz',
                f'{labelled(name, value, unit)}, {who}, {place}',
                rotations,
                stamps(len(angles), rate),
                angles,
                rate,
                onset,
                sensor,
            )
        )
    return records


def labelled(name: str, value: float, unit: str) -> str:
    """Return a fault in words."""
    return f'{name} {value:g} {unit}'.strip() if name != 'stuck' else name


def cases(sensors: int) -> list[tuple[str, float, str, int]]:
    """Return the faults and the sensors that have them: name, value, unit, sensor."""
    return [
        (name, value, unit, sensor)
        for name, value, unit in FAULTS
        for sensor in (range(sensors) if name != PAIR else range(1))
    ]
