# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A mechanism whose axes miss the centre: joint angles by numeric loop closure of its legs.

A leg is Rz(th1) Rx(alpha) Rz(th2) Rx(beta) Rz(th3) with an offset of each axis, and ends at
the platform. Three such legs are overconstrained: they close as far as joints and links give.
The nine angles and the platform's position are those of the least gap, with a turn at radius
`RADIUS` as stiff as a shift.
"""

from math import radians

from mechanism import about_x, about_z, LEG_TURN, small_vector
import numpy as np
from spm_haptic_master.kinematics.inverse_model import mechanism_angles

# Radius of the links (mm), and steps of Newton's method.
RADIUS = 100.0
STEPS = 3
# The drawing's angle between Z_E and the platform's axes.
GAMMA = radians(18.2)
# Step of the differences (rad, or units of the radius).
DIFFERENCE = 1e-6


def closed_angles(poses, offsets_mm, geometry):
    """
    Return th1A, th1B, th1C, th3A at orientations, rad, shape (n, 4).

    `offsets_mm`, (3, 3, 3), are those of the axes of each leg's joints 1, 2, 3 in the frame of
    the joint; the drawing has nominal axes.
    """
    # From the angles of the concentric mechanism.
    angles = [mechanism_angles(pose.ravel().tolist(), geometry) for pose in poses]
    unknown = np.hstack([angles, np.zeros((len(poses), 3))])

    def gap_of(unknown):
        return _gap(poses, unknown, offsets_mm / RADIUS, geometry)

    for _ in range(STEPS):
        gap = gap_of(unknown)
        slopes = []
        for direction in np.eye(12):
            ahead = gap_of(unknown + DIFFERENCE * direction)
            slopes.append((ahead - gap) / DIFFERENCE)
        columns = np.stack(slopes, axis=2)
        rows = columns.swapaxes(1, 2)
        step = np.linalg.solve(rows @ columns, rows @ gap[:, :, None])
        unknown = unknown - step[:, :, 0]
    return unknown[:, [0, 3, 6, 2]]


def _gap(poses, unknown, offsets, geometry):
    """Return by how much the legs miss the platform, shape (n, 18), units of the radius."""
    gaps = []
    for leg in range(3):
        base = np.linalg.matrix_power(LEG_TURN, leg)
        platform = about_z(radians(120.0 * leg)) @ about_x(-GAMMA)
        th1, th2, th3 = unknown[:, 3 * leg : 3 * leg + 3].T
        rotation = base @ _turn(th1)
        place = base @ offsets[leg, 0]
        for link, angle, offset in (
            (geometry.alphas[leg], th2, offsets[leg, 1]),
            (geometry.betas[leg], th3, offsets[leg, 2]),
        ):
            rotation = rotation @ about_x(link)
            place = place + rotation @ offset
            rotation = rotation @ _turn(angle)
        miss = rotation @ platform.T @ poses.swapaxes(1, 2)
        gaps += [small_vector(miss), place - unknown[:, 9:]]
    return np.hstack(gaps)


def _turn(angles):
    """Return rotations about z by angles, shape (n, 3, 3)."""
    c = np.cos(angles)
    s = np.sin(angles)
    o = np.zeros_like(angles)
    rows = [
        np.stack([c, -s, o], 1),
        np.stack([s, c, o], 1),
        np.stack([o, o, o + 1.0], 1),
    ]
    return np.stack(rows, axis=1)
