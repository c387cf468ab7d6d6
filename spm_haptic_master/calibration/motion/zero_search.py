# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zeros and directions of four encoders of which nothing is known but the drawing of the mechanism.

The four angles of a sample fit together if Case 2's linear system for the cosine and sine of th2A
(eqs. 15, 16) gives a point of the unit circle. Divided by the length of its gradient that is an
angle: how far the four are from the nearest ones that fit. It needs no start and no orientation,
so that thousands of guesses are improved at once, each on some hundred samples.

A guess is a pose within reach at one sample: it gives all four zeros, for each of the sixteen
combinations of directions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import cos, radians, sin

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.kinematics import Geometry, inverse, matrix_from_quaternion
from spm_haptic_master.kinematics.leg_kernels import (
    second_in_second_joint,
    turn_of_second_joint,
    turn_through_link,
)

Array = NDArray[np.float64]
# Cosine and sine of an angle.
Turn = tuple[Array, Array]

# Guesses for each combination of directions: one in five of the true combination leads to the
# true zeros after a motion of the whole workspace, one in thirty after a poor one.
GUESSES = 48
# Random orientations tried for each guess that is needed: about one in sixteen is within reach.
ORIENTATIONS = 40
# Steps of a guess, of all of them and of the better half.
FIRST_STEPS = 10
STEPS = 30
# Part of the guesses that are improved to the end (unit 1).
BETTER = 0.25
# Step of the angles in the forward differences (rad).
DIFFERENCE = 1e-5
# Distance at which a sample counts half (rad): a loss that outliers do not rule.
HALF_WEIGHT = 0.05
# Least length of the gradient (unit 1): less is a pose where the four angles always fit.
GRADIENT_FLOOR = 1e-3
# Damping at the start, and its factors after a better and a worse step (unit 1).
DAMPING, BETTER_STEP, WORSE_STEP = 1e-2, 0.3, 4.0
# Distance of the zeros below which two guesses have come to the same (rad).
SAME = radians(1.0)


@dataclass(frozen=True, slots=True)
class ZeroGuess:
    """Zeros and directions that a search found."""

    direction: tuple[int, ...]  # 1 or -1 of each of four
    zeros: Array  # reading at the joint's zero, rad, with its direction, (4,)
    misfit: float  # median distance of the samples' angles from angles that fit together, rad


def search_zeros(readings: Array, nominal: Geometry, working_mode: tuple[int, int, int],
                 seed: int, guesses: int = GUESSES,
                 progress: Callable[[float], None] = lambda share: None) -> list[ZeroGuess]:
    """
    Return different zeros and directions that explain samples, the best first.

    The readings, (n, 4), of th1A, th1B, th1C, th3A, rad, have direction 1 and zero 0 and are far
    from each other; the guesses, so many for each combination of directions, are made at the
    first, a middle one. The same seed gives the same result.
    """
    reachable = _poses(guesses, nominal, working_mode, seed)
    combinations = list(product((1, -1), repeat=4))
    found = []
    for number, direction in enumerate(combinations):
        turned = readings * np.array(direction)
        zeros = turned[0] - reachable
        zeros, cost, damping = _improve(turned, zeros, nominal, FIRST_STEPS)
        best = np.argsort(cost)[:max(1, int(BETTER * len(cost)))]
        zeros, cost, _ = _improve(turned, zeros[best], nominal, STEPS, damping[best])
        misfit = np.median(np.abs(_distance(turned, zeros, nominal)[0]), axis=1)
        found += [ZeroGuess(direction, each, float(of))
                  for each, of in zip(zeros, misfit, strict=True)]
        progress((number + 1) / len(combinations))
    return _different(sorted(found, key=lambda guess: guess.misfit))


def _poses(count: int, nominal: Geometry, working_mode: tuple[int, int, int],
           seed: int) -> Array:
    """Return the four angles, rad, shape (count, 4), of random poses within reach."""
    random = np.random.default_rng(seed)
    angles = np.empty((0, 4))
    while len(angles) < count:
        quaternions = random.normal(size=(ORIENTATIONS * count, 4))
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        of = inverse(matrix_from_quaternion(quaternions), nominal, working_mode)
        more = np.column_stack([of.theta1, of.theta3a])
        angles = np.vstack([angles, more[np.isfinite(more).all(axis=1)]])
    return angles[:count]


def _different(guesses: list[ZeroGuess]) -> list[ZeroGuess]:
    """Return guesses without those that have come to the same as an earlier one."""
    kept: list[ZeroGuess] = []
    for guess in guesses:
        if not any(guess.direction == other.direction
                   and np.abs(np.angle(np.exp(1j * (guess.zeros - other.zeros)))).max() < SAME
                   for other in kept):
            kept.append(guess)
    return kept


def _improve(turned: Array, zeros: Array, nominal: Geometry, steps: int,
             damping: Array | None = None) -> tuple[Array, Array, Array]:
    """Return zeros, shape (m, 4), after Levenberg-Marquardt steps, their costs and damping."""
    if damping is None:
        damping = np.full(len(zeros), DAMPING)
    distance, slopes = _distance(turned, zeros, nominal)
    cost: Array = _cost(distance)
    for _ in range(steps):
        weights = 1.0 / (1.0 + np.square(distance / HALF_WEIGHT))
        weighted = (weights[:, :, None] * slopes).swapaxes(1, 2)
        matrix = weighted @ slopes
        matrix += (damping * np.trace(matrix, axis1=1, axis2=2) / 4.0 + 1e-12)[:, None, None] \
            * np.eye(4)
        moved = zeros - np.linalg.solve(matrix, weighted @ distance[:, :, None])[:, :, 0]
        after, slopes_after = _distance(turned, moved, nominal)
        cost_after = _cost(after)
        better = cost_after < cost
        damping = damping * np.where(better, BETTER_STEP, WORSE_STEP)
        zeros, cost = np.where(better[:, None], moved, zeros), np.where(better, cost_after, cost)
        distance = np.where(better[:, None], after, distance)
        slopes = np.where(better[:, None, None], slopes_after, slopes)
    return zeros, cost, damping


def _cost(distance: Array) -> Array:
    found: Array = np.log1p(np.square(distance / HALF_WEIGHT)).mean(axis=1)
    return found


def _distance(turned: Array, zeros: Array, nominal: Geometry) -> tuple[Array, Array]:
    """
    Return how far samples are from angles that fit together, and the derivatives by the zeros.

    Shapes (m, n) and (m, n, 4), rad, for m sets of zeros and n samples.
    """
    # Cosines and sines of the joint angles, by those of readings and zeros.
    readings = zip(np.cos(turned).T[:, None], np.sin(turned).T[:, None], strict=True)
    at_zero = zip(np.cos(zeros).T[:, :, None], np.sin(zeros).T[:, :, None], strict=True)
    turns = [(c * c0 + s * s0, s * c0 - c * s0)
             for (c, s), (c0, s0) in zip(readings, at_zero, strict=True)]
    here = _closure(turns, nominal)
    slopes = np.stack([
        (_closure([*turns[:index], _onward(turns[index]), *turns[index + 1:]], nominal)
         - here) / DIFFERENCE for index in range(4)], axis=-1)
    scale = 1.0 / np.sqrt((slopes ** 2).sum(axis=-1) + GRADIENT_FLOOR ** 2)
    return here * scale, -slopes * scale[:, :, None]


def _onward(turn: Turn) -> Turn:
    """Return cosine and sine of an angle that is larger by `DIFFERENCE`."""
    (c, s), (c_more, s_more) = turn, (cos(DIFFERENCE), sin(DIFFERENCE))
    return c * c_more - s * s_more, s * c_more + c * s_more


def _closure(turns: list[Turn], nominal: Geometry) -> Array:
    """Return by how much the point of Case 2's linear system misses the unit circle (unit 1)."""
    (c1, s1), *others, (c3, s3) = turns
    leg_b, leg_c = (
        (second_in_second_joint(c1, s1, c, s, carried),
         turn_through_link(c3, s3, carried.before_distal), carried.cos_beta)
        for (c, s), carried in zip(others, nominal.carried, strict=True))
    cosine, sine, determinant = turn_of_second_joint(leg_b, leg_c)
    return np.asarray(cosine * cosine + sine * sine - determinant * determinant)
