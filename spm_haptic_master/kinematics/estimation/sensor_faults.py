# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an orientation implies about one sensor: its fault, and how it bends the parity."""

from __future__ import annotations

import math
from operator import mul
from typing import NamedTuple

from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.inverse_model import measured_angles, velocity_rows
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    quaternion_from_vector,
    rotation_from_quaternion,
)
from spm_haptic_master.kinematics.vectors import dot, scaled, times

# Turn on either side of an orientation over which the curvature of the readings is taken (rad).
CURVATURE_TURN = 0.03
# The angles of all sensors, mounted or not, come from one inverse model.
ALL_SENSORS = len(ALL_JOINT_NAMES)
TURN = 2.0 * math.pi


class ImpliedFault(NamedTuple):
    """
    The fault of one sensor if the others are right.

    Attributes
    ----------
    fault : float
        Its reading less the angle that the others imply, rad.
    deviation : float
        Standard deviation of that by the noise of all these sensors, rad.
    bias : float
        What the nominal biases of all these sensors do to it at most, rad.

    """

    fault: float
    deviation: float
    bias: float


def implied_fault(
    others: SampleEstimate,
    sensor: int,
    reading: float,
    bias: tuple[float, ...],
    parity_bias: float,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> ImpliedFault:
    """
    Return the fault of a sensor that an orientation implies, which the other sensors determine.

    Parameters
    ----------
    others : SampleEstimate
        The orientation, from other sensors.
    sensor : int
        Place of the sensor in ALL_JOINT_NAMES.
    reading : float
        Its reading, rad.
    bias : tuple of N float
        Nominal biases of the mounted sensors, rad.
    parity_bias : float
        Bound of the length of that part of the biases that no motion explains, rad.
    geometry, working_mode
        As of `solutions.fit_near`.

    Returns
    -------
    ImpliedFault
        First order: with the gains K_j = C h_j / sigma_j^2 of the others, C their covariance and
        h the sensors' rows of the Jacobian (eqs. 8 to 11, 17 to 21).

    Raises
    ------
    SpmError
        A leg does not reach the orientation, or is on the boundary of its working mode.

    """
    used = others.sensors
    rotation = rotation_from_quaternion(*others.quaternion)
    angles = measured_angles(rotation, geometry, working_mode, ALL_SENSORS)
    rows = _sensor_rows(rotation, angles, geometry)
    along = times(others.covariance, rows[sensor])
    sigma = used.sigma[sensor]
    # Bounds of the bias: the sum of what each does, and the length of the combination's gains
    # times that of the biases that no motion explains.
    moved = bias[sensor]
    square = 1.0
    for other in used.used:
        gain = abs(dot(rows[other], along)) * used.weights[other]
        moved += gain * bias[other]
        square += gain * gain
    return ImpliedFault(
        fault=math.remainder(reading - angles[sensor], TURN),
        deviation=math.sqrt(sigma * sigma + dot(rows[sensor], along)),
        bias=min(moved, parity_bias * math.sqrt(square)),
    )


def parity_curvature(
    estimate: SampleEstimate,
    sensor: int,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> float:
    """
    Return how the parity bends along the turn that a fault of one sensor makes.

    A turn e (rad) of the orientation along that direction changes the parity by e / slope + c e^2
    with this c (1 / rad^2, of either sign): to first order it is the sensor's slope that bounds
    its fault, but where the others stop determining the direction, c alone remains. Of several
    parities it is the part along the change that a fault of the sensor makes. By the second
    difference of the readings, `CURVATURE_TURN` to either side.

    Parameters
    ----------
    estimate : SampleEstimate
        Orientation by four or more sensors in use.
    sensor : int
        Place of the faulty sensor in ALL_JOINT_NAMES.
    geometry, working_mode
        As of `solutions.fit_near`.

    Raises
    ------
    SpmError
        A leg does not reach an orientation `CURVATURE_TURN` away, or is on the boundary of its
        working mode.

    """
    quaternion = estimate.quaternion
    rotation = rotation_from_quaternion(*quaternion)
    angles = measured_angles(rotation, geometry, working_mode, ALL_SENSORS)
    direction = _fault_direction(estimate, sensor, _sensor_rows(rotation, angles, geometry))
    turn = quaternion_from_vector(*scaled(CURVATURE_TURN, direction))
    ahead = multiply_quaternions(turn, quaternion)
    behind = multiply_quaternions(conjugate(turn), quaternion)
    angles_ahead = measured_angles(
        rotation_from_quaternion(*ahead), geometry, working_mode, ALL_SENSORS
    )
    angles_behind = measured_angles(
        rotation_from_quaternion(*behind), geometry, working_mode, ALL_SENSORS
    )
    gains = estimate.parity_gains
    own = gains[sensor]
    bent = 0.0
    for place in estimate.sensors.used:
        change_ahead = math.remainder(angles_ahead[place] - angles[place], TURN)
        change_behind = math.remainder(angles_behind[place] - angles[place], TURN)
        along = sum(map(mul, gains[place], own))
        bent += along * (change_ahead + change_behind)
    return 0.5 * bent / (math.hypot(*own) * CURVATURE_TURN * CURVATURE_TURN)


def turned_by_fault(
    estimate: SampleEstimate,
    sensor: int,
    turn: float,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> tuple[Quaternion[float], Quaternion[float]]:
    """
    Return the orientations to which a fault of one sensor turns another one, either way.

    Parameters
    ----------
    estimate : SampleEstimate
        Orientation by four or more sensors in use.
    sensor : int
        Place of the faulty sensor in ALL_JOINT_NAMES.
    turn : float
        By what angle, rad.
    geometry, working_mode
        As of `solutions.fit_near`.

    Returns
    -------
    tuple of two quaternions
        x, y, z, w of R_base_platform, by the first order.

    Raises
    ------
    SpmError
        A leg does not reach the orientation, or is on the boundary of its working mode.

    """
    rotation = rotation_from_quaternion(*estimate.quaternion)
    angles = measured_angles(rotation, geometry, working_mode, ALL_SENSORS)
    direction = _fault_direction(estimate, sensor, _sensor_rows(rotation, angles, geometry))
    rotated = quaternion_from_vector(*scaled(turn, direction))
    ahead = multiply_quaternions(rotated, estimate.quaternion)
    behind = multiply_quaternions(conjugate(rotated), estimate.quaternion)
    return ahead, behind


def _fault_direction(
    estimate: SampleEstimate,
    sensor: int,
    rows: list[Vector[float]],
) -> Vector[float]:
    """Return the axis, of length 1, about which a fault of a sensor turns it: that of C h_i."""
    gain = times(estimate.covariance, rows[sensor])
    return scaled(1.0 / math.hypot(*gain), gain)


def _sensor_rows(
    rotation: Rotation[float],
    angles: tuple[float, ...],
    geometry: Geometry,
) -> list[Vector[float]]:
    """Return the six sensors' rows of the Jacobian in the base frame (unit 1)."""
    th1a, th1b, th1c = angles[:3]
    vectors, volumes = velocity_rows(rotation, (th1a, th1b, th1c), geometry, FLOATS)
    rows = []
    for vector, volume in zip(vectors, volumes, strict=True):
        rows.append(scaled(FLOATS.mode_reciprocal(volume), vector))
    return rows
