# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig that is simulated: its mechanism as built, and the errors of its sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, hypot, sin
import random

from spm_haptic_master.kinematics import Geometry, in_usual_frames
from spm_haptic_master.kinematics.joints import JOINT_NAMES

# Cosine and sine coefficient of a harmonic.
Harmonic = tuple[float, float]


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """What distinguishes one sensor's reading from the joint angle; all 0: nothing."""

    # Cosine and sine coefficient of the error over one turn of the joint angle, rad: the encoder's
    # eccentricity, and what repeats twice a turn.
    first_harmonic: Harmonic = (0.0, 0.0)
    second_harmonic: Harmonic = (0.0, 0.0)
    play: float = 0.0  # width of the play between joint and encoder, rad
    noise: float = 0.0  # standard deviation, rad
    resolution: float = 0.0  # smallest change of the reading, rad; 0: that of the counts
    delay: float = 0.0  # age of the angle when the sensor is read, s

    def with_harmonics(self, angle: float) -> float:
        """Return the angle that the encoder measures at a joint angle, rad, without noise."""
        c1, s1 = self.first_harmonic
        c2, s2 = self.second_harmonic
        return angle + c1 * cos(angle) + s1 * sin(angle) \
            + c2 * cos(2.0 * angle) + s2 * sin(2.0 * angle)


@dataclass(frozen=True, slots=True)
class Rig:
    """A simulated rig of four, five or six sensors."""

    geometry: Geometry  # its mechanism
    sensors: tuple[SensorErrors, ...]  # in the order of ALL_JOINT_NAMES

    @property
    def has_harmonics(self) -> bool:
        """Whether any encoder's error repeats with its turn."""
        return any(any(each.first_harmonic + each.second_harmonic) for each in self.sensors)


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Standard deviations of what a random rig is off by, rad."""

    links: float = 0.0  # of each of the six link angles
    axes: float = 0.0  # of each of the six axes in either direction
    first_harmonic: float = 0.0  # of each coefficient of the encoders' harmonics
    second_harmonic: float = 0.0


def perfect_rig(geometry: Geometry, noise: float, sensors: int = len(JOINT_NAMES)) -> Rig:
    """Return a rig as drawn, with noise of a standard deviation in rad on each sensor."""
    return Rig(geometry, (SensorErrors(noise=noise),) * sensors)


def random_rig(seed: int, tolerances: Tolerances, geometry: Geometry | None = None,
               noise: float = 0.0, sensors: int = len(JOINT_NAMES)) -> Rig:
    """
    Return a rig that deviates from a mechanism (the paper's); noise in rad on each sensor.

    All deviations are normal, and for one seed in proportion to the tolerances; more sensors leave
    the others as they are. Its frames are those of `in_usual_frames`. GeometryError: an impossible
    mechanism.
    """
    nominal = geometry or Geometry()
    gauss = random.Random(seed).gauss

    def angles(nominal_angles: Sequence[float]) -> list[float]:
        return [angle + tolerances.links * gauss(0.0, 1.0) for angle in nominal_angles]

    def axes(nominal_axes: Sequence[Sequence[float]]) -> list[list[float]]:
        moved = [[each + tolerances.axes * gauss(0.0, 1.0) for each in axis]
                 for axis in nominal_axes]
        return [[each / hypot(*axis) for each in axis] for axis in moved]

    def harmonic(deviation: float) -> Harmonic:
        return deviation * gauss(0.0, 1.0), deviation * gauss(0.0, 1.0)

    alphas, betas = angles(nominal.alphas), angles(nominal.betas)
    base, platform = axes(nominal.base_axes), axes(nominal.platform_axes)
    built = in_usual_frames(Geometry.from_axes(base, platform, alphas, betas), nominal)
    return Rig(built, tuple(
        SensorErrors(harmonic(tolerances.first_harmonic), harmonic(tolerances.second_harmonic),
                     noise=noise) for _ in range(sensors)))
