# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Rotations: matrices, quaternions and the paper's ZXZ Euler angles.

A rotation is R_base_platform: it takes components in the platform frame to components in the base
frame. Quaternions are ordered x, y, z, w, as ROS does; q and -q are the same rotation. A scalar
matrix is nine floats, row by row.
"""

import math

import numpy as np

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.checks import check_array, check_broadcast, check_rotations
from spm_haptic_master.kinematics.number_backends import ARRAYS, FLOATS

QUATERNION_NORM_TOLERANCE = 1e-6
"""Deviation of a quaternion's norm from 1 that is normalised away in silence (unit 1)."""


# Kernels --------------------------------------------------------------------------------------

def multiply_quaternions(p, q):
    """Product of two quaternions of four numbers each: first q, then p (both x, y, z, w)."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz)


def rotation_from_quaternion(x, y, z, w):
    """Nine numbers, row by row, of the rotation of a unit quaternion."""
    xx, yy, zz = 2.0 * x * x, 2.0 * y * y, 2.0 * z * z
    xy, xz, yz = 2.0 * x * y, 2.0 * x * z, 2.0 * y * z
    wx, wy, wz = 2.0 * w * x, 2.0 * w * y, 2.0 * w * z
    return (1.0 - yy - zz, xy - wz, xz + wy,
            xy + wz, 1.0 - xx - zz, yz - wx,
            xz - wy, yz + wx, 1.0 - xx - yy)


def quaternion_from_vector(x, y, z, m):
    """Quaternion, four numbers of unit norm, of a rotation vector in rad."""
    half = 0.5 * m.sqrt(x * x + y * y + z * z)
    # sin(half) / half without 0 / 0: at this size it is 1 to the last digit.
    half = half + 1e-150
    scale = 0.5 * m.sin(half) / half
    return scale * x, scale * y, scale * z, m.cos(half)


def _zxz_rotation(psi, theta, phi, m):
    """Nine numbers of Rz(psi) Rx(theta) Rz(phi), eq. 7."""
    c1, s1 = m.cos(psi), m.sin(psi)
    c, s = m.cos(theta), m.sin(theta)
    c2, s2 = m.cos(phi), m.sin(phi)
    return (c1 * c2 - s1 * c * s2, -c1 * s2 - s1 * c * c2, s1 * s,
            s1 * c2 + c1 * c * s2, -s1 * s2 + c1 * c * c2, -c1 * s,
            s * s2, s * c2, c)


def _zxz_angles(x, y, z, w, m):
    """
    Angles psi, theta, phi of a quaternion (eq. 7).

    q = (s cos d, s sin d, c sin e, c cos e) with s, c of theta / 2, d = (psi - phi) / 2 and
    e = (psi + phi) / 2; no branch is needed, and atan2(0, 0) = 0 settles theta = 0 and pi.
    """
    difference, total = m.atan2(y, x), m.atan2(z, w)
    theta = 2.0 * m.atan2(m.sqrt(x * x + y * y), m.sqrt(z * z + w * w))
    return _wrap(total + difference, m), theta, _wrap(total - difference, m)


def _wrap(angle, m):
    return m.atan2(m.sin(angle), m.cos(angle))


# Floats ---------------------------------------------------------------------------------------

def zxz_rotation(psi, theta, phi):
    """
    Rotation matrix of the ZXZ Euler angles, in plain floats (eq. 7).

    Parameters
    ----------
    psi, theta, phi : float
        Euler angles, rad; phi is the self-rotation.

    Returns
    -------
    tuple of nine float
        R_base_platform = Rz(psi) Rx(theta) Rz(phi), row by row.

    """
    return _zxz_rotation(psi, theta, phi, FLOATS)


def zxz_angles(x, y, z, w):
    """
    Angles psi, theta, phi (ZXZ, eq. 7) of a unit quaternion, in plain floats.

    Parameters
    ----------
    x, y, z, w : float
        Unit quaternion of R_base_platform.

    Returns
    -------
    psi, theta, phi : float
        rad; psi and phi in [-pi, pi], theta in [0, pi]. At theta = 0 or pi only the sum or the
        difference of psi and phi is defined; they are then equal or opposite.

    """
    return _zxz_angles(x, y, z, w, FLOATS)


# Arrays ---------------------------------------------------------------------------------------

def stack_matrix(rotation):
    """Matrices of shape (..., 3, 3) from nine arrays, row by row."""
    flat = np.stack(np.broadcast_arrays(*rotation), axis=-1)
    return flat.reshape(flat.shape[:-1] + (3, 3))


def unstack_matrix(matrices):
    """Nine arrays, row by row, from matrices of shape (..., 3, 3)."""
    return tuple(matrices[..., i, j] for i in range(3) for j in range(3))


def matrix_from_quaternion(q):
    """
    Rotation matrices of quaternions.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Unit quaternions x, y, z, w.

    Returns
    -------
    ndarray, shape (..., 3, 3)

    Raises
    ------
    InputError
        Not finite numbers of that shape, or a norm that is not 1.

    """
    q = check_array('q', q, (4,))
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    bad = np.abs(norm[..., 0] - 1.0) > QUATERNION_NORM_TOLERANCE
    if np.any(bad):
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f'q = {q[where].tolist()}: norm {norm[where][0]:.9g}, expected a unit quaternion')
    return stack_matrix(rotation_from_quaternion(*np.moveaxis(q / norm, -1, 0)))


def quaternion_from_matrix(R):
    """
    Quaternions of rotation matrices.

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        Rotations.

    Returns
    -------
    ndarray, shape (..., 4)
        Unit quaternions x, y, z, w, with w >= 0.

    Raises
    ------
    InputError
        Not rotations of that shape.

    """
    return _quaternion(check_rotations('R', R))


def _quaternion(matrices):
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = unstack_matrix(matrices)
    # The rows of 4 q q^T: the one with the largest diagonal entry is q well away from 0 / 0.
    products = np.stack([
        1.0 + r00 - r11 - r22, r01 + r10, r02 + r20, r21 - r12,
        r01 + r10, 1.0 - r00 + r11 - r22, r12 + r21, r02 - r20,
        r02 + r20, r12 + r21, 1.0 - r00 - r11 + r22, r10 - r01,
        r21 - r12, r02 - r20, r10 - r01, 1.0 + r00 + r11 + r22], axis=-1)
    products = products.reshape(products.shape[:-1] + (4, 4))
    row = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(products, row[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., 3:] < 0.0, -q, q)


def matrix_from_zxz(psi, theta, phi):
    """
    Rotation matrices of ZXZ Euler angles (eq. 7).

    Parameters
    ----------
    psi, theta, phi : array_like, shape (...)
        Euler angles, rad, broadcast together; phi is the self-rotation.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        R_base_platform = Rz(psi) Rx(theta) Rz(phi).

    Raises
    ------
    InputError
        Not finite numbers, or shapes that do not broadcast.

    """
    psi = check_array('psi', psi, ())
    theta = check_array('theta', theta, ())
    phi = check_array('phi', phi, ())
    check_broadcast('psi, theta, phi', psi.shape, theta.shape, phi.shape)
    return stack_matrix(_zxz_rotation(psi, theta, phi, ARRAYS))


def zxz_from_matrix(R):
    """
    Angles psi, theta, phi (ZXZ, eq. 7) of rotation matrices.

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.

    Returns
    -------
    psi, theta, phi : ndarray, shape (...)
        rad, with the ranges and the convention at theta = 0 and pi of `zxz_angles`.

    Raises
    ------
    InputError
        Not rotations of that shape.

    """
    return _zxz_angles(*np.moveaxis(quaternion_from_matrix(R), -1, 0), ARRAYS)


def rotation_distance(p, q):
    """Angle, rad, between the rotations of two unit quaternions of four floats each."""
    x, y, z, w = multiply_quaternions(p, (-q[0], -q[1], -q[2], q[3]))
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))
