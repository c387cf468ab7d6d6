# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated device for the tests of the supervision: motions, encoders, faults, errors."""

from __future__ import annotations

import numpy as np
from spm_haptic_master import kinematics
from spm_haptic_master.supervision import supervise

SINGULAR = 49.358591780  # deg; central singularity of the rig's working mode
MS = 1_000_000  # ns
# Noise (1 sigma, deg) and resolution (bits) of two kinds of encoders.
ENCODER_KINDS = {'14 bits': (0.04, 14), '17 bits': (0.006, 17)}
# Disturbances of a healthy device.
DISTURBANCES = ('end stop', 'vibration')
# Fastest acceleration of the hand (rad/s^2), and what is left of a speed after an end stop.
HAND = 300.0
REBOUND = 0.3


# Motions --------------------------------------------------------------------------------------


def motion(kind: str, seconds: float, rate: float = 1000.0) -> np.ndarray:
    """Return the orientations of a motion, (n, 3, 3)."""
    return motion_at(kind, np.arange(round(seconds * rate)) / rate)


def motion_at(kind: str, t: np.ndarray) -> np.ndarray:
    """Return the orientations of a motion at times, s, (n, 3, 3)."""
    zero = np.zeros(len(t))

    def swing(amplitude, hertz):
        return amplitude * np.sin(2.0 * np.pi * hertz * t)

    def to_one(seconds):
        return np.minimum(t / seconds, 1.0)

    after_rest = np.maximum(t - 1.2, 0.0)
    tilt, azimuth, phi = {
        'rest': (zero, zero, zero + 20.0),
        'singular': (zero, zero, zero + SINGULAR),
        'crossing': (zero, zero, 45.0 + swing(10.0, 0.05)),
        'through': (zero, zero, 42.0 + 7.0 * np.cos(0.5 * np.pi * t)),
        'turning': (zero, zero, 20.0 + swing(10.0, 0.5)),
        'rim': (
            zero + 18.0,
            200.0 + swing(40.0, 0.16),
            25.0 + swing(5.0, 0.32),
        ),
        'tremor': (
            8.0 + swing(0.05, 10.0),
            30.0 + swing(1.0, 9.0),
            30.0 + swing(0.06, 11.0),
        ),
        'sweep': (
            8.0 * (1.0 - np.cos(0.9 * t)),
            72.0 * t,
            42.0 + swing(40.0, 0.08),
        ),
        'fast': (
            6.0 + swing(2.0, 3.0),
            90.0 + swing(20.0, 2.0),
            30.0 + swing(20.0, 4.5),
        ),
        # To and fro once, which confirms the solution, then at rest.
        'resting': (zero, zero, 20.0 + 8.0 * np.sin(np.pi * to_one(0.4))),
        # To the singularity, which confirms the solution, then at rest there.
        'to singular': (
            zero,
            zero,
            SINGULAR - 10.0 * np.cos(0.5 * np.pi * to_one(0.5)) ** 2,
        ),
        # To and fro after 1.2 s of rest, which teach the noise.
        'taught': (zero, zero, 20.0 + 6.0 * np.sin(np.pi * after_rest)),
        'taught singular': (zero, zero, SINGULAR + 6.0 * np.sin(np.pi * after_rest)),
        'near singular': (zero, zero, SINGULAR + swing(2.0, 0.5)),
    }[kind]
    return kinematics.workspace_pose(*map(np.radians, (tilt, azimuth, phi)))


def about(pose: np.ndarray, axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the orientations of a pose that is turned about an axis by angles, rad, (n, 3, 3)."""
    half = 0.5 * angles[:, None]
    direction = axis / np.linalg.norm(axis)
    quaternions = np.hstack([direction * np.sin(half), np.cos(half)])
    return kinematics.matrix_from_quaternion(quaternions) @ pose


def random_pose(rng: np.random.Generator) -> np.ndarray:
    """Return a pose of the inner workspace."""
    tilt = rng.uniform(0.0, 12.0)
    azimuth = rng.uniform(0.0, 360.0)
    phi = rng.uniform(5.0, 60.0)
    return kinematics.workspace_pose(*np.radians([tilt, azimuth, phi]))


def end_stop(speed: float, contact: float) -> np.ndarray:
    """Return the angle, rad, of a turn that an end stop reverses after 10 deg, at 1 kHz."""
    step = 1e-5
    up = speed / HAND
    travel = np.radians(10.0) / speed
    down = REBOUND * speed / HAND
    time = np.arange(0.0, 0.4 + up + travel + contact + down, step)
    begin = 0.15
    hit = 0.15 + up + travel
    push = HAND * ((time >= begin) & (time < begin + up))
    phase = (time - hit) / contact
    push -= (
        (1.0 + REBOUND)
        * speed
        * np.pi
        / 2.0
        / contact
        * np.sin(np.pi * phase)
        * ((phase >= 0.0) & (phase < 1.0))
    )
    push += HAND * ((phase >= 1.0) & (time < hit + contact + down))
    angle = np.cumsum(np.cumsum(push)) * step * step
    return angle[:: round(1e-3 / step)]


def vibration(hertz: float, seconds: float = 2.0) -> np.ndarray:
    """Return the angle, rad, of a vibration of 0.2 deg that begins after 0.2 s, at 1 kHz."""
    time = np.arange(round(1000.0 * seconds)) * 1e-3
    has_begun = time >= 0.2
    return np.radians(0.2) * np.sin(2.0 * np.pi * hertz * time) * has_begun


def disturbance(kind: str, seed: int) -> np.ndarray:
    """Return the orientations of an end stop or a vibration: pose, axis and size by the seed."""
    rng = np.random.default_rng(seed)
    if kind == 'end stop':
        angles = end_stop(rng.uniform(1.0, 6.0), rng.uniform(0.003, 0.005))
    else:
        angles = vibration(rng.uniform(60.0, 150.0))
    return about(random_pose(rng), rng.normal(size=3), angles)


# Encoders and faults --------------------------------------------------------------------------


def joint_angles(rotations: np.ndarray, sensors: int = 4) -> np.ndarray:
    """Return the true th1A, th1B, th1C, th3A, and th3B and th3C if asked, rad, (n, sensors)."""
    joints = kinematics.inverse(rotations)
    every = (
        joints.theta1,
        joints.theta3a,
        joints.theta3b,
        joints.theta3c,
    )
    return np.column_stack(every)[:, :sensors]


def encoders(
    angles: np.ndarray,
    noise: float = 0.04,
    bits: int = 14,
    seed: int = 1,
) -> np.ndarray:
    """Return readings, rad: noise (1 sigma, deg) and quantisation on the angles."""
    rng = np.random.default_rng(seed)
    count = 2.0 * np.pi / 2**bits
    noisy = angles + np.radians(noise) * rng.normal(size=angles.shape)
    return np.round(noisy / count) * count


def stamps(n: int, rate: float = 1000.0) -> np.ndarray:
    """Return the stamps of a regular sampling, ns."""
    since_begin = np.round(np.arange(n) * 1e9 / rate)
    return 1_000_000_000 + since_begin.astype(np.int64)


def paused(n: int, *pauses: tuple[int, int]) -> np.ndarray:
    """Return stamps a millisecond apart, with so many ms more before some samples."""
    times = stamps(n)
    for index, milliseconds in pauses:
        times[index:] += milliseconds * MS
    return times


def offset(first: int, sensor, degrees, last: int | None = None):
    """Return a fault: a sensor, or several, off by deg from a sample on."""

    def change(angles):
        angles[first:last, sensor] += np.radians(degrees)

    return change


def ramp(first: int, sensor: int, degrees_a_second: float):
    """Return a fault: a sensor that drifts from a sample on, at 1 kHz."""

    def change(angles):
        after = np.maximum(np.arange(len(angles)) - first, 0) * 1e-3
        angles[:, sensor] += np.radians(degrees_a_second) * after

    return change


def stuck(first: int, sensor: int):
    """Return a fault of readings: one that repeats itself from a sample on."""

    def change(readings):
        readings[first:, sensor] = readings[first, sensor]

    return change


def noisy(first: int, sensor: int, degrees: float):
    """Return a fault of readings: a sensor has noise from a sample on (1 sigma)."""

    def change(readings):
        rng = np.random.default_rng(3)
        noise = rng.normal(size=len(readings) - first)
        readings[first:, sensor] += np.radians(degrees) * noise

    return change


def every(*changes):
    """Return several faults as one."""

    def change(angles):
        for each in changes:
            each(angles)

    return change


# What the supervision makes of it -------------------------------------------------------------


def errors(result, rotations: np.ndarray) -> np.ndarray:
    """Return the rotation error of each orientation, deg; NaN where none is published."""
    true = kinematics.quaternion_from_matrix(rotations)
    chord = np.minimum(
        np.linalg.norm(true - result.quaternion, axis=1),
        np.linalg.norm(true + result.quaternion, axis=1),
    )
    return np.degrees(4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))


def longest(wrong: np.ndarray) -> int:
    """Return the most samples in a row for which something is true."""
    padded = np.concatenate([[0], wrong, [0]])
    edges = np.flatnonzero(np.diff(padded))
    return max(edges[1::2] - edges[::2], default=0)


class Outcome:
    """What the supervision makes of readings on a known motion; errors and levels in deg."""

    def __init__(self, rotations, readings, times=None, rate=1000.0, **parameters):
        times = stamps(len(readings), rate) if times is None else times
        self.result = supervise(times, readings, **parameters)
        self.published = self.result.published
        self.level = self.result.protection_level
        self.error = errors(self.result, rotations)
        self.states = [text for _, text in self.result.state]
        self.within_level = not np.any(self.error > self.level)

    @property
    def healthy_throughout(self) -> bool:
        """Whether every sample behind the start is published, as healthy."""
        is_healthy = self.states == ['starting', 'healthy']
        return is_healthy and bool(self.published[4:].all())

    def longest_undeclared(self, sensor: int, rate: float = 1000.0) -> float:
        """Return the longest time, s, off by more than the level with the sensor checked."""
        is_wrong = self.error > self.level
        is_checked = self.result.unchecked[:, sensor] == 0.0
        return longest(is_wrong & is_checked) / rate

    def longest_silence(self, first: int = 100) -> int:
        """Return the most samples in a row without an orientation."""
        return longest(~self.published[first:])


def run(
    kind,
    sensors=4,
    seconds=2.0,
    rate=1000.0,
    change=None,
    spoil=None,
    noise=0.04,
    bits=14,
    seed=1,
    times=None,
    keep=slice(None),
    **parameters,
) -> Outcome | None:
    """
    Play a kind of motion, or orientations; None where the device does not reach them.

    `change` is a fault of the true angles, `spoil` one of the readings; `keep` selects samples.
    """
    rotations = motion(kind, seconds, rate) if isinstance(kind, str) else kind
    angles = joint_angles(rotations, sensors)
    if not np.isfinite(angles).all():
        return None
    if change is not None:
        change(angles)
    readings = encoders(angles, noise, bits, seed)
    if spoil is not None:
        spoil(readings)
    times = stamps(len(readings), rate) if times is None else times
    return Outcome(
        rotations[keep],
        readings[keep],
        times[keep],
        **parameters,
    )
