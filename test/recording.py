# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recorded session beside this file, its truth, and orientations checked against it."""

from __future__ import annotations

import csv
import gzip

from harness import DATA, stamp
import numpy as np

LOG = DATA / 'fig9_canopen.log.gz'
TRUTH = DATA / 'fig9_canopen_truth.csv.gz'
# Zero counts and directions of its encoders; those of config/simulated_rig.yaml.
ZERO = np.array([1201, 15870, 8003, 4444])
DIRECTION = np.array([1, 1, -1, 1])
COUNTS_PER_TURN = 16384
# Self-rotation of the paper's central singularity (deg), mode +++.
SINGULAR_PHI = 49.358591780


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Return the SYNC times, ns, and the true quaternions x, y, z, w."""
    with gzip.open(TRUTH, 'rt') as file:
        rows = list(csv.reader(file))[1:]
    times = np.array([int(row[0].replace('.', '')) * 1000 for row in rows])
    return times, np.array([[float(value) for value in row[1:]] for row in rows])


def recorded_angles() -> np.ndarray:
    """Return the four joint angles that answer each SYNC of the log, rad, (20000, 4)."""
    with gzip.open(LOG, 'rt') as file:
        frames = [line.split()[2].split('#') for line in file]
    counts = np.array([[int.from_bytes(bytes.fromhex(data), 'little') for name, data in frames
                        if name == identifier] for identifier in ('181', '182', '183', '184')]).T
    turns = (DIRECTION * (counts - ZERO)) % COUNTS_PER_TURN / COUNTS_PER_TURN
    return (turns - (turns > 0.5)) * 2.0 * np.pi


def true_phi(times: np.ndarray) -> np.ndarray:
    """Return the self-rotation, deg, at SYNC times (Fig. 9's motion)."""
    t = (times - times[0]) * 1e-9
    return 45.0 + 10.0 * np.sin(np.pi * t / 10.0)


def quaternions(arrived) -> np.ndarray:
    """Return the quaternions of collected QuaternionStamped messages, (n, 4)."""
    return np.array([[m.quaternion.x, m.quaternion.y, m.quaternion.z, m.quaternion.w]
                     for _, m in arrived])


def stamps(arrived) -> np.ndarray:
    """Return the header stamps of collected messages, ns."""
    return np.array([stamp(message) for _, message in arrived])


def rotation_angle(q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the angle of the rotation between unit quaternions, deg; q and -q are the same."""
    chord = np.minimum(np.linalg.norm(q - p, axis=-1), np.linalg.norm(q + p, axis=-1))
    return np.degrees(4.0 * np.arcsin(np.minimum(chord / 2.0, 1.0)))


def check_against_truth(arrived, index: np.ndarray) -> None:
    """Check the orientations of a complete motion, each by the truth of the SYNC of its index."""
    got = quaternions(arrived)
    error = rotation_angle(got, truth()[1][index])
    assert error.max() <= 0.25
    assert np.all(np.sum(got[1:] * got[:-1], axis=1) > 0.0), 'the sign of the quaternion jumped'
    near = np.abs(true_phi(truth()[0])[index] - SINGULAR_PHI) < 1.0
    rms = np.sqrt(np.mean(error ** 2))
    rms_near, rms_far = (np.sqrt(np.mean(error[part] ** 2)) for part in (near, ~near))
    print(f'{len(error)} orientations: error rms {rms:.4f}, max {error.max():.4f} deg; within '
          f'1 deg of the singularity rms {rms_near:.4f} ({near.sum()}), elsewhere {rms_far:.4f}')
    assert rms <= 0.055
    assert near.sum() > 1000
    assert rms_near <= 1.1 * rms_far
