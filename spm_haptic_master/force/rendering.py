# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the motors make of torques on the handle, for poses in a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.four_motors import FourMotors
from spm_haptic_master.force.statics import FOUR_MOTORS, THREE_MOTORS
from spm_haptic_master.force.three_motors import ThreeMotors
from spm_haptic_master.kinematics.checks import (
    check_array,
    check_broadcast,
    check_count,
    check_rotations,
    check_working_mode,
)
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.number_backends import Array


def make_statics(
    geometry: Geometry,
    working_mode: Sequence[int],
    motors: int,
    limits: ForceLimits,
) -> ThreeMotors | FourMotors:
    """Return the statics of some motors, pose by pose; InputError for a wrong argument."""
    check_geometry(geometry)
    mode = check_working_mode(working_mode)
    has_four = check_count('motors', motors, THREE_MOTORS, FOUR_MOTORS) == FOUR_MOTORS
    return (FourMotors if has_four else ThreeMotors)(geometry, mode, limits)


@dataclass(frozen=True, slots=True)
class Rendered:
    """What the motors make of torques on the handle."""

    motor_torque: Array  # (..., motors): th1A, th1B, th1C, and th3A of a fourth motor, N m
    rendered: Array  # (..., 3): torque that the handle gets, N m in the base frame
    fraction: Array  # (...): length of `rendered` over that asked for; 1 where that is 0


def render(
    R: ArrayLike,
    torque: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
    working_mode: Sequence[int] = RIG_WORKING_MODE,
    motors: int = THREE_MOTORS,
    motor_torque_limit: float = 0.5,
    sigma_off: float = 0.05,
    sigma_full: float = 0.15,
) -> Rendered:
    """
    Motor torques for torques on the handle, by the formula that a sample passes.

    Three motors: exact across the weak direction, faded along it near the parallel singularity
    (`three_motors`). Four: least heat within the limit, then least peak (`FourMotors`).

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.
    torque : array_like, shape (..., 3)
        Torque on the handle about the centre, N m in the base frame; broadcast with `R`.
    geometry : Geometry
        Link angles and axes.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.
    motors : {3, 4}
        3: on th1A, th1B, th1C; 4: on th3A as well.
    motor_torque_limit : float
        Largest torque of a motor, N m.
    sigma_off, sigma_full : float
        Smallest singular values of G (unit 1) between which the share of the weak direction of
        three motors rises from 0 to 1.

    Returns
    -------
    Rendered
        `motor_torque` (..., motors), `rendered` (..., 3), `fraction` (...). In a batch, poses out
        of reach or on the boundary of the working mode are NaN.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value.
    UnreachableError
        `R` is a single pose out of reach.
    SingularityError
        `R` is a single pose on the boundary of the working mode.

    """
    matrices = check_rotations('R', R)
    asked = check_array('torque', torque, (3,))
    statics = make_statics(
        geometry,
        working_mode,
        motors,
        ForceLimits(motor_torque=motor_torque_limit, sigma_off=sigma_off, sigma_full=sigma_full),
    )
    shape = check_broadcast('R, torque', matrices.shape[:-2], asked.shape[:-1])
    rotations: list[Any] = np.broadcast_to(matrices, (*shape, 3, 3)).reshape(-1, 9).tolist()
    asked = np.broadcast_to(asked, (*shape, 3))
    found = []
    for rotation, (x, y, z) in zip(rotations, asked.reshape(-1, 3).tolist(), strict=True):
        try:
            statics.place(rotation)
            tau, given = statics.render((x, y, z))
            found.append((*tau, *given))
        except SpmError:
            if not shape:
                raise
            found.append((nan,) * (motors + 3))
    both = np.array(found).reshape(*shape, motors + 3)
    torques = both[..., :motors]
    rendered = both[..., motors:]
    whole = np.linalg.norm(asked, axis=-1)
    part = np.linalg.norm(rendered, axis=-1)
    # 1 where no torque is asked for, but NaN where the pose has none.
    fraction = np.asarray(1.0 + 0.0 * part)
    np.divide(part, whole, out=fraction, where=whole > 0.0)
    return Rendered(motor_torque=torques, rendered=rendered, fraction=fraction)
