# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zero counts and directions from known poses of a static jig.

One pose determines the zero counts for given directions. It does not determine a direction: with
the wrong one there is a zero count as well, and the angle is right at that pose and wrong
everywhere else. A second pose determines the direction of every joint that it moves far enough,
and every further one checks the poses against each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import degrees, hypot, radians

import numpy as np
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.kinematics import (
    Geometry,
    jacobian,
    matrix_from_zxz,
    measured_angles,
    zxz_rotation,
)
from spm_haptic_master.kinematics.rotations import wrapped

# Least motion of a joint between two poses (rad) that determines its direction.
TRAVEL_MINIMUM = radians(1.0)
# Largest difference between the motion by the counts and the motion by the poses, as a part of
# the latter: beyond it the encoder slipped on its shaft.
TRAVEL_MISMATCH = 0.25


@dataclass(frozen=True, slots=True)
class Station:
    """
    Readings at one pose of the jig.

    Attributes
    ----------
    pose : tuple of 3 float
        Pose of the jig: psi, theta, phi (ZXZ), rad.
    angles : tuple of N float
        Angles of the N = 4, 5 or 6 sensors' joints at that pose, rad, as the encoders read them:
        with their harmonics.
    counts, sigma : tuple of N float
        Mean counts, and noise in rad, of each sensor.
    sets : int
        Number of sets averaged.

    """

    pose: tuple[float, ...]
    angles: tuple[float, ...]
    counts: tuple[float, ...]
    sigma: tuple[float, ...]
    sets: int


@dataclass(frozen=True, slots=True)
class Calibration:
    """
    Zero counts, directions, noise and bias, and the stations that they were computed from.

    Attributes
    ----------
    date : str
        Time of the calibration, ISO 8601 with the offset to UTC.
    stations : tuple of Station
        Readings, one for each pose.
    direction, zero_count, counts_per_turn : tuple of N int
        Settings of the driver, by sensor.
    direction_verified : tuple of N bool
        True where two poses determined the direction.
    bias : tuple of N float
        Bound of each sensor's systematic error, rad.

    """

    date: str
    stations: tuple[Station, ...]
    direction: tuple[int, ...]
    zero_count: tuple[int, ...]
    counts_per_turn: tuple[int, ...]
    direction_verified: tuple[bool, ...]
    bias: tuple[float, ...]

    @property
    def sigma(self) -> tuple[float, ...]:
        """
        White noise of each sensor, rad, with that of its quantisation.

        A quiet encoder at rest repeats its count; in motion its error is uniform over a count.
        """
        return tuple(
            max(hypot(*(station.sigma[index] for station in self.stations))
                / len(self.stations) ** 0.5, TURN / per_turn / 12.0 ** 0.5)
            for index, per_turn in enumerate(self.counts_per_turn))


def jig_angles(pose: Sequence[float], geometry: Geometry,
               working_mode: tuple[int, int, int],
               sensors: int = len(JOINT_NAMES)) -> tuple[float, ...]:
    """
    Return the angles of the sensors' joints, rad, at a jig's pose.

    Parameters
    ----------
    pose : sequence of 3 float
        psi, theta, phi (ZXZ), rad.
    geometry : Geometry
        Link angles.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.
    sensors : int
        Number of sensors.

    Raises
    ------
    UnreachableError
        The manipulator does not reach the pose.

    """
    psi, theta, phi = pose
    return measured_angles(zxz_rotation(psi, theta, phi), geometry, working_mode, sensors)


def jig_bias(pose: Sequence[float], geometry: Geometry, working_mode: tuple[int, int, int],
             error: float, sensors: int = len(JOINT_NAMES)) -> tuple[float, ...]:
    """
    Return by how much each joint angle of a pose is off at most, rad, if the jig is off.

    Parameters
    ----------
    pose, geometry, working_mode
        As of `jig_angles`.
    error : float
        Largest angle between the jig's pose and the stated one, rad; small, about any axis.
    sensors : int
        Number of sensors.

    """
    rotation = matrix_from_zxz(*pose)
    gains = jacobian(rotation, geometry, working_mode, sensors)
    return tuple(float(gain) * error for gain in np.linalg.norm(gains, axis=1))


def calibrate(stations: Sequence[Station], direction: Sequence[int],
              counts_per_turn: Sequence[int], date: str, bias: Sequence[float],
              tolerance: float, before: Calibration | None = None) -> Calibration:
    """
    Return the zero counts and directions with which the readings yield the jig's joint angles.

    Parameters
    ----------
    stations : sequence of Station
        Readings, one for each pose.
    direction, counts_per_turn : sequences of N int
        Settings of the encoders. A direction that two poses determine overrides the given one.
    date : str
        Time of the calibration, for the record.
    bias : sequence of N float
        Bound of each sensor's systematic error, rad.
    tolerance : float
        Largest difference between the zero counts of two poses that is accepted, rad.
    before : Calibration, optional
        An earlier calibration, at other poses: it helps to determine the directions.

    Raises
    ------
    CalibrationError
        The poses contradict each other: a shaft slipped, or a pose is not the stated one.

    """
    found, known = list(direction), [False] * len(direction)
    within = observed_directions(combinations(stations, 2), counts_per_turn)
    since = observed_directions(
        product(before.stations if before else (), stations), counts_per_turn)
    for index, observed in enumerate(within):
        if observed or since[index]:
            found[index], known[index] = observed or since[index], True
        elif before is not None and before.direction_verified[index]:
            found[index], known[index] = before.direction[index], True
    zero = tuple(_zero_count(index, stations, found[index], per_turn,
                             tolerance if known[index] else None)
                 for index, per_turn in enumerate(counts_per_turn))
    return Calibration(date, tuple(stations), tuple(found), zero, tuple(counts_per_turn),
                       tuple(known), tuple(bias))


def _zero_count(index: int, stations: Sequence[Station], sign: int, per_turn: int,
                tolerance: float | None) -> int:
    """Return the mean zero count over the stations; CalibrationError if they differ too much."""
    zeros = [station.counts[index] - sign * station.angles[index] * per_turn / TURN
             for station in stations]
    scale = TURN / per_turn
    # Differences from the first, so that the mean is right where the counts wrap.
    off = [wrapped((zero - zeros[0]) * scale) for zero in zeros]
    mean = sum(off) / len(off)
    worst = max(range(len(off)), key=lambda number: abs(off[number] - mean))
    if tolerance is not None and max(off) - min(off) > tolerance:
        raise CalibrationError(
            f'the poses contradict each other: {ALL_JOINT_NAMES[index]} is '
            f'{degrees(off[worst] - mean):+.3f} deg off at pose {worst + 1} of {len(off)} '
            f'(tolerance {degrees(tolerance):g} deg between two); did its shaft slip, or is a '
            'pose not the stated one?')
    return round(zeros[0] + mean / scale) % per_turn


def observed_directions(pairs: Iterable[tuple[Station, Station]],
                        counts_per_turn: Sequence[int]) -> tuple[int, ...]:
    """
    Return the direction (+1, -1) of each joint from the step between two poses, 0 if unknown.

    The pair that moves a joint farthest determines its direction, if that is by TRAVEL_MINIMUM or
    more, and if the counts moved by as much, one way or the other.

    Parameters
    ----------
    pairs : iterable of two Station
        Readings at two poses each.
    counts_per_turn : sequence of N int
        Scale of each encoder.

    """
    observed = []
    pairs = tuple(pairs)
    for index, per_turn in enumerate(counts_per_turn):
        expected, turned = max(
            ((wrapped(second.angles[index] - first.angles[index]),
              wrapped((second.counts[index] - first.counts[index]) * TURN / per_turn))
             for first, second in pairs),
            key=lambda pair: abs(pair[0]), default=(0.0, 0.0))
        mismatch = abs(abs(turned) - abs(expected))
        if abs(expected) < TRAVEL_MINIMUM or mismatch > TRAVEL_MISMATCH * abs(expected):
            observed.append(0)
        else:
            observed.append(1 if turned * expected > 0.0 else -1)
    return tuple(observed)
