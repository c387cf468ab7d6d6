# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Vectors of three numbers beside those of numpy."""

import numpy as np
from spm_haptic_master.kinematics import vectors

U = (0.3, -1.2, 2.5)
V = (-0.7, 0.4, 1.1)
MATRIX = (0.1, 0.2, -0.3, 0.4, -0.5, 0.6, 0.7, 0.8, 0.9)


def test_sums_products_and_differences_are_those_of_numpy():
    u = np.array(U)
    v = np.array(V)
    np.testing.assert_allclose(vectors.added(U, V), u + v)
    np.testing.assert_allclose(vectors.subtracted(U, V), u - v)
    np.testing.assert_allclose(vectors.scaled(-2.5, U), -2.5 * u)
    np.testing.assert_allclose(vectors.dot(U, V), u @ v)
    np.testing.assert_allclose(vectors.cross(U, V), np.cross(u, v))


def test_a_matrix_and_its_transpose_take_a_vector():
    matrix = np.reshape(MATRIX, (3, 3))
    np.testing.assert_allclose(vectors.times(MATRIX, U), matrix @ U)
    np.testing.assert_allclose(vectors.transposed_times(MATRIX, U), matrix.T @ U)


def test_turns_about_two_axes():
    cosine = 0.6
    sine = 0.8
    about_x = [[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]]
    about_z = [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(vectors.about_x(cosine, sine, U), np.array(about_x) @ U)
    np.testing.assert_allclose(vectors.about_z(cosine, sine, U), np.array(about_z) @ U)
