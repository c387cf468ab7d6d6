# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Healthy sensors, one with a bias far above its noise, near another solution of all sensors.

The other solution is some 10 deg away there: what would be published there would be 1.4 to 3.7
levels off.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from spm_haptic_master.kinematics.inverse_model import measured_angles
from spm_haptic_master.kinematics.rotations import (
    matrix_from_quaternion,
    matrix_from_vector,
    quaternion_from_matrix,
    rotation_distance,
    rotation_from_quaternion,
)
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision import supervise

MODE = (1, 1, 1)
# Below the level that such orientations have, and above it (deg).
ALERT_LIMITS = 2.86, 6.0


@dataclass(frozen=True)
class Motion:
    """A start, a turn to the end, and what the readings are off by."""

    quaternion: tuple[float, ...]
    turn: tuple[float, ...]  # rotation vector in the base frame, rad
    samples: int
    rate: float  # Hz
    sigma: tuple[float, ...]  # deg
    bias: tuple[float, ...]  # deg, with the sign that it has


MOTIONS = {
    'at rest': Motion(
        quaternion=(0.0275908, 0.6764589, 0.6278728, 0.3839502),
        turn=(0.0, 0.0, 0.0),
        samples=60,
        rate=500.0,
        sigma=(0.005, 0.005, 0.014, 0.067),
        bias=(-0.025, 0.01, 0.562, -0.022),
    ),
    'a slow turn': Motion(
        quaternion=(0.0400484, 0.6741821, 0.6096111, 0.4150288),
        turn=(-0.01127, 0.04553, 0.0254),
        samples=72,
        rate=500.0,
        sigma=(0.005, 0.005, 0.02, 0.061),
        bias=(-0.025, 0.01, 0.502, -0.02),
    ),
    'a start near the other solution': Motion(
        quaternion=(0.0888734, 0.6900447, 0.6086027, 0.3815005),
        turn=(-0.00382, 0.02483, 0.01508),
        samples=93,
        rate=1000.0,
        sigma=(0.005, 0.005, 0.02, 0.077),
        bias=(-0.025, 0.01, 0.502, -0.022),
    ),
    'a turn past it': Motion(
        quaternion=(0.0498428, 0.6788714, 0.5920075, 0.4314817),
        turn=(-0.01109, 0.03561, 0.02334),
        samples=111,
        rate=1000.0,
        sigma=(0.005, 0.005, 0.018, 0.053),
        bias=(-0.023, 0.009, 0.464, 0.016),
    ),
}


def largest_ratio(motion, alert_limit):
    """Return the largest error over the protection level of what is published; 0 if nothing is."""
    shares = np.linspace(0.0, 1.0, motion.samples)
    turns = matrix_from_vector(shares[:, None] * np.array(motion.turn))
    quaternion = np.array(motion.quaternion) / np.linalg.norm(motion.quaternion)
    truth = quaternion_from_matrix(turns @ matrix_from_quaternion(tuple(quaternion)))
    geometry = geometry_from(complete(FKM_SETTINGS, {}))
    readings = np.array(
        [measured_angles(rotation_from_quaternion(*each), geometry, MODE, 4) for each in truth]
    )
    noise = np.random.default_rng(1).normal(size=readings.shape)
    readings += np.radians(motion.bias + 0.3 * noise * motion.sigma)
    result = supervise(
        np.round(np.arange(motion.samples) * 1e9 / motion.rate).astype(np.int64),
        readings,
        sigma_deg=list(motion.sigma),
        bias_deg=list(np.abs(motion.bias)),
        alert_limit_deg=alert_limit,
        degraded='stop',
    )
    shown = result.published
    errors = [
        rotation_distance(tuple(one), tuple(other))
        for one, other in zip(result.quaternion[shown], truth[shown], strict=True)
    ]
    ratios = np.degrees(errors) / result.protection_level[shown]
    return max(ratios, default=0.0)


@pytest.mark.parametrize('alert_limit', ALERT_LIMITS)
@pytest.mark.parametrize('name', MOTIONS)
def test_no_healthy_orientation_is_further_off_than_its_level(name, alert_limit):
    assert largest_ratio(MOTIONS[name], alert_limit) <= 1.0


def test_elsewhere_such_a_rig_is_published():
    away = (0.2698919, 0.417398, 0.8353539, 0.2347791)
    ratio = largest_ratio(replace(MOTIONS['at rest'], quaternion=away), ALERT_LIMITS[0])
    assert 0.2 < ratio <= 1.0
