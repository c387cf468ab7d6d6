# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Products of three-vectors and matrices, as kernels on numbers.

A vector is three numbers, a matrix nine of them, row by row. The numbers are floats on the 1 kHz
path and arrays in a batch (see `number_backends`).
"""

from __future__ import annotations

from spm_haptic_master.kinematics.number_backends import N, Rotation, Vector


def added(u: Vector[N], v: Vector[N]) -> Vector[N]:
    """Return u + v."""
    ux, uy, uz = u
    vx, vy, vz = v
    return ux + vx, uy + vy, uz + vz


def subtracted(u: Vector[N], v: Vector[N]) -> Vector[N]:
    """Return u - v."""
    ux, uy, uz = u
    vx, vy, vz = v
    return ux - vx, uy - vy, uz - vz


def scaled(factor: N, u: Vector[N]) -> Vector[N]:
    """Return a vector times a factor."""
    x, y, z = u
    return factor * x, factor * y, factor * z


def dot(u: Vector[N], v: Vector[N]) -> N:
    """Return the scalar product of two vectors."""
    ux, uy, uz = u
    vx, vy, vz = v
    return ux * vx + uy * vy + uz * vz


def cross(u: Vector[N], v: Vector[N]) -> Vector[N]:
    """Return the vector product of two vectors."""
    ux, uy, uz = u
    vx, vy, vz = v
    return (
        uy * vz - uz * vy,
        uz * vx - ux * vz,
        ux * vy - uy * vx,
    )


def times(matrix: Rotation[N], vector: Vector[N]) -> Vector[N]:
    """Return a matrix times a vector: its components before the rotation, after it."""
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = matrix
    x, y, z = vector
    return (
        m00 * x + m01 * y + m02 * z,
        m10 * x + m11 * y + m12 * z,
        m20 * x + m21 * y + m22 * z,
    )


def transposed_times(matrix: Rotation[N], vector: Vector[N]) -> Vector[N]:
    """Return a matrix's transpose times a vector: for a rotation, the inverse rotation."""
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = matrix
    x, y, z = vector
    return (
        m00 * x + m10 * y + m20 * z,
        m01 * x + m11 * y + m21 * z,
        m02 * x + m12 * y + m22 * z,
    )


def about_x(
    cosine: N,
    sine: N,
    vector: Vector[N],
) -> Vector[N]:
    """Return Rx(angle) times a vector, from cosine and sine of the angle."""
    x, y, z = vector
    return x, cosine * y - sine * z, sine * y + cosine * z


def about_z(
    cosine: N,
    sine: N,
    vector: Vector[N],
) -> Vector[N]:
    """Return Rz(angle) times a vector, from cosine and sine of the angle."""
    x, y, z = vector
    return cosine * x - sine * y, sine * x + cosine * y, z
