# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Link angles and axes from which a mechanism can be made: checked, and as plain numbers."""

from __future__ import annotations

import math
import numbers

from spm_haptic_master.exceptions import GeometryError, InputError, quoted
from spm_haptic_master.kinematics.checks import check_array
from spm_haptic_master.kinematics.number_backends import Array

Axis = tuple[float, float, float]
ThreeAxes = tuple[Axis, Axis, Axis]
Three = tuple[float, float, float]
LEG_NAMES = 'ABC'
# Largest deviation of an axis' length from 1 (unit 1): single precision passes, normalised.
LENGTH_TOLERANCE = 1e-6
# Smallest angle between two axes of the base or the platform, and between an axis and the opposite
# of where it is on a nominal mechanism (rad): nearer, a leg repeats another, or a joint has no
# zero.
LEAST_ANGLE = math.radians(0.1)


def check_angle(name: str, angle: object) -> float:
    """Return a link angle, rad, in ]0, pi[; GeometryError if it is none."""
    real = isinstance(angle, numbers.Real) and not isinstance(angle, bool)
    if not real or not 0.0 < angle < math.pi:  # type: ignore[operator]
        raise GeometryError(
            f'{name} = {quoted(angle)}: expected an angle in rad between 0 and pi, both excluded')
    return float(angle)  # type: ignore[arg-type]


def _check(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return an array of exactly this shape; GeometryError if it is none."""
    try:
        array = check_array(name, value, shape)
    except InputError as error:
        raise GeometryError(str(error)) from None
    if array.shape != shape:
        raise GeometryError(f'{name} has shape {array.shape}: expected {shape}')
    return array


def check_links(name: str, angles: object) -> Three:
    """Return the link angles of three legs, rad; GeometryError if they are none."""
    first, second, third = (
        check_angle(f'{name} of leg {LEG_NAMES[leg]}', angle)
        for leg, angle in enumerate(_check(name, angles, (3,)).tolist()))
    return first, second, third


def check_axes(name: str, axes: object) -> ThreeAxes:
    """Return three unit vectors, no two of them parallel; GeometryError if they are none."""
    rows = _check(name, axes, (3, 3))
    unit = []
    for leg, row in enumerate(rows.tolist()):
        length = math.hypot(*row)
        if not abs(length - 1.0) <= LENGTH_TOLERANCE:
            raise GeometryError(
                f'{name}: row {leg} = {row} has length {length:.9g}, expected a unit vector')
        x, y, z = (component / length for component in row)
        unit.append((x, y, z))
    for leg in range(3):
        other = (leg + 1) % 3
        (x, y, z), (u, v, w) = unit[leg], unit[other]
        sine = math.hypot(y * w - z * v, z * u - x * w, x * v - y * u)
        if sine < math.sin(LEAST_ANGLE):
            raise GeometryError(
                f'{name}: rows {leg} and {other} = {list(unit[leg])} and {list(unit[other])} are '
                f'parallel to {math.degrees(math.asin(sine)):.3g} deg, expected '
                f'{math.degrees(LEAST_ANGLE):g} deg or more between them')
    first, second, third = unit
    return first, second, third


def check_zero(name: str, axis: Axis, nominal: Axis) -> None:
    """Raise GeometryError for an axis opposite to its nominal one: no least turn leads to it."""
    if math.dist(axis, [-component for component in nominal]) < LEAST_ANGLE:
        raise GeometryError(
            f'{name} = {list(axis)} is opposite to {list(nominal)}: expected '
            f'{math.degrees(LEAST_ANGLE):g} deg or more between them, or the joint has no zero')
