# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Gravity of the handle and the links: the torque that holds them, and its identification.

What hangs on the platform, and what the distal links put on it, is one mass times offset in the
platform frame. A proximal link, and what its distal link puts on it, is one in the plane across
Z1k: along Z2k and along Z1k x Z2k. The centre of a distal link lies in the plane of its two axes,
as of an arc in that plane. With the weight g along `down` such an offset r holds still by

    in the platform       r x (-g)                     on the handle
    in proximal link k    -(g . (Z1k x r))  G_k        on the handle: a torque on th1k
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.force.motor_rates import LegPose, motor_rates, Rows, second_of
from spm_haptic_master.kinematics.checks import check_array, check_rotations, check_working_mode
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.jacobians import cross, dot
from spm_haptic_master.kinematics.number_backends import Rotation, Vector

# Standard gravity, along -z of the base frame (m/s^2).
STANDARD: Vector[float] = (0.0, 0.0, -9.80665)
# Fewest poses of an identification, and least number of directions that they determine of the nine
# values: a proximal link with a vertical axis hangs on nothing, which leaves seven.
FEWEST_POSES, LEAST_RANK = 6, 7
# Smallest singular value over the largest that determines a direction (unit 1).
DETERMINED = 0.01


@dataclass(frozen=True, slots=True)
class Gravity:
    """
    Masses times offsets from the centre of rotation.

    Attributes
    ----------
    handle : tuple of three float
        In the platform frame, kg m.
    proximal : tuple of six float
        Of the proximal links A, B, C: along Z2k and along Z1k x Z2k, kg m.
    down : tuple of three float
        Acceleration of gravity in the base frame, m/s^2: of a base that is mounted aslant too.

    """

    handle: Vector[float] = (0.0, 0.0, 0.0)
    proximal: tuple[float, ...] = (0.0,) * 6
    down: Vector[float] = STANDARD

    def torque(self, rotation: Rotation[float], geometry: Geometry, rows: Rows,
               poses: Sequence[LegPose]) -> Vector[float]:
        """Return the torque on the handle that holds it in a pose, N m in the base frame."""
        r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
        x, y, z = self.handle
        down = self.down
        x, y, z = cross(down, (r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z,
                               r20 * x + r21 * y + r22 * z))
        for k, (leg, pose) in enumerate(zip(geometry.legs, poses, strict=True)):
            along, across = self.proximal[2 * k:2 * k + 2]
            if along == across == 0.0:
                continue
            first, second = leg.first, second_of(pose, leg)
            normal = cross(first, second)
            tau = -(along * dot(down, normal) + across * dot(down, cross(first, normal)))
            gx, gy, gz = rows[k]
            x, y, z = x + tau * gx, y + tau * gy, z + tau * gz
        return x, y, z


def identify_gravity(R: ArrayLike, motor_torque: ArrayLike, geometry: Geometry = PAPER_GEOMETRY,
                     working_mode: Sequence[int] = RIG_WORKING_MODE,
                     down: Vector[float] = STANDARD) -> tuple[Gravity, float]:
    """
    Gravity of handle and links from the motor torques that held them still.

    Parameters
    ----------
    R : array_like, shape (n, 3, 3)
        R_base_platform of each pose.
    motor_torque : array_like, shape (n, 3) or (n, 4)
        Torques of the motors on th1A, th1B, th1C, and th3A, N m.
    geometry : Geometry
        Link angles and axes.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.
    down : tuple of three float
        Acceleration of gravity in the base frame, m/s^2.

    Returns
    -------
    gravity : Gravity
        The values that explain the torques best.
    residual : float
        Root mean square of what they leave on the handle, N m.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value, or the poses do not determine the values.
    UnreachableError, SingularityError
        A pose is out of reach, or on the boundary of its working mode.

    """
    poses: list[Any] = [tuple(each) for each in check_rotations('R', R).reshape(-1, 9).tolist()]
    mode = check_working_mode(working_mode)
    check_geometry(geometry)
    motors = 4 if np.shape(motor_torque)[-1:] == (4,) else 3
    torques = check_array('motor_torque', motor_torque, (motors,)).reshape(-1, motors)
    if len(poses) != len(torques) or len(poses) < FEWEST_POSES:
        raise InputError(f'{len(poses)} poses and {len(torques)} sets of motor torques: expected '
                         f'as many of each, {FEWEST_POSES} or more')
    units = [Gravity((float(k == 0), float(k == 1), float(k == 2)), down=down) for k in range(3)]
    for k in range(6):
        one = [0.0] * 6
        one[k] = 1.0
        units.append(replace(units[0], handle=(0.0, 0.0, 0.0), proximal=tuple(one)))
    columns, sides = [], []
    for pose, tau in zip(poses, torques, strict=True):
        rows, legs = motor_rates(pose, geometry, mode, motors)
        columns.append(np.transpose([
            unit.torque(pose, geometry, rows, legs) for unit in units]))
        sides.append(np.array(rows).T @ tau)
    matrix, side = np.concatenate(columns), np.concatenate(sides)
    values, _, rank, _ = np.linalg.lstsq(matrix, side, rcond=DETERMINED)
    if rank < LEAST_RANK:
        raise InputError(f'{len(poses)} poses determine {rank} values of gravity: expected '
                         f'{LEAST_RANK} or more, by poses further apart')
    left = float(np.sqrt(np.mean((matrix @ values - side) ** 2)))
    x, y, z, *rest = values.tolist()
    return Gravity((x, y, z), tuple(rest), down), left
