# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recorded session beside this file, its truth, and orientations checked against it."""

from __future__ import annotations

import gzip

from harness import DATA, stamp
from mechanism import SINGULAR_PHI
import numpy as np

LOG = DATA / 'fig9_canopen.log.gz'
# Zero counts and directions of its encoders; those of config/simulated_rig.yaml.
ZERO = np.array([1201, 15870, 8003, 4444])
DIRECTION = np.array([1, 1, -1, 1])
COUNTS_PER_TURN = 16384


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Return the SYNC times, ns, and the true quaternions x, y, z, w."""
    rows = np.loadtxt(DATA / 'fig9_canopen_truth.csv.gz', delimiter=',', skiprows=1)
    microseconds = np.round(rows[:, 0] * 1e6).astype(int)
    return microseconds * 1000, rows[:, 1:]


def recorded_angles() -> np.ndarray:
    """Return the four joint angles that answer each SYNC of the log, rad, (20000, 4)."""
    with gzip.open(LOG, 'rt') as file:
        frames = [line.split()[2].split('#') for line in file]
    columns = {'181': [], '182': [], '183': [], '184': []}
    for identifier, data in frames:
        if identifier in columns:
            count = int.from_bytes(bytes.fromhex(data), 'little')
            columns[identifier].append(count)
    counts = np.transpose([*columns.values()])
    turns = (DIRECTION * (counts - ZERO)) % COUNTS_PER_TURN / COUNTS_PER_TURN
    return (turns - (turns > 0.5)) * 2.0 * np.pi


def stamps(arrived) -> np.ndarray:
    """Return the header stamps of collected messages, ns."""
    return np.array([stamp(message) for _, message in arrived])


def check_against_truth(arrived, index: np.ndarray) -> None:
    """Check the orientations of a complete motion, each by the truth of the SYNC of its index."""
    times, true = truth()
    quaternions = [message.quaternion for _, message in arrived]
    got = np.array([[q.x, q.y, q.z, q.w] for q in quaternions])
    cosines = np.sum(got[1:] * got[:-1], axis=1)
    assert np.all(cosines > 0.0), 'the sign of the quaternion jumped'
    # q and -q are the same orientation.
    chord = np.minimum(
        np.linalg.norm(got - true[index], axis=1),
        np.linalg.norm(got + true[index], axis=1),
    )
    error = np.degrees(4.0 * np.arcsin(chord / 2.0))
    # Fig. 9's motion.
    phi = 45.0 + 10.0 * np.sin(np.pi * 1e-10 * (times[index] - times[0]))
    near = np.abs(phi - np.degrees(SINGULAR_PHI)) < 1.0
    rms = np.sqrt(np.mean(error**2))
    rms_near = np.sqrt(np.mean(error[near] ** 2))
    rms_far = np.sqrt(np.mean(error[~near] ** 2))
    assert error.max() <= 0.25
    assert rms <= 0.055
    assert near.sum() > 1000
    assert rms_near <= 1.1 * rms_far
