# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings at a pose, estimates from them and their bound, and poses at the limits."""

from contextlib import suppress
import math

from built_mechanism import nominal
from mechanism import turn, zxz
import numpy as np
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics import estimate, Geometry, inverse, jacobian
from spm_haptic_master.kinematics.leg_kernels import linkage, turn_of_second_joint
from spm_haptic_master.kinematics.number_backends import FLOATS

PAPER = Geometry()
# Standard deviation of the rig's sensors, and six that differ (rad).
SIGMA = math.radians(0.04)
UNEQUAL = SIGMA * np.array([1.0, 2.0, 0.5, 1.5, 0.8, 1.2])


def all_angles(R, g=PAPER, mode=(1, 1, 1)):
    """Return the true readings of six sensors."""
    joints = inverse(R, g, mode)
    theta3 = np.stack(
        [
            joints.theta3a,
            joints.theta3b,
            joints.theta3c,
        ],
        axis=-1,
    )
    return np.concatenate([joints.theta1, theta3], axis=-1)


def four_angles(R, g=PAPER, mode=(1, 1, 1)):
    """Return the true readings th1A, th1B, th1C, th3A."""
    return all_angles(R, g, mode)[..., :4]


def wrapped(angles):
    """Angles into ]-pi, pi]."""
    return np.angle(np.exp(1j * np.asarray(angles)))


def differences(R, g=PAPER, mode=(1, 1, 1), step=1e-5):
    """Rates of six sensors along turns about the base axes, by central differences, (6, 3)."""
    rates = []
    for axis in np.eye(3):
        ahead = all_angles(turn(step * axis) @ R, g, mode)
        behind = all_angles(turn(-step * axis) @ R, g, mode)
        rates.append(wrapped(ahead - behind) / (2.0 * step))
    return np.stack(rates, axis=-1)


def estimated(readings, sigma=SIGMA, g=PAPER, **options):
    """Estimate from readings (..., N)."""
    further = np.moveaxis(readings[..., 4:], -1, 0)
    more = dict(zip(('theta3b', 'theta3c'), further, strict=False))
    return estimate(
        readings[..., :3],
        readings[..., 3],
        sigma,
        g,
        **more,
        **options,
    )


def bound(R, sigma, g=PAPER, mode=(1, 1, 1), sensors=4):
    """Cramer-Rao bound: covariance of the rotation vector, from the Jacobian."""
    deviations = np.broadcast_to(sigma, sensors)
    G = jacobian(R, g, mode, sensors) / deviations[:, None]
    return np.linalg.inv(G.T @ G)


def case_2_determinant(readings, g=PAPER):
    """Return the determinant of the closed form of th1A, th1B, th1C, th3A."""
    _, _, leg_b, leg_c = linkage(*np.asarray(readings).tolist(), g, FLOATS)
    return turn_of_second_joint(leg_b, leg_c)[2]


def pose_of_zero(function, built, rng, longest):
    """Find a pose where a function of poses changes sign, by bisection along random turns."""
    while True:
        R = built.reachable_rotation(rng, 0.1)
        axis = longest * rng.normal(size=3)
        with suppress(UnreachableError):
            start = function(R)
            end = function(turn(axis) @ R)
            low = 0.0
            high = 1.0
            for _ in range(60 if start * end < 0.0 else 0):
                middle = 0.5 * (low + high)
                if function(turn(middle * axis) @ R) * start > 0.0:
                    low = middle
                else:
                    high = middle
            if low > 0.0:
                return turn(low * axis) @ R


def near_boundary(leg, size):
    """Pose at which B_kk of one leg has this size, and the other legs are well within reach."""
    rng = np.random.default_rng(80)
    # B_kk = sin alpha sin beta sin th2k.
    sine = size / (math.sin(PAPER.alpha) * math.sin(PAPER.beta))
    th2a = math.asin(sine)
    while True:
        R = nominal().chain(
            0,
            rng.uniform(-3.0, 3.0),
            th2a,
            rng.uniform(-3.0, 3.0),
        )
        if nominal().margins(R)[1:].min() > 0.15:
            break
    # Leg B or C is leg A in a platform turned about (1, 1, 1).
    third = 2.0 * math.pi / 3.0
    base = turn(np.full(3, third / math.sqrt(3.0)))
    platform = zxz(0.0, 0.0, -third)
    for _ in range(leg):
        R = base @ R @ platform
    return R
