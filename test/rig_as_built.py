# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recording of a rig with ordinary tolerances: its parameters, its truth, its errors."""

from __future__ import annotations

from functools import cache
import json

from harness import DATA
import numpy as np
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.validation.alignment import nearest_rotation


@cache
def rig() -> dict:
    """Return what was simulated."""
    return json.loads((DATA / 'rig' / 'rig.json').read_text())


def mechanism() -> dict[str, list[float]]:
    """Return the parameters of the mechanism, by name."""
    return {
        'geometry.proximal_deg': rig()['alpha_deg'],
        'geometry.distal_deg': rig()['beta_deg'],
        'geometry.base_axes': np.ravel(rig()['base_axes']).tolist(),
        'geometry.platform_axes': np.ravel(rig()['platform_axes']).tolist(),
    }


def calibration() -> dict[str, list[object]]:
    """Return the parameters of the encoders, by name; no model knows the second harmonics."""
    cosine, sine = np.transpose(rig()['eccentricity_deg_cos_sin']).tolist()
    return {
        'encoders.zero_count': rig()['zero'],
        'encoders.direction': rig()['direction'],
        'encoders.direction_verified': [True] * 4,
        'encoders.harmonic_cos_deg': cosine,
        'encoders.harmonic_sin_deg': sine,
    }


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Return the times of every tenth SYNC, s, and the true orientations, (n, 3, 3)."""
    rows = np.loadtxt(DATA / 'rig' / 'dev_check_truth.csv.gz', delimiter=',', skiprows=1)
    return rows[:, 0], matrix_from_quaternion(rows[:, 1:])


def errors_deg(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return the errors of orientations, deg, up to one constant rotation on each side."""
    base = np.eye(3)
    platform = np.eye(3)
    # In turns, by the nearest rotation to the mean.
    for _ in range(20):
        platform = nearest_rotation((np.swapaxes(base @ found, 1, 2) @ true).mean(0))
        base = nearest_rotation((true @ np.swapaxes(found @ platform, 1, 2)).mean(0))
    half = np.linalg.norm(base @ found @ platform - true, axis=(1, 2)) / np.sqrt(8.0)
    return np.degrees(2.0 * np.arcsin(half))
