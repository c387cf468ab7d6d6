# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mechanism as built a second time: as turns about its axes in space, in numpy's vectors.

Nothing here uses the package's formulas. A leg's joints are turns about the axes where they are
with all joints at zero (a product of exponentials), so that no frame is carried along a chain.
"""

from dataclasses import dataclass
from functools import cached_property
import math

from mechanism import about_x, about_z, LEG_TURN, random_rotations, turn
import numpy as np
from spm_haptic_master.kinematics import Geometry

# Link angles of the paper's mechanism (rad).
ALPHA, BETA, GAMMA = np.radians([39.3, 34.1, 18.2])


def smallest_turn(start, end):
    """Matrix of the smallest rotation from one unit vector to another."""
    normal = np.cross(start, end)
    sine = np.linalg.norm(normal)
    if sine < 1e-15:
        return np.eye(3)
    return turn(math.atan2(sine, start @ end) / sine * normal)


@dataclass
class Built:
    """A mechanism as built: axes in rows, link angles in rad."""

    base: np.ndarray
    platform: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray

    @cached_property
    def geometry(self):
        """Return the package's Geometry of this mechanism."""
        return Geometry.from_axes(self.base, self.platform, self.alpha, self.beta)

    @cached_property
    def zero(self):
        """Return each leg's Z1k, Z2k, Z3k and R with its joints at zero."""
        return [self._at_zero(k) for k in range(3)]

    def _at_zero(self, k):
        nominal = np.linalg.matrix_power(LEG_TURN, k)
        nominal_side, _, nominal_first = nominal.T
        first = self.base[k]
        side = smallest_turn(nominal_first, first) @ nominal_side
        second = turn(self.alpha[k] * side) @ first
        stretched = self.alpha[k] + self.beta[k]
        third = turn(stretched * side) @ first
        # Where the platform's third axis and the direction beside it are in the platform frame.
        on_platform = self.platform[k]
        drawn_beside, _, drawn = about_z(2.0 * math.pi * k / 3.0).T
        beside = smallest_turn(drawn, on_platform) @ drawn_beside
        here = np.stack([side, np.cross(third, side), third])
        there = np.stack([beside, np.cross(on_platform, beside), on_platform])
        return first, second, third, here.T @ there

    def chain(self, k, th1, th2, th3):
        """Orientation of a platform carried by leg k alone."""
        first, second, third, R = self.zero[k]
        return turn(th1 * first) @ turn(th2 * second) @ turn(th3 * third) @ R

    def second_axes(self, th1):
        """Z2A, Z2B, Z2C in the base frame."""
        axes = []
        for angle, (first, second, _, _) in zip(th1, self.zero, strict=True):
            axes.append(turn(angle * first) @ second)
        return np.array(axes)

    def third_axes(self, R):
        """Z3A, Z3B, Z3C in the base frame, (..., 3, 3)."""
        return self.platform @ np.swapaxes(R, -1, -2)

    def closures(self, th1, R):
        """Loop closure errors of the three legs, (..., 3)."""
        cosines = (self.second_axes(th1) * self.third_axes(R)).sum(-1)
        return cosines - np.cos(self.beta)

    def leg_volumes(self, th1, R):
        """B_kk = Z1k . (Z2k x Z3k) of the three legs, (..., 3)."""
        normals = np.cross(self.second_axes(th1), self.third_axes(R))
        return (self.base * normals).sum(-1)

    def working_mode(self, th1, R):
        """Return the signs of B_kk."""
        signs = np.sign(self.leg_volumes(th1, R))
        return tuple(signs.astype(int).tolist())

    def margins(self, R):
        """Angles from Z1k to Z3k within the limits of their reach, rad, (..., 3)."""
        cosines = (self.base * self.third_axes(R)).sum(-1)
        spans = np.arccos(np.clip(cosines, -1.0, 1.0))
        stretched = self.alpha + self.beta
        smallest = abs(self.alpha - self.beta)
        largest = np.minimum(stretched, 2.0 * math.pi - stretched)
        return np.minimum(spans - smallest, largest - spans)

    def reachable_rotation(self, rng, slack=0.05):
        """Draw a rotation within reach by `slack` rad."""
        while True:
            for R in random_rotations(rng, 50):
                if self.margins(R).min() > slack:
                    return R


def nominal(alpha=ALPHA, beta=BETA, gamma=GAMMA):
    """Return a nominal mechanism."""
    base = []
    platform = []
    for k in range(3):
        motor = np.linalg.matrix_power(LEG_TURN, k)
        joint = about_z(2.0 * math.pi * k / 3.0) @ about_x(-gamma)
        base.append(motor[:, 2])
        platform.append(joint[:, 2])
    return Built(
        np.array(base),
        np.array(platform),
        np.full(3, alpha),
        np.full(3, beta),
    )


def random_nominal(rng):
    """Draw a nominal mechanism that reaches about one rotation in a hundred or more."""
    while True:
        drawn = nominal(*rng.uniform(0.3, 2.4, 3))
        smallest_margins = drawn.margins(random_rotations(rng, 100)).min(-1)
        if smallest_margins.max() > 0.05:
            return drawn


def random_built(rng, deviation_deg=2.0, **angles):
    """Draw a mechanism with links and axes off by up to `deviation_deg`."""
    drawn = nominal(**angles)
    most = math.radians(deviation_deg)

    def off(axes):
        vectors = rng.normal(size=(3, 3))
        angles = most * rng.uniform(size=(3, 1))
        vectors *= angles / np.linalg.norm(vectors, axis=1, keepdims=True)
        turned = [turn(vector) @ axis for vector, axis in zip(vectors, axes, strict=True)]
        return np.array(turned)

    return Built(
        off(drawn.base),
        off(drawn.platform),
        drawn.alpha + rng.uniform(-most, most, 3),
        drawn.beta + rng.uniform(-most, most, 3),
    )
