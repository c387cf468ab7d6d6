# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Motions for the simulated encoders: time in s to the ZXZ angles (psi, theta, phi) in rad.

They have no state: any time can be asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import acos, atan2, cos, hypot, pi, radians, sin, sqrt
from typing import NamedTuple

from spm_haptic_master.kinematics import inverse, track_mode, workspace_pose, zxz_from_matrix

# A motion: time in s to (psi, theta, phi) in rad.
Trajectory = Callable[[float], tuple[float, float, float]]

# psi and theta of the workspace's centre (rad), the platform axis on (1, 1, 1).
CENTRE_PSI = radians(135.0)
CENTRE_THETA = acos(1.0 / sqrt(3.0))

# Periods of the sweep's tilt, azimuth and self-rotation (s): their ratios are not whole, so that
# the motion does not repeat soon.
SWEEP_PERIODS = 7.0, 11.0, 17.0
# Middle and amplitude of the sweep's self-rotation (rad): every pose is within reach up to a tilt
# of 26 deg (at 30 deg some are not).
SWEEP_PHI = radians(25.0)
SWEEP_PHI_AMPLITUDE = radians(15.0)

# The tour: largest tilt, middle and amplitude of its self-rotation (rad), and the three periods
# (s).
TOUR_TILT = radians(12.0)
TOUR_PHI = radians(40.0)
TOUR_PHI_AMPLITUDE = radians(22.0)
TOUR_PERIODS = 13.0, 19.0, 16.0

# Middle of the perturbed self-rotation (rad): the singularity, rounded as in the paper.
PERTURBED_PHI = radians(50.0)


class Wave(NamedTuple):
    """A sine of the time: its size, rad or unit 1, its period, s, and its phase, rad."""

    size: float
    period: float
    phase: float = 0.0

    def at(self, t: float) -> float:
        """Return its value at a time, s."""
        return self.size * sin(2.0 * pi * t / self.period + self.phase)


# Perturbations of it, rad; the periods' ratios are not whole.
PERTURBATIONS = (
    Wave(size=radians(4.0), period=3.7),
    Wave(size=radians(2.0), period=1.9),
    Wave(size=radians(1.0), period=0.83),
)

# Waves of a hand's tilt in two directions and of its turn, unit 1.
HAND_X = (
    Wave(size=0.6, period=3.7),
    Wave(size=0.4, period=8.3, phase=1.0),
)
HAND_Y = (
    Wave(size=0.6, period=4.9, phase=2.0),
    Wave(size=0.4, period=6.1),
)
HAND_TURN = (
    Wave(size=0.7, period=7.3),
    Wave(size=0.3, period=2.9, phase=0.5),
)
# Largest tilt of that motion, middle and amplitude of its self-rotation (rad).
HAND_TILT = radians(18.0)
HAND_PHI = radians(42.0)
HAND_PHI_AMPLITUDE = radians(40.0)

# The arms one by one: the time that each has (s), by how much its motor turns (rad), self-rotation
# of the pose where all begin (rad), and poses computed for each.
ARM_TIME = 4.0
ARM_SWING = radians(15.0)
ARMS_PHI = radians(25.0)
ARM_POSES = 61

# The directions of tilt at azimuth 0 and 90 deg, across the centre axis (1, 1, 1).
ACROSS = (
    (
        1.0 / sqrt(2.0),
        -1.0 / sqrt(2.0),
        0.0,
    ),
    (
        1.0 / sqrt(6.0),
        1.0 / sqrt(6.0),
        -2.0 / sqrt(6.0),
    ),
)


def fig9(t: float) -> tuple[float, float, float]:
    """
    Return the pose of the paper's Fig. 9: phi = 45 + 10 sin(pi t / 10) deg at the centre.

    Parameters
    ----------
    t : float
        Time, s.

    Returns
    -------
    tuple of 3 float
        psi, theta, phi, rad.

    """
    phi_deg = 45.0 + 10.0 * sin(pi * t / 10.0)
    return CENTRE_PSI, CENTRE_THETA, radians(phi_deg)


def perturbed(t: float) -> tuple[float, float, float]:
    """Return the pose of the paper's section 5: the self-rotation perturbed around 50 deg."""
    perturbation = sum(wave.at(t) for wave in PERTURBATIONS)
    return CENTRE_PSI, CENTRE_THETA, PERTURBED_PHI + perturbation


def sweep(tilt_max: float) -> Trajectory:
    """
    Return a tilt-and-turn motion over the workspace's cone.

    Parameters
    ----------
    tilt_max : float
        Largest tilt of the platform axis from the centre, rad.

    Returns
    -------
    callable
        Time in s to (psi, theta, phi) in rad.

    """

    def at(t: float) -> tuple[float, float, float]:
        tilt, azimuth, turn = (2.0 * pi * t / period for period in SWEEP_PERIODS)
        share = 0.5 * (1.0 - cos(tilt))
        phi = SWEEP_PHI + SWEEP_PHI_AMPLITUDE * sin(turn)
        return tilted(tilt_max * share, azimuth, phi)

    return at


def tour(t: float) -> tuple[float, float, float]:
    """Return a slow tilt-and-turn motion that begins clear of the singularity and crosses it."""
    tilt, azimuth, turn = (2.0 * pi * t / period for period in TOUR_PERIODS)
    share = 0.5 * (1.0 - cos(tilt))
    phi = TOUR_PHI - TOUR_PHI_AMPLITUDE * cos(turn)
    return tilted(TOUR_TILT * share, azimuth, phi)


def hand(t: float) -> tuple[float, float, float]:
    """Return the pose of a hand that moves the handle through the whole workspace."""
    x = sum(wave.at(t) for wave in HAND_X)
    y = sum(wave.at(t) for wave in HAND_Y)
    turn = sum(wave.at(t) for wave in HAND_TURN)
    tilt = HAND_TILT * hypot(x, y) / sqrt(2.0)
    phi = HAND_PHI + HAND_PHI_AMPLITUDE * turn
    return tilted(tilt, atan2(y, x), phi)


def arms(t: float) -> tuple[float, float, float]:
    """Return the pose of a hand that swings arm A, then B, then C; the other motors rest."""
    number, elapsed = divmod(t, ARM_TIME)
    poses = _arm_poses()[int(number) % 3]
    share = 0.5 * (1.0 - cos(2.0 * pi * elapsed / ARM_TIME))
    place = share * (ARM_POSES - 1)
    before = min(int(place), ARM_POSES - 2)
    part = place - before
    psi, theta, phi = (
        (1.0 - part) * one + part * other
        for one, other in zip(poses[before], poses[before + 1], strict=True)
    )
    return psi, theta, phi


@cache
def _arm_poses() -> list[list[list[float]]]:
    """Return ZXZ angles, rad, for each arm and each of `ARM_POSES` angles of its motor."""
    middle = workspace_pose(0.0, 0.0, ARMS_PHI)
    rest = inverse(middle).theta1.tolist()
    found = []
    for arm in range(3):
        last = middle
        poses = []
        for number in range(ARM_POSES):
            turned = list(rest)
            turned[arm] += ARM_SWING * number / (ARM_POSES - 1)
            last = track_mode(turned, last).rotation
            poses.append([float(angle) for angle in zxz_from_matrix(last)])
        found.append(poses)
    return found


def fixed(
    psi: float,
    theta: float,
    phi: float,
) -> Trajectory:
    """Return a motion that rests at one pose (rad)."""
    return lambda t: (psi, theta, phi)


def tilted(
    tilt: float,
    azimuth: float,
    phi: float,
) -> tuple[float, float, float]:
    """
    Return the ZXZ angles of a pose given as for `workspace_pose`.

    Parameters
    ----------
    tilt : float
        Tilt of the platform axis from (1, 1, 1), rad.
    azimuth : float
        Direction of the tilt, rad; 0 is along (1, -1, 0).
    phi : float
        Self-rotation, rad.

    Returns
    -------
    tuple of 3 float
        psi, theta, phi, rad.

    """
    along = cos(tilt) / sqrt(3.0)
    axis = []
    for first, second in zip(*ACROSS, strict=True):
        across = cos(azimuth) * first + sin(azimuth) * second
        axis.append(along + sin(tilt) * across)
    x, y, z = axis
    return atan2(x, -y), acos(z), phi
