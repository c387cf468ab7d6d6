# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Protection level and isolable step of sensors on any of the nine joints, in batches."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

import numpy as np
from spm_haptic_master.kinematics import Geometry, inverse, jacobian
from spm_haptic_master.kinematics.leg_kernels import second_axis
from spm_haptic_master.supervision.protection import MISSED_DETECTION

# Standard deviation and nominal bias of every sensor (deg), and number of samples of the test.
SIGMA, BIAS, WINDOW = 0.04, 0.05, 20
# Standard deviations of the window's mean beyond which a fault is reported: one false alarm in
# 10,000 hours.
FALSE_ALARM = 6.9
# Standard deviations of the window's mean that a fault of no other sensor may explain.
ISOLATION = 5.0
# Smallest length of a column of P, or distance of two, that is not rounding (unit 1).
ROUNDING = 1e-6
# The rig's joints with a sensor, the first three the motors.
ACTIVE = ('1A', '1B', '1C')


@dataclass(frozen=True, slots=True)
class Worth:
    """What sensors are worth at poses, (...); NaN out of reach."""

    # Protection level of any single fault, deg; infinite where a fault is not seen.
    levels: np.ndarray
    # Least step of the sensor that is isolated worst, deg; infinite where one is not.
    steps: np.ndarray
    # Standard deviation of the orientation of healthy sensors, deg.
    deviations: np.ndarray


def rates(poses: np.ndarray, geometry: Geometry) -> dict[str, np.ndarray]:
    """
    Return the rates of all nine joints along turns of the platform.

    By the joint, 1A, 2A, 3A, 1B, ..., (..., 3), unit 1, at poses (..., 3, 3); NaN out of reach.
    """
    th1 = inverse(poses, geometry).theta1
    G = jacobian(poses, geometry, sensors=6)
    found = {}
    for k, (name, leg) in enumerate(zip('ABC', geometry.legs, strict=True)):
        second = np.stack(second_axis(np.cos(th1[..., k]), np.sin(th1[..., k]), leg), axis=-1)
        first, third = G[..., k, :], G[..., 3 + k, :]
        # omega = th1k' Z1k + th2k' Z2k + th3k' Z3k, taken along Z2k.
        found[f'1{name}'], found[f'3{name}'] = first, third
        found[f'2{name}'] = second - leg.cos_alpha * first - leg.cos_beta * third
    return found


def worth(joints: dict[str, np.ndarray], sensors: Iterable[str]) -> Worth:
    """
    Return what sensors on some of the joints are worth, from the `rates` of these.

    The general form: H the rows of the sensors, K = pinv(H), P = I - H K. A fault of sensor i
    moves the orientation by |K_i| and the parity by |P_i|. The level is that of the largest ratio,
    times threshold, missed detection and the bound b sqrt(N) of what nominal biases b do to the
    parity.
    """
    H = np.stack([joints[name] for name in sensors], axis=-2)
    known = np.isfinite(H).all((-1, -2))
    H = np.where(known[..., None, None], H, 1.0)
    # The singularity of three sensors stays one: nothing is cut off but rounding.
    K = np.linalg.pinv(H, rcond=1e-12)
    N = H.shape[-2]
    P = np.eye(N) - H @ K
    turns, shares = (np.linalg.norm(each, axis=-2) for each in (K, P))
    noise = SIGMA / sqrt(WINDOW)
    reach = (FALSE_ALARM + MISSED_DETECTION) * noise + BIAS * sqrt(N)
    with np.errstate(divide='ignore', invalid='ignore'):
        levels = np.where(shares > ROUNDING, turns / shares, np.inf).max(-1) * reach
        # Of column i of P what is perpendicular to column j; their scalar product is P_ij.
        square = shares[..., :, None] ** 2 - (P / shares[..., None, :]) ** 2
        apart = np.sqrt(np.maximum(np.where(np.eye(N, dtype=bool), np.inf, square), 0.0)).min(-1)
        steps = np.where(apart > ROUNDING, ISOLATION * noise / apart, np.inf).max(-1)
    deviations = SIGMA * np.linalg.norm(K, axis=(-1, -2))
    levels, steps, deviations = (
        np.where(known, each, np.nan) for each in (levels, steps, deviations)
    )
    return Worth(levels, steps, deviations)
