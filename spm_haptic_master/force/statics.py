# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The statics of one pose, with three or four motors: one formula for a sample and for a batch."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.four_motors import FourMotors
from spm_haptic_master.force.motor_rates import (
    FOUR,
    LegConstants,
    LegPose,
    motor_rates,
    Rows,
)
from spm_haptic_master.force.three_motors import ThreeMotors
from spm_haptic_master.kinematics.number_backends import Rotation, Vector


class Statics(Protocol):
    """Motor torques and torque on the handle in one pose."""

    def render(self, m: Vector[float], /) -> tuple[tuple[float, ...], Vector[float]]:
        """Return motor torques, N m, and what the handle gets of m; N m in the base frame."""

    def rendered(self, tau: tuple[float, ...], /) -> Vector[float]:
        """Return the torque on the handle, N m in the base frame: G^T tau."""


def statics_of(rotation: Rotation[float], legs: tuple[LegConstants, ...], motors: int,
               limits: ForceLimits) -> tuple[Statics, Rows, tuple[LegPose, ...]]:
    """
    Statics of one pose in plain floats; nothing is validated.

    Parameters
    ----------
    rotation, legs, motors
        As of `motor_rates`.
    limits : ForceLimits
        Largest torque of a motor, and the fade.

    Returns
    -------
    statics : Statics
        Torque on the handle to motor torques, and back.
    rows, poses
        Of `motor_rates`.

    Raises
    ------
    UnreachableError, SingularityError
        As `motor_rates`.

    """
    rows, poses = motor_rates(rotation, legs, motors)
    if motors == FOUR:
        return FourMotors(rows, limits.motor_torque), rows, poses
    handle = rotation[2], rotation[5], rotation[8]
    return ThreeMotors(rows, handle, limits.motor_torque, limits.sigma_off,
                       limits.sigma_full), rows, poses


def smallest_singular_value(rows: Rows) -> float:
    """Return s_3 of the motors' rates G (unit 1): 1 / s_3 is the worst motor torque per torque."""
    return float(np.linalg.svd(np.array(rows), compute_uv=False)[-1])
