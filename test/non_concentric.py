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

from mechanism import about_x, LEG_TURN
import numpy as np
from spm_haptic_master.kinematics import inverse

# Radius of the links (mm), and steps of Newton's method.
RADIUS, STEPS = 100.0, 3
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
    found = inverse(poses, geometry)
    first, third = found.theta1, np.column_stack([found.theta3a, found.theta3b, found.theta3c])
    legs = [_leg(leg, offsets_mm[leg] / RADIUS, geometry) for leg in range(3)]
    unknown = np.zeros((len(poses), 12))
    for leg in range(3):
        # th2 from the closure of the concentric leg.
        before, after = _turn(first[:, leg]) @ about_x(geometry.alphas[leg]), about_x(
            geometry.betas[leg]) @ _turn(third[:, leg])
        base, platform = legs[leg][2:]
        middle = before.swapaxes(1, 2) @ (base.T @ poses @ platform) @ after.swapaxes(1, 2)
        unknown[:, 3 * leg:3 * leg + 3] = np.column_stack([
            first[:, leg], np.arctan2(middle[:, 1, 0], middle[:, 0, 0]), third[:, leg]])
    for _ in range(STEPS):
        gap = _gap(poses, unknown, legs)
        slopes = np.stack([(_gap(poses, unknown + DIFFERENCE * np.eye(12)[at], legs) - gap)
                           / DIFFERENCE for at in range(12)], axis=2)
        turned = slopes.swapaxes(1, 2)
        unknown = unknown - np.linalg.solve(turned @ slopes, turned @ gap[:, :, None])[:, :, 0]
    return unknown[:, [0, 3, 6, 2]]


def _leg(leg, offsets, geometry):
    """Return links and offsets of a leg, and its frames at base and platform."""
    base = np.linalg.matrix_power(LEG_TURN, leg)
    platform = _turn(np.array([radians(120.0 * leg)]))[0] @ about_x(-GAMMA)
    return (geometry.alphas[leg], geometry.betas[leg]), offsets, base, platform


def _gap(poses, unknown, legs):
    """Return by how much the legs miss the platform, shape (n, 18), units of the radius."""
    gaps = []
    for leg, ((alpha, beta), offsets, base, platform) in enumerate(legs):
        th1, th2, th3 = unknown[:, 3 * leg:3 * leg + 3].T
        rotation = base @ _turn(th1)
        place = base @ offsets[0] + np.zeros((len(poses), 3))
        for link, angle, offset in ((alpha, th2, offsets[1]), (beta, th3, offsets[2])):
            rotation = rotation @ about_x(link)
            place = place + rotation @ offset
            rotation = rotation @ _turn(angle)
        miss = rotation @ platform.T @ poses.swapaxes(1, 2)
        gaps += [0.5 * (miss[:, 2, 1] - miss[:, 1, 2])[:, None],
                 0.5 * (miss[:, 0, 2] - miss[:, 2, 0])[:, None],
                 0.5 * (miss[:, 1, 0] - miss[:, 0, 1])[:, None], place - unknown[:, 9:]]
    return np.hstack(gaps)


def _turn(angles):
    """Return rotations about z by angles, shape (n, 3, 3)."""
    c, s, o = np.cos(angles), np.sin(angles), np.zeros_like(angles)
    return np.stack([np.stack([c, -s, o], 1), np.stack([s, c, o], 1),
                     np.stack([o, o, o + 1.0], 1)], axis=1)
