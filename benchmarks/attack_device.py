# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The device that `benchmarks.integrity_attack` attacks: a leg model of its own, in numpy.

The axes are those of the oracle in `test/built_mechanism.py`; nothing here uses the package's
kinematics. A rival is another orientation at which some of the sensors read what they read now.
"""

from __future__ import annotations

from pathlib import Path
import sys
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from built_mechanism import nominal, smallest_turn  # noqa: E402, I100
from mechanism import about_z, random_rotations  # noqa: E402, I100

Array = Any

# The rig's working mode: side of the legs' second axes.
RIG_MODE = (1, 1, 1)
# Starts of a search for rivals around an orientation, and iterations from each.
STARTS = 40
ITERATIONS = 10
# Largest step of an iteration (rad), and farthest start (rad).
LARGEST_STEP = 0.4
FARTHEST_START = 1.2
# Rounds of a search for where some sensors determine no orientation.
ROUNDS = 12
# Least distance of a rival for four sensors (rad).
LEAST_MEETING = np.radians(1.0)
# Rotation of a difference quotient (rad).
DIFFERENCE = 1e-7
# Largest misfit of a rival (rad), and least distance of two of them (rad).
MISFIT = 1e-8
APART = np.radians(0.05)


def turns(vectors: Array) -> Array:
    """Return the rotations of rotation vectors, rad, (..., 3, 3) (Rodrigues)."""
    angles = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(np.asarray(vectors), -1, 0)
    zero = np.zeros_like(x)
    rows = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    product = np.moveaxis(rows, (0, 1), (-2, -1))
    # sin(a) / a and (1 - cos(a)) / a^2, both defined at zero.
    first = np.sinc(angles / np.pi)
    second = 0.5 * np.sinc(0.5 * angles / np.pi) ** 2
    return np.eye(3) + first * product + second * product @ product


def matrices(quaternions: Array) -> Array:
    """Return the rotations of unit quaternions x, y, z, w, (n, 3, 3)."""
    x, y, z, w = np.moveaxis(np.asarray(quaternions), -1, 0)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def wrapped(angles: Array) -> Array:
    """Return angles within half a turn, rad."""
    return np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi


def cross(vectors: Array, others: Array) -> Array:
    """Return the vector products of vectors, (..., 3)."""
    return (
        vectors[..., [1, 2, 0]] * others[..., [2, 0, 1]]
        - vectors[..., [2, 0, 1]] * others[..., [1, 2, 0]]
    )


def angle_between(rotations: Array, others: Array) -> Array:
    """Return the angles between rotations, rad, (...)."""
    chord = np.linalg.norm(rotations - others, axis=(-2, -1)) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(chord, 1.0))


DIFFERENCE_TURNS = turns(DIFFERENCE * np.vstack([np.zeros(3), np.eye(3)]))


class Device:
    """
    A mechanism with nominal axes.

    Parameters
    ----------
    angles : tuple of float
        Link angles alpha, beta, gamma, rad.
    mode : tuple of int
        Working mode: signs of Z1k . (Z2k x Z3k).

    """

    def __init__(self, angles: tuple[float, ...], mode: tuple[int, ...] = RIG_MODE) -> None:
        self._built = nominal(*angles)
        self._mode = np.array(mode, float)
        # Where the first link's normal points with th1 at zero, and a platform's vector that
        # points along the second link's normal with th3 at zero; one row a leg.
        self._sides = np.array(
            [
                np.cross(first, second) / np.linalg.norm(np.cross(first, second))
                for first, second, _, _ in self._built.zero
            ]
        )
        self._besides = np.array(
            [
                smallest_turn(np.array([0.0, 0.0, 1.0]), axis)
                @ about_z(2.0 * np.pi * leg / 3.0)[:, 0]
                for leg, axis in enumerate(self._built.platform)
            ]
        )

    def readings(self, rotations: Array) -> Array:
        """
        Return th1A, th1B, th1C, th3A, th3B, th3C at orientations, rad, (..., 6).

        NaN where a leg does not reach.
        """
        built = self._built
        first = np.broadcast_to(built.base, rotations.shape)
        third = built.third_axes(rotations)
        along = (first * third).sum(-1)
        squared_sine = 1.0 - along**2
        # The second axis is at alpha from the first one and at beta from the third.
        on_first = (np.cos(built.alpha) - along * np.cos(built.beta)) / squared_sine
        on_third = (np.cos(built.beta) - along * np.cos(built.alpha)) / squared_sine
        rest = 1.0 - on_first**2 - on_third**2 - 2.0 * on_first * on_third * along
        with np.errstate(invalid='ignore'):
            across = -self._mode * np.sqrt(rest / squared_sine)
        second = (
            on_first[..., None] * first
            + on_third[..., None] * third
            + across[..., None] * cross(first, third)
        )
        beside = np.einsum('...ij,kj->...ki', rotations, self._besides)
        th1 = _signed_angle(self._sides, cross(first, second), first)
        th3 = _signed_angle(cross(second, third), beside, third)
        return np.concatenate([th1, th3], axis=-1)

    def rates(self, rotations: Array) -> Array:
        """Return how readings change with a rotation in the base frame, (..., 6, 3)."""
        turned = DIFFERENCE_TURNS.reshape(4, *(1,) * (rotations.ndim - 2), 3, 3) @ rotations
        here, *ahead = self.readings(turned)
        return np.stack([wrapped(each - here) for each in ahead], axis=-1) / DIFFERENCE

    def rivals(self, rotation: Array, kept: tuple[int, ...], rng: np.random.Generator) -> Array:
        """
        Return other orientations at which three sensors read what they read at `rotation`.

        Gauss-Newton from random orientations; (n, 3, 3), the nearest ones first.
        """
        kept_rows = list(kept)
        target = self.readings(rotation)[kept_rows]
        found = np.concatenate([random_rotations(rng, 10 * STARTS), self._near(rotation, rng)])
        for _ in range(ITERATIONS):
            found, readings, rates = self._reached(found)
            misfit = wrapped(readings[:, kept_rows] - target)
            found = _moved(found, _least_squares(rates[:, kept_rows], -misfit))
        misfit = wrapped(self.readings(found)[:, kept_rows] - target)
        return distinct(found[np.abs(misfit).max(-1, initial=0.0) < MISFIT], rotation)

    def meeting(
        self, kept: tuple[int, ...], begin: Array, axis: Array, rng: np.random.Generator
    ) -> tuple[Array, Array] | None:
        """
        Return an orientation turned from `begin` about `axis` that has a rival for four sensors.

        The rival is at least `LEAST_MEETING` away; None if none is found.
        """
        kept_rows = list(kept)
        rivals = self._near(begin, rng)
        shifts = rng.uniform(-0.4, 0.4, len(rivals))
        for _ in range(ITERATIONS):
            places = turns(shifts[:, None] * axis) @ begin
            rates = np.concatenate(
                [self.rates(rivals), -(self.rates(places) @ axis)[..., None]], axis=-1
            )[:, kept_rows]
            misfit = wrapped(self.readings(rivals) - self.readings(places))[:, kept_rows]
            finite = np.isfinite(rates).all((-2, -1)) & np.isfinite(misfit).all(-1)
            steps = _least_squares(rates[finite], -misfit[finite])
            rivals = _moved(rivals[finite], steps[:, :3])
            shifts = shifts[finite] + np.clip(steps[:, 3], -LARGEST_STEP, LARGEST_STEP)
        places = turns(shifts[:, None] * axis) @ begin
        misfit = wrapped(self.readings(rivals) - self.readings(places))[:, kept_rows]
        fits = np.abs(misfit).max(-1, initial=0.0) < MISFIT
        fits &= (angle_between(rivals, places) > LEAST_MEETING) & (np.abs(shifts) < 1.0)
        if not fits.any():
            return None
        chosen = rng.choice(np.flatnonzero(fits))
        return places[chosen], rivals[chosen]

    def undetermined(self, kept: tuple[int, ...], begin: Array, rng: np.random.Generator) -> Array:
        """Return an orientation near another that some sensors determine hardly, (3, 3)."""
        best = begin
        for reach in np.linspace(FARTHEST_START, 0.01, ROUNDS):
            axes = rng.normal(size=(STARTS, 3))
            near, _, rates = self._reached(turns(0.5 * reach * axes) @ best)
            if len(near):
                least = np.linalg.svd(rates[:, list(kept)], compute_uv=False)[:, -1]
                best = near[int(np.argmin(least))]
        return best

    def _near(self, rotation: Array, rng: np.random.Generator) -> Array:
        """Return random orientations around one, (n, 3, 3)."""
        axes = rng.normal(size=(STARTS, 3))
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        sizes = rng.uniform(0.0, FARTHEST_START, STARTS)
        return turns(axes * sizes[:, None]) @ rotation

    def _reached(self, rotations: Array) -> tuple[Array, Array, Array]:
        """Return the orientations that all legs reach, with their readings and rates."""
        readings = self.readings(rotations)
        rates = self.rates(rotations)
        finite = np.isfinite(rates).all((-2, -1)) & np.isfinite(readings).all(-1)
        return rotations[finite], readings[finite], rates[finite]


def distinct(rotations: Array, apart_from: Array) -> Array:
    """Return rotations once each, without the given one, the nearest to it first, (n, 3, 3)."""
    distances = angle_between(rotations, apart_from)
    kept: list[Array] = [apart_from]
    for index in np.argsort(distances):
        if min(angle_between(np.array(kept), rotations[index])) > APART:
            kept.append(rotations[index])
    return np.array(kept[1:]).reshape(-1, 3, 3)


def _signed_angle(start: Array, end: Array, axis: Array) -> Array:
    """Return the angles from vectors to others about axes, rad, (...)."""
    return np.arctan2((cross(start, end) * axis).sum(-1), (start * end).sum(-1))


def _least_squares(rates: Array, wanted: Array) -> Array:
    """Return the smallest steps that change readings as wanted, (n, columns)."""
    return (np.linalg.pinv(rates, rcond=1e-6) @ wanted[..., None])[..., 0]


def _moved(rotations: Array, steps: Array) -> Array:
    """Return rotations turned by vectors, rad, each shortened to the largest step."""
    sizes = np.linalg.norm(steps, axis=1)[:, None]
    return turns(steps * np.minimum(1.0, LARGEST_STEP / np.maximum(sizes, 1e-12))) @ rotations
