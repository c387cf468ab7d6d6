# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Gravity of the handle and the links: the torque that holds them, and its identification.

The weight on the platform, with the part of the distal links that it carries, is one mass times
offset in the platform frame. That of a proximal link, with the part of its distal link, is one in
the plane across Z1k: along Z2k and along Z1k x Z2k. The centre of a distal link is taken to lie in
the plane of its two axes, as that of an arc. With the acceleration g of gravity, `down`, such a
product r of mass and offset is at rest with the torque

    in the platform       r x (-g)                     on the handle
    in proximal link k    -(g . (Z1k x r))  G_k        on the handle: a torque on th1k
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.force.statics import LegConstants, Statics
from spm_haptic_master.kinematics.checks import check_array, check_rotations
from spm_haptic_master.kinematics.geometry import Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.kinematics.vectors import added, cross, dot, scaled, subtracted, times

# Standard gravity, along -z of the base frame (m/s^2).
STANDARD_GRAVITY: Vector[float] = (0.0, 0.0, -9.80665)
# Fewest poses of an identification, and least number of the nine values that they determine: Z1k
# of one leg may be vertical, so that the two values of its proximal link make no torque.
FEWEST_POSES = 6
LEAST_RANK = 7
# Smallest singular value over the largest that determines a direction (unit 1).
LEAST_RATIO = 0.01


@dataclass(frozen=True, slots=True)
class Gravity:
    """
    Masses times offsets from the centre of rotation.

    Attributes
    ----------
    handle : tuple of three float
        Of the handle in the platform frame, kg m.
    proximal : tuple of six float
        Of the proximal links A, B, C, each along Z2k and along Z1k x Z2k, kg m.
    down : tuple of three float
        Acceleration of gravity in the base frame, which may be mounted aslant, m/s^2.

    """

    handle: Vector[float] = (0.0, 0.0, 0.0)
    proximal: tuple[float, ...] = (0.0,) * 6
    down: Vector[float] = STANDARD_GRAVITY


class LinkWeight:
    """The torque that holds a proximal link; what does not depend on the pose is computed once."""

    def __init__(
        self,
        number: int,
        leg: LegConstants,
        offset: tuple[float, float],
        down: Vector[float],
    ) -> None:
        along, across = offset
        self._number = number  # of the leg
        # The torque is w . Z2k + c, here with the sign of B_kk: w, w . Z1k, w x Z1k and c (N m).
        turned = cross(down, leg.first)
        torque = subtracted(scaled(across, down), scaled(along, turned))
        self._torque = scaled(leg.sign, torque)
        self._along = dot(self._torque, leg.first)
        self._across = cross(self._torque, leg.first)
        self._constant = -across * leg.sign * leg.cos_alpha * dot(down, leg.first)

    def torque(self, statics: Statics) -> Vector[float]:
        """Return the torque on the handle, N m in the base frame, in the pose of `statics`."""
        leg = statics.legs[self._number]
        pose = statics.leg_poses[self._number]
        u = pose.u
        divisor = pose.divisor
        # Z2k by its products with Z1k, Z3k and Z1k x Z3k; its torque turns by the row of th1k.
        along_second = (
            (leg.cos_alpha - leg.cos_beta * u) * self._along
            + (leg.cos_beta - leg.cos_alpha * u) * dot(self._torque, pose.third)
            - sqrt(pose.reach) * dot(self._across, pose.third)
        ) / divisor
        motor_torque = (self._constant + along_second) / divisor
        return scaled(motor_torque, pose.row)


class Weight:
    """
    The torque that holds handle and links, in the pose of the statics.

    Parameters
    ----------
    gravity : Gravity
        Masses times offsets.
    statics : Statics
        Has the pose, and the rows of G.

    """

    def __init__(self, gravity: Gravity, statics: Statics) -> None:
        self._handle = gravity.handle
        self._down = gravity.down
        self._statics = statics
        along = gravity.proximal[::2]
        across = gravity.proximal[1::2]
        offsets = zip(along, across, strict=True)
        self._links = [
            LinkWeight(number, leg, offset, gravity.down)
            for number, (leg, offset) in enumerate(zip(statics.legs, offsets, strict=True))
            if any(offset)
        ]

    def torque(self) -> Vector[float]:
        """Return the torque on the handle that holds it, N m in the base frame."""
        offset = times(self._statics.rotation, self._handle)
        torque = cross(self._down, offset)
        for link in self._links:
            torque = added(torque, link.torque(self._statics))
        return torque


def identify_gravity(
    R: ArrayLike,
    motor_torque: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
    working_mode: Sequence[int] = RIG_WORKING_MODE,
    down: Vector[float] = STANDARD_GRAVITY,
) -> tuple[Gravity, float]:
    """
    Return the gravity of handle and links by the motor torques with which they were at rest.

    Parameters
    ----------
    R : array_like, shape (n, 3, 3)
        R_base_platform of each pose.
    motor_torque : array_like, shape (n, 3) or (n, 4)
        Torques of the motors at each pose, N m.
    geometry : Geometry
        The mechanism.
    working_mode : sequence of int
        Signs of B_kk of the legs A, B, C.
    down : tuple of float
        Acceleration of gravity in the base frame, m/s^2.

    Returns
    -------
    tuple of Gravity and float
        The gravity, and the root mean square of what it leaves on the handle, N m.

    Raises
    ------
    InputError
        An argument is wrong, or the poses do not determine the values.
    UnreachableError, SingularityError
        As of `inverse`.

    """
    motors = 4 if np.shape(motor_torque)[-1:] == (4,) else 3
    statics = make_statics(geometry, working_mode, motors, ForceLimits())
    rotations = check_rotations('R', R).reshape(-1, 9)
    poses: list[Any] = [tuple(rotation) for rotation in rotations.tolist()]
    torques = check_array('motor_torque', motor_torque, (motors,)).reshape(-1, motors)
    if len(poses) != len(torques) or len(poses) < FEWEST_POSES:
        raise InputError(
            f'{len(poses)} poses and {len(torques)} sets of motor torques: expected '
            f'as many of each, {FEWEST_POSES} or more'
        )
    # The torque is linear in nine values: that of each alone, of size 1, is a column.
    weights = [
        Weight(Gravity((x, y, z), tuple(rest), down), statics)
        for x, y, z, *rest in np.eye(9).tolist()
    ]
    columns = []
    sides = []
    for pose, tau in zip(poses, torques.tolist(), strict=True):
        statics.place(pose)
        columns.append(np.transpose([weight.torque() for weight in weights]))
        sides.append(statics.rendered(tau))
    matrix = np.concatenate(columns)
    side = np.concatenate(sides)
    values, _, rank, _ = np.linalg.lstsq(matrix, side, rcond=LEAST_RATIO)
    if rank < LEAST_RANK:
        raise InputError(
            f'{len(poses)} poses determine {rank} values of gravity: expected '
            f'{LEAST_RANK} or more, by poses further apart'
        )
    residuals = matrix @ values - side
    left = float(np.sqrt(np.mean(residuals**2)))
    x, y, z, *rest = values.tolist()
    return Gravity((x, y, z), tuple(rest), down), left
