# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of the arguments of the public array functions; an error names argument and value."""

from __future__ import annotations

from collections.abc import Iterable
import math
import numbers
import sys

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import GeometryError, InputError, quoted
from spm_haptic_master.kinematics.joints import LEG_NAMES
from spm_haptic_master.kinematics.number_backends import Array, Vector
from spm_haptic_master.kinematics.vectors import cross

Shape = tuple[int, ...]
WorkingMode = tuple[int, int, int]
# One axis of each leg A, B, C.
ThreeAxes = tuple[Vector[float], Vector[float], Vector[float]]
# Largest entry of R^T R - I of a rotation (unit 1): single-precision matrices pass; a drift that
# would matter beside the sensors' noise of 7e-4 rad does not.
ROTATION_TOLERANCE = 1e-6
# Largest array that Python checks faster than numpy (entries).
SMALL = 16
# Largest finite number (unit 1).
LARGEST_NUMBER = sys.float_info.max
# Largest angle (rad): rounding leaves it 1e-10 rad; sums of a few angles stay far from overflow.
LARGEST_ANGLE = 1e6
# Largest deviation of an axis' length from 1 (unit 1): single precision passes, normalised.
LENGTH_TOLERANCE = 1e-6
# Smallest angle between two axes of the base or the platform, and between an axis and the opposite
# of where it is on a nominal mechanism (rad): nearer, a leg repeats another, or a joint has no
# zero.
LEAST_ANGLE = math.radians(0.1)


def check_array(
    name: str,
    value: object,
    shape: Shape,
    largest: float = LARGEST_NUMBER,
) -> Array:
    """
    Return an argument as an array of finite numbers.

    Parameters
    ----------
    name : str
        The argument, for the error.
    value : object
        What was given for it.
    shape : tuple of int
        Shape of one entry; any dimensions may precede it.
    largest : float
        Largest size of a number.

    Returns
    -------
    ndarray of float, shape (..., *shape)

    Raises
    ------
    InputError
        `value` is not an array of real numbers of that shape, or a number is not finite or too
        large.

    """
    array = _real_numbers(value)
    if array is None:
        raise InputError(
            f'{name} = {quoted(value)}: expected real numbers of shape {_open(shape)}'
        )
    if shape and array.shape[-len(shape) :] != shape:
        raise InputError(f'{name} has shape {array.shape}: expected {_open(shape)}')
    if array.dtype.char != 'd':
        with np.errstate(over='ignore'):
            array = array.astype(float)
    if not _all_within(array, largest):
        is_wrong = ~(np.abs(array) <= largest)
        where = first_index(is_wrong)
        expected = f'{largest:g} or less in size'
        if largest == LARGEST_NUMBER:
            expected = 'a finite number'
        raise InputError(f'{name}: entry {where} is {array[where]}, expected {expected}')
    return array


def first_index(wanted: NDArray[np.bool_]) -> tuple[int, ...]:
    """Return the index of the first entry that is True."""
    index: list[int] = np.argwhere(wanted)[0].tolist()
    return tuple(index)


def _real_numbers(value: object) -> Array | None:
    """Return a value as an array of real numbers; None if it is none, or has masked entries."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        return None
    try:
        array = np.asarray(value)
    except Exception:  # a ragged list; a foreign type may raise anything
        return None
    if array.dtype.kind not in 'fiu':
        return None
    return array


def _all_within(array: Array, largest: float) -> bool:
    """Return whether no number is larger in size, and none is NaN."""
    if array.size > SMALL:
        return bool((np.abs(array) <= largest).all())
    # For one sample a numpy call costs more than Python's loop.
    return all(-largest <= number <= largest for number in array.ravel().tolist())


def check_angles(
    name: str,
    value: object,
    shape: Shape,
) -> Array:
    """Return `value` as angles in rad, shape (..., *shape); InputError beyond `LARGEST_ANGLE`."""
    return check_array(name, value, shape, largest=LARGEST_ANGLE)


def check_count(
    name: str,
    value: object,
    least: int,
    most: int,
) -> int:
    """Return `value` as an int from `least` to `most`; InputError if it is none."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        number = None
    else:
        number = int(value)
    if number is None or not least <= number <= most:
        raise InputError(f'{name} = {quoted(value)}: expected an integer from {least} to {most}')
    return number


def _open(shape: Shape) -> str:
    dimensions = ['...', *map(str, shape)]
    return '(' + ', '.join(dimensions) + ')'


def check_rotations(name: str, value: object) -> Array:
    """Return rotation matrices (..., 3, 3); InputError beyond `ROTATION_TOLERANCE`."""
    matrices = check_array(name, value, (3, 3))
    # Entries far above 1 may overflow: the error is then infinite or NaN, and the check fails.
    with np.errstate(over='ignore', invalid='ignore'):
        products = np.swapaxes(matrices, -1, -2) @ matrices
        error = np.abs(products - np.eye(3)).max(axis=(-1, -2))
        determinant = np.linalg.det(matrices)
    bad = ~(error <= ROTATION_TOLERANCE) | (determinant < 0.0)
    if np.any(bad):
        where = first_index(bad)
        place = list(where) if where else ''
        raise InputError(
            f'{name}{place} = {matrices[where].tolist()}: expected a '
            f'rotation matrix (largest entry of R^T R - I is {error[where]:.3g}, at most '
            f'{ROTATION_TOLERANCE:g}; determinant {determinant[where]:.6g}, +1)'
        )
    return matrices


def check_working_mode(working_mode: Iterable[int]) -> WorkingMode:
    """Return the signs of B_kk, legs A, B, C, as ints; InputError if they are not three signs."""
    try:
        signs = tuple(working_mode)
    except TypeError:  # not iterable
        signs = ()
    if len(signs) != 3 or not all(map(_is_sign, signs)):
        raise InputError(
            f'working_mode = {quoted(working_mode)}: expected three signs, each +1 or -1'
        )
    first, second, third = signs
    return int(first), int(second), int(third)


def _is_sign(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return False
    return value in (1, -1)


def check_broadcast(names: str, *shapes: Shape) -> Shape:
    """Return the common shape of batches; InputError if they do not broadcast together."""
    if all(shape == shapes[0] for shape in shapes):
        return shapes[0]
    try:
        common: Shape = np.broadcast_shapes(*shapes)
    except ValueError:
        listed = ', '.join(map(str, shapes))
        raise InputError(f'{names}: batch shapes {listed} do not broadcast') from None
    return common


# Link angles and axes --------------------------------------------------------------------------


def check_angle(name: str, angle: object) -> float:
    """Return a link angle, rad, in ]0, pi[; GeometryError if it is none."""
    real = isinstance(angle, numbers.Real) and not isinstance(angle, bool)
    if not real or not 0.0 < angle < math.pi:  # type: ignore[operator]
        raise GeometryError(
            f'{name} = {quoted(angle)}: expected an angle in rad between 0 and pi, both excluded'
        )
    return float(angle)  # type: ignore[arg-type]


def _check(
    name: str,
    value: object,
    shape: tuple[int, ...],
) -> Array:
    """Return an array of exactly this shape; GeometryError if it is none."""
    try:
        array = check_array(name, value, shape)
    except InputError as error:
        raise GeometryError(str(error)) from None
    if array.shape != shape:
        raise GeometryError(f'{name} has shape {array.shape}: expected {shape}')
    return array


def check_links(name: str, angles: object) -> Vector[float]:
    """Return the link angles of three legs, rad; GeometryError if they are none."""
    links = []
    for leg, angle in zip(LEG_NAMES, _check(name, angles, (3,)).tolist(), strict=True):
        links.append(check_angle(f'{name} of leg {leg}', angle))
    first, second, third = links
    return first, second, third


def check_axes(
    name: str,
    axes: object,
    symbol: str,
    nominal: ThreeAxes,
) -> ThreeAxes:
    """Return unit vectors, none parallel or opposite to its nominal one; GeometryError if not."""
    rows = _check(name, axes, (3, 3))
    unit = []
    for leg, row in enumerate(rows.tolist()):
        length = math.hypot(*row)
        if not abs(length - 1.0) <= LENGTH_TOLERANCE:
            raise GeometryError(
                f'{name}: row {leg} = {row} has length {length:.9g}, expected a unit vector'
            )
        x, y, z = (component / length for component in row)
        unit.append((x, y, z))
    apart = f'expected {math.degrees(LEAST_ANGLE):g} deg or more between them'
    for leg, other in ((0, 1), (1, 2), (2, 0)):
        sine = math.hypot(*cross(unit[leg], unit[other]))
        if sine < math.sin(LEAST_ANGLE):
            angle = math.degrees(math.asin(sine))
            raise GeometryError(
                f'{name}: rows {leg} and {other} = {list(unit[leg])} and {list(unit[other])} are '
                f'parallel to {angle:.3g} deg, {apart}'
            )
    for letter, axis, drawn in zip(LEG_NAMES, unit, nominal, strict=True):
        opposite = [-component for component in drawn]
        if math.dist(axis, opposite) < LEAST_ANGLE:
            raise GeometryError(
                f'{name}: {symbol}{letter} = {list(axis)} is opposite to '
                f'{list(drawn)}: {apart}, or the joint has no zero'
            )
    first, second, third = unit
    return first, second, third
