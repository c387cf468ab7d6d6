# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Rotations: matrices, quaternions and the paper's ZXZ Euler angles.

A rotation is R_base_platform: it takes components in the platform frame to components in the base
frame. Quaternions are x, y, z, w, as in ROS; q and -q are the same rotation. In plain floats a
matrix is nine numbers, row by row. The angular velocity follows from the newest orientations.
"""

from __future__ import annotations

from collections import deque
import math
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.checks import (
    check_angles,
    check_array,
    check_broadcast,
    check_rotations,
    first_index,
)
from spm_haptic_master.kinematics.number_backends import (
    Array,
    ARRAYS,
    Backend,
    Batch,
    FLOATS,
    N,
    Quaternion,
    Rotation,
    Vector,
)
from spm_haptic_master.timing import SECOND

# Largest deviation of a quaternion's norm from 1 (unit 1): single precision passes, normalised.
QUATERNION_NORM_TOLERANCE = 1e-6
# Smallest half angle of a rotation vector (rad): prevents 0 / 0; its sine is itself.
LEAST_HALF_ANGLE = 1e-150

Angle = TypeVar('Angle', float, Array)


# Kernels --------------------------------------------------------------------------------------


def multiply_quaternions(p: Quaternion[N], q: Quaternion[N]) -> Quaternion[N]:
    """Product p q of two quaternions x, y, z, w: the rotation q, then p."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


def rotation_from_quaternion(
    x: N,
    y: N,
    z: N,
    w: N,
) -> Rotation[N]:
    """Rotation matrix, nine numbers row by row, of a unit quaternion."""
    x2 = x + x
    y2 = y + y
    z2 = z + z
    xx = x2 * x
    yy = y2 * y
    zz = z2 * z
    xy = x2 * y
    xz = x2 * z
    yz = y2 * z
    wx = x2 * w
    wy = y2 * w
    wz = z2 * w
    return (
        1.0 - yy - zz,
        xy - wz,
        xz + wy,
        xy + wz,
        1.0 - xx - zz,
        yz - wx,
        xz - wy,
        yz + wx,
        1.0 - xx - yy,
    )


def _zxz_rotation(
    psi: N,
    theta: N,
    phi: N,
    m: Backend[N],
) -> Rotation[N]:
    """Rotation matrix Rz(psi) Rx(theta) Rz(phi), eq. 7; angles in rad."""
    c1 = m.cos(psi)
    s1 = m.sin(psi)
    c = m.cos(theta)
    s = m.sin(theta)
    c2 = m.cos(phi)
    s2 = m.sin(phi)
    return (
        c1 * c2 - s1 * c * s2,
        -c1 * s2 - s1 * c * c2,
        s1 * s,
        s1 * c2 + c1 * c * s2,
        -s1 * s2 + c1 * c * c2,
        -c1 * s,
        s * s2,
        s * c2,
        c,
    )


def _zxz_angles(
    x: N,
    y: N,
    z: N,
    w: N,
    m: Backend[N],
) -> Vector[N]:
    """
    Angles psi, theta, phi, rad, of a quaternion (eq. 7).

    q = (s cos d, s sin d, c sin e, c cos e) with s, c of theta / 2, d = (psi - phi) / 2 and
    e = (psi + phi) / 2; no branch is needed: atan2(0, 0) = 0 covers theta = 0 and pi.
    """
    difference = m.atan2(y, x)
    total = m.atan2(z, w)
    theta = 2.0 * m.atan2(m.sqrt(x * x + y * y), m.sqrt(z * z + w * w))
    psi, phi = (
        m.atan2(m.sin(angle), m.cos(angle)) for angle in (total + difference, total - difference)
    )
    return psi, theta, phi


# Floats ---------------------------------------------------------------------------------------


def zxz_rotation(psi: float, theta: float, phi: float) -> Rotation[float]:
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


def zxz_quaternion(psi: float, theta: float, phi: float) -> Quaternion[float]:
    """
    Quaternion x, y, z, w of the ZXZ Euler angles, in plain floats (eq. 7).

    It is continuous in the angles: a turn of psi or phi by 2 pi gives the opposite quaternion of
    the same rotation.

    Parameters
    ----------
    psi, theta, phi : float
        Euler angles, rad; phi is the self-rotation.

    Returns
    -------
    tuple of float
        x, y, z, w, of norm 1.

    """
    difference = 0.5 * (psi - phi)
    total = 0.5 * (psi + phi)
    s = math.sin(0.5 * theta)
    c = math.cos(0.5 * theta)
    return (
        s * math.cos(difference),
        s * math.sin(difference),
        c * math.sin(total),
        c * math.cos(total),
    )


def zxz_angles(
    x: float,
    y: float,
    z: float,
    w: float,
) -> Vector[float]:
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


def quaternion_from_vector(x: float, y: float, z: float) -> Quaternion[float]:
    """Return the unit quaternion x, y, z, w of a rotation vector in rad, in plain floats."""
    half = 0.5 * math.sqrt(x * x + y * y + z * z) + LEAST_HALF_ANGLE
    scale = 0.5 * math.sin(half) / half
    return scale * x, scale * y, scale * z, math.cos(half)


def vector_from_quaternion(
    x: float,
    y: float,
    z: float,
    w: float,
) -> Vector[float]:
    """Return the rotation vector, rad, of norm [0, pi], of a unit quaternion, in plain floats."""
    sine = math.sqrt(x * x + y * y + z * z)
    if sine <= LEAST_HALF_ANGLE:
        scale = 2.0
    else:
        scale = 2.0 * math.atan2(sine, abs(w)) / sine
    if w < 0.0:
        scale = -scale
    return scale * x, scale * y, scale * z


def conjugate(q: Quaternion[float]) -> Quaternion[float]:
    """Return the conjugate of a quaternion: of a unit quaternion, its inverse rotation."""
    return -q[0], -q[1], -q[2], q[3]


def rotation_between(one: Quaternion[float], other: Quaternion[float]) -> Vector[float]:
    """Return the rotation vector, rad, in the base frame, that turns one rotation to the other."""
    return vector_from_quaternion(*multiply_quaternions(other, conjugate(one)))


def rotation_distance(p: Quaternion[float], q: Quaternion[float]) -> float:
    """Angle, rad in [0, pi], between the rotations of two unit quaternions, in plain floats."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    # p times the conjugate of q.
    x = -pw * qx + px * qw - py * qz + pz * qy
    y = -pw * qy + px * qz + py * qw - pz * qx
    z = -pw * qz - px * qy + py * qx + pz * qw
    w = pw * qw + px * qx + py * qy + pz * qz
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))


def is_within(p: Quaternion[float], q: Quaternion[float], angle: float) -> bool:
    """
    Whether two orientations are at most an angle (rad) apart, in plain floats.

    Of unit quaternions, either sign: 1 - (p . q)^2 is sin^2 of half the turn between them.
    """
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    cosine = px * qx + py * qy + pz * qz + pw * qw
    # sin(angle / 2), or its upper bound angle / 2 where that is nearly the same.
    half = 0.5 * angle
    sine = half if half < 0.1 else math.sin(min(half, 0.5 * math.pi))
    return 1.0 - cosine * cosine <= sine * sine


class AngularVelocity:
    """
    Least-squares slope of the orientation over a sliding window, in plain floats.

    The difference of two samples would amplify the sensors' noise by the sample rate. The slope of
    a straight line through the n samples of the window amplifies it by about
    sqrt(12 / n) / window, and lags by half the window.

    Parameters
    ----------
    window : int
        Length of the window, ns, 1 or more.

    """

    def __init__(self, window: int):
        self._window = window
        self._kept: deque[tuple[int, Quaternion[float]]] = deque()

    def add(self, stamp: int, quaternion: Quaternion[float]) -> None:
        """Add an orientation: stamp in ns, sign-continuous unit quaternion x, y, z, w."""
        kept = self._kept
        kept.append((stamp, quaternion))
        while kept[0][0] < stamp - self._window:
            kept.popleft()

    def value(self) -> Vector[float] | None:
        """Angular velocity in the base frame, rad/s; None until half a window is filled."""
        kept = self._kept
        if not kept:
            return None
        newest, (x, y, z, w) = kept[-1]
        if newest - kept[0][0] < 0.5 * self._window:
            return None
        times = [stamp - newest for stamp, _ in kept]
        mean = sum(times) / len(times)
        spread = 0.0
        dx = 0.0
        dy = 0.0
        dz = 0.0
        dw = 0.0
        for time, (_, (qx, qy, qz, qw)) in zip(times, kept, strict=True):
            offset = time - mean
            spread += offset * offset
            dx += offset * qx
            dy += offset * qy
            dz += offset * qz
            dw += offset * qw
        # The vector part of 2 qdot q*, where q* is the conjugate of the newest quaternion; exact
        # to first order in the rotation within the window.
        x, y, z, _ = multiply_quaternions((dx, dy, dz, dw), (-x, -y, -z, w))
        scale = 2.0 * SECOND / spread
        return scale * x, scale * y, scale * z


# Arrays ---------------------------------------------------------------------------------------


def stack_matrix(rotation: Rotation[Batch]) -> Array:
    """Matrices of shape (..., 3, 3) from the nine numbers of a batch, row by row."""
    flat = np.stack(np.broadcast_arrays(*rotation), axis=-1)
    return flat.reshape(flat.shape[:-1] + (3, 3))


def unstack_matrix(matrices: Array) -> Rotation[Batch]:
    """Nine arrays, row by row, from matrices of shape (..., 3, 3)."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = (
        matrices[..., i, j] for i in range(3) for j in range(3)
    )
    return r00, r01, r02, r10, r11, r12, r20, r21, r22


def matrix_from_quaternion(q: ArrayLike) -> Array:
    """
    Rotation matrices of quaternions.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Unit quaternions x, y, z, w.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        R_base_platform.

    Raises
    ------
    InputError
        `q` is not an array of finite numbers of that shape, or a norm differs from 1 by more than
        `QUATERNION_NORM_TOLERANCE`.

    """
    q = check_array('q', q, (4,))
    with np.errstate(over='ignore'):
        norm = np.linalg.norm(q, axis=-1, keepdims=True)
    bad = np.abs(norm[..., 0] - 1.0) > QUATERNION_NORM_TOLERANCE
    if np.any(bad):
        where = first_index(bad)
        raise InputError(
            f'q = {q[where].tolist()}: norm {norm[where][0]:.9g}, expected a unit quaternion'
        )
    x, y, z, w = np.moveaxis(q / norm, -1, 0)
    return stack_matrix(rotation_from_quaternion(x, y, z, w))


def quaternion_from_matrix(R: ArrayLike) -> Array:
    """
    Quaternions of rotation matrices.

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.

    Returns
    -------
    ndarray, shape (..., 4)
        Unit quaternions x, y, z, w, with w >= 0.

    Raises
    ------
    InputError
        `R` is not an array of rotations of that shape.

    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = unstack_matrix(check_rotations('R', R))
    # Each row of 4 q q^T is a multiple of q; the one with the largest diagonal entry is not small.
    products = np.stack(
        [
            1.0 + r00 - r11 - r22,
            r01 + r10,
            r02 + r20,
            r21 - r12,
            r01 + r10,
            1.0 - r00 + r11 - r22,
            r12 + r21,
            r02 - r20,
            r02 + r20,
            r12 + r21,
            1.0 - r00 - r11 + r22,
            r10 - r01,
            r21 - r12,
            r02 - r20,
            r10 - r01,
            1.0 + r00 + r11 + r22,
        ],
        axis=-1,
    )
    products = products.reshape(products.shape[:-1] + (4, 4))
    diagonals = np.diagonal(products, axis1=-2, axis2=-1)
    row = np.argmax(diagonals, axis=-1)
    chosen: Array = np.take_along_axis(products, row[..., None, None], axis=-2)
    q = chosen[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    unit: Array = np.where(q[..., 3:] < 0.0, -q, q)
    return unit


def matrix_from_zxz(psi: ArrayLike, theta: ArrayLike, phi: ArrayLike) -> Array:
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
        An angle is not finite, or the shapes do not broadcast.

    """
    psi = check_angles('psi', psi, ())
    theta = check_angles('theta', theta, ())
    phi = check_angles('phi', phi, ())
    check_broadcast('psi, theta, phi', psi.shape, theta.shape, phi.shape)
    return stack_matrix(_zxz_rotation(psi, theta, phi, ARRAYS))


def zxz_from_matrix(R: ArrayLike) -> tuple[Array, Array, Array]:
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
        `R` is not an array of rotations of that shape.

    """
    x, y, z, w = np.moveaxis(quaternion_from_matrix(R), -1, 0)
    angles: tuple[Any, Any, Any] = _zxz_angles(x, y, z, w, ARRAYS)
    return angles


def wrapped(angle: Angle) -> Angle:
    """Return an angle or angles, rad, in [-pi, pi[."""
    turn = 2.0 * np.pi
    return (angle + np.pi) % turn - np.pi


def matrix_from_vector(vectors: Array) -> Array:
    """Return the rotations, shape (n, 3, 3), by rotation vectors, rad, shape (n, 3)."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    along = 0.5 * vectors * np.sinc(half / np.pi)
    return matrix_from_quaternion(np.hstack([along, np.cos(half)]))
