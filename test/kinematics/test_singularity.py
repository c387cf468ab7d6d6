# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Distance of one pose from the parallel singularities, compared with the batch and a search."""


from built_mechanism import random_built
from mechanism import MODES, turn
import numpy as np
import pytest
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics import (
    Geometry,
    matrix_from_zxz,
    parallel_determinant,
    quaternion_from_matrix,
)
from spm_haptic_master.kinematics.jacobians import approach, determinant_gradient, nearness

GEOMETRY = Geometry()
MODE = (1, 1, 1)


def pose(psi, theta, phi):
    rotation = matrix_from_zxz(*np.radians([psi, theta, phi]))
    return rotation, tuple(quaternion_from_matrix(rotation).tolist())


@pytest.mark.parametrize('zxz', [
    (135.0, 54.7356, 40.0), (135.0, 54.7356, 49.0), (135.0, 54.7356, 55.0), (125.0, 50.0, 45.0),
    (140.0, 60.0, 52.0)])
def test_approach_ends_on_the_singular_surface_and_nothing_is_nearer(zxz):
    rotation, quaternion = pose(*zxz)
    got = approach(quaternion, GEOMETRY, MODE)
    assert np.linalg.norm(got.axis) == pytest.approx(1.0, abs=1e-12)
    here = parallel_determinant(rotation)

    def determinant(angle, axis):
        return parallel_determinant(turn(angle * np.asarray(axis)) @ rotation)

    assert abs(determinant(got.distance, got.axis)) < 1e-6 * abs(here)
    assert determinant(1.001 * got.distance, got.axis) * here < 0.0
    # Neither along random directions nor just beside the one that was found.
    rng = np.random.default_rng(53)
    directions = np.concatenate([
        rng.normal(size=(200, 3)), got.axis + 0.1 * rng.normal(size=(100, 3))])
    for direction in directions / np.linalg.norm(directions, axis=-1, keepdims=True):
        for part in (0.5, 0.999):
            assert determinant(part * got.distance, direction) * here > 0.0


def test_the_determinants_gradient_is_a_finite_difference():
    rng = np.random.default_rng(189)
    for trial in range(20):
        built, mode = random_built(rng), MODES[trial % 8]
        g, R = built.geometry, built.reachable_rotation(rng, slack=0.1)
        value, gradient = determinant_gradient(tuple(R.ravel().tolist()), g, mode)
        assert value == pytest.approx(parallel_determinant(R, g, mode), abs=1e-12)
        expected = [(parallel_determinant(turn(1e-5 * axis) @ R, g, mode)
                     - parallel_determinant(turn(-1e-5 * axis) @ R, g, mode)) / 2e-5
                    for axis in np.eye(3)]
        np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6)


def test_nothing_out_of_reach_and_where_there_is_no_singularity():
    out = pose(0.0, 170.0, 0.0)[1]
    with pytest.raises(UnreachableError):
        nearness(out, GEOMETRY, MODE)
    assert approach(out, GEOMETRY, MODE) is None
    # From here Newton's method leaves the reach of the legs.
    assert approach(pose(135.0, 54.7356, -60.0)[1], GEOMETRY, MODE) is None


def test_distance_in_degrees_along_the_central_axis():
    for phi in (45.0, 48.0, 51.0, 55.0):
        got = approach(pose(135.0, 54.735610317, phi)[1], GEOMETRY, MODE)
        assert np.degrees(got.distance) == pytest.approx(abs(phi - 49.358591780), abs=1e-4)
        # Self-rotation is a turn about the platform axis, on (1, 1, 1).
        towards = np.sign(49.358591780 - phi)
        assert np.allclose(got.axis, towards / np.sqrt(3.0), atol=1e-4)
