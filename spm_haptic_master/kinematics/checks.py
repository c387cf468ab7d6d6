# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of what the public array functions are given; each error names argument and value."""

import math
import numbers

import numpy as np

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.geometry import Geometry

ROTATION_TOLERANCE = 1e-6
"""
Largest entry of R^T R - I of what passes for a rotation (unit 1).

Single-precision matrices pass; a drift that would matter beside the sensors' noise of 7e-4 rad does
not.
"""

SMALL = 16
"""Entries up to which an array is looked at by Python, not by numpy."""


def check_array(name, value, shape):
    """
    Return `value` as a float array whose last dimensions are `shape`, all entries finite.

    Parameters
    ----------
    name : str
        The argument's name, for the error.
    value : array_like
        What was given.
    shape : tuple of int
        Expected last dimensions; leading ones are free.

    Returns
    -------
    ndarray, shape (..., *shape)

    Raises
    ------
    InputError
        Not numbers, another shape, NaN or infinite.

    """
    try:
        array = np.asarray(value)
    except ValueError:  # a ragged list
        array = np.asarray(None)
    if array.dtype.kind not in 'fiu':
        raise InputError(f'{name} = {value!r}: expected real numbers of shape {_open(shape)}')
    if shape and array.shape[-len(shape):] != shape:
        raise InputError(f'{name} has shape {array.shape}: expected {_open(shape)}')
    # A numpy call costs more than looking at the numbers of one sample.
    if array.size <= SMALL:
        finite = all(map(math.isfinite, array.ravel().tolist()))
    else:
        finite = np.isfinite(array).all()
    if not finite:
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f'{name}: entry {where} is {array[where]}, expected finite numbers')
    return array.astype(float, copy=False)


def _open(shape):
    return '(' + ', '.join(['...', *map(str, shape)]) + ')'


def check_rotations(name, value):
    """
    Return `value` as rotation matrices of shape (..., 3, 3).

    Raises
    ------
    InputError
        Not finite numbers of that shape, or not rotations within `ROTATION_TOLERANCE`.

    """
    matrices = check_array(name, value, (3, 3))
    error = np.abs(np.swapaxes(matrices, -1, -2) @ matrices - np.eye(3)).max(axis=(-1, -2))
    bad = (error > ROTATION_TOLERANCE) | (np.linalg.det(matrices) < 0.0)
    if np.any(bad):
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f'{name}{list(where) if where else ""} = {matrices[where].tolist()}: expected a '
            f'rotation matrix (largest entry of R^T R - I is {error[where]:.3g}, at most '
            f'{ROTATION_TOLERANCE:g}; determinant {np.linalg.det(matrices[where]):.6g}, +1)')
    return matrices


def check_geometry(geometry):
    """
    Return `geometry` if it is a Geometry.

    Raises
    ------
    InputError
        Anything else.

    """
    if not isinstance(geometry, Geometry):
        raise InputError(f'geometry = {geometry!r}: expected a Geometry')
    return geometry


def check_working_mode(working_mode):
    """
    Return the working mode as three ints, each +1 or -1, legs A, B, C.

    Raises
    ------
    InputError
        Anything but three signs.

    """
    try:
        signs = tuple(working_mode)
    except TypeError:
        signs = ()
    if len(signs) != 3 or not all(
            isinstance(sign, numbers.Real) and sign in (1, -1) for sign in signs):
        raise InputError(
            f'working_mode = {working_mode!r}: expected three signs, each +1 or -1')
    return tuple(int(sign) for sign in signs)


def check_sensors(sensors):
    """
    Return the number of sensors, 3 or 4.

    Raises
    ------
    InputError
        Any other value.

    """
    if sensors not in (3, 4):
        raise InputError(f'sensors = {sensors!r}: expected 3 (active joints) or 4 (with th3A)')
    return int(sensors)


def check_broadcast(names, *shapes):
    """
    Return the common shape of batches that go together.

    Raises
    ------
    InputError
        The shapes do not broadcast.

    """
    if all(shape == shapes[0] for shape in shapes):
        return shapes[0]
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        raise InputError(
            f'{names}: batch shapes {", ".join(map(str, shapes))} do not broadcast') from None
