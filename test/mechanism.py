# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rotations in plain matrices, independent of the package; working modes, workspace's centre."""

import math

import numpy as np

MODES = [(a, b, c) for a in (1, -1) for b in (1, -1) for c in (1, -1)]
# Rotation of the base frame of leg A to that of leg B: z to x to y.
LEG_TURN = np.array(
    [
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
    ]
)

# ZXZ angles psi, theta of the workspace's centre (rad).
CENTRE = math.radians(135.0), math.acos(1.0 / math.sqrt(3.0))

# Self-rotation of the parallel singularity at the centre (rad), by bisection of det A.
SINGULAR_PHI = math.radians(49.358591780)


def about_z(angle):
    """Matrix of a turn about z, rad."""
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array(
        [
            [c, -s, 0.0],
            [s, c, 0.0],
            [0.0, 0.0, 1.0],
        ]
    )


def about_x(angle):
    """Matrix of a turn about x, rad."""
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, c, -s],
            [0.0, s, c],
        ]
    )


def zxz(psi, theta, phi):
    """Matrix of ZXZ Euler angles, rad."""
    return about_z(psi) @ about_x(theta) @ about_z(phi)


def turn(vector):
    """Matrix of a rotation vector, rad (Rodrigues)."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array(
        [
            [0.0, -z, y],
            [z, 0.0, -x],
            [-y, x, 0.0],
        ]
    )
    return np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k


def small_vector(matrices):
    """Rotation vectors of small rotations, to third order, (..., 3)."""
    return 0.5 * np.stack(
        [
            matrices[..., 2, 1] - matrices[..., 1, 2],
            matrices[..., 0, 2] - matrices[..., 2, 0],
            matrices[..., 1, 0] - matrices[..., 0, 1],
        ],
        axis=-1,
    )


def angle_between(p, q):
    """Angle between two rotations, rad; good for small ones too."""
    distance = np.linalg.norm(np.asarray(p) - q)
    sine_of_half = distance / math.sqrt(8.0)
    return 2.0 * math.asin(min(1.0, sine_of_half))


def tilted(phi, tilt, azimuth):
    """Turn the workspace's centre at phi by tilt about an axis perpendicular to (1, 1, 1)."""
    first = np.array([1.0, -1.0, 0.0]) / math.sqrt(2.0)
    second = np.array([1.0, 1.0, -2.0]) / math.sqrt(6.0)
    axis = math.cos(azimuth) * first + math.sin(azimuth) * second
    return turn(tilt * axis) @ zxz(*CENTRE, phi)


def random_rotations(rng, count):
    """Draw rotations from the uniform distribution, (count, 3, 3)."""
    x, y, z, w = rng.normal(size=(4, count))
    double = 2.0 / (x * x + y * y + z * z + w * w)
    flat = np.stack(
        [
            1.0 - double * (y * y + z * z),
            double * (x * y - z * w),
            double * (x * z + y * w),
            double * (x * y + z * w),
            1.0 - double * (x * x + z * z),
            double * (y * z - x * w),
            double * (x * z - y * w),
            double * (y * z + x * w),
            1.0 - double * (x * x + y * y),
        ],
        -1,
    )
    return flat.reshape(count, 3, 3)
