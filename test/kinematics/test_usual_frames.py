# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The frames of a mechanism as built that need no outside reference."""

from built_mechanism import Built, nominal, random_built
from mechanism import random_rotation, turn
import numpy as np
import pytest
from spm_haptic_master.exceptions import GeometryError, InputError
from spm_haptic_master.kinematics import Geometry, in_usual_frames, inverse


def test_a_nominal_mechanism_is_in_them():
    moved, base, platform = in_usual_frames(Geometry())
    np.testing.assert_allclose(base, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(platform, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(moved.platform_axes, Geometry().platform_axes, atol=1e-15)
    assert moved.base_axes == Geometry().base_axes


def test_they_are_the_same_from_any_other_frames():
    rng = np.random.default_rng(300)
    for _ in range(20):
        built = random_built(rng)
        there, base, platform = in_usual_frames(built.geometry)
        assert there.base_axes[0] == (0.0, 0.0, 1.0)
        assert there.base_axes[1][1] == 0.0 < there.base_axes[1][0]
        # Where the sum of squares is least, no small turn reduces it.
        axes, drawn = np.array(there.platform_axes), np.array(Geometry().platform_axes)
        np.testing.assert_allclose(np.cross(axes, drawn).sum(0), 0.0, atol=1e-14)
        assert ((axes - drawn)**2).sum() < ((axes @ turn([0.1, 0.0, 0.2]).T - drawn)**2).sum()
        assert np.linalg.det(base) == pytest.approx(1.0) == np.linalg.det(platform)
        outer, inner = turn(0.3 * rng.normal(size=3)), turn(0.3 * rng.normal(size=3))
        again, _, _ = in_usual_frames(
            Built(built.base @ outer.T, built.platform @ inner.T, built.alpha,
                  built.beta).geometry)
        np.testing.assert_allclose(again.base_axes, there.base_axes, atol=1e-14)
        np.testing.assert_allclose(again.platform_axes, there.platform_axes, atol=1e-14)


def test_the_rotations_take_orientations_there():
    rng = np.random.default_rng(301)
    built = random_built(rng)
    there, base, platform = in_usual_frames(built.geometry)
    moved = []
    for _ in range(10):
        R = built.reachable_rotation(rng)
        here, other = inverse(R, built.geometry), inverse(base @ R @ platform.T, there)
        moved.append(np.append(other.theta1 - here.theta1, other.theta3a - here.theta3a))
    # The same pose: each joint differs by the shift of its zero only.
    np.testing.assert_allclose(np.sin(np.array(moved) - moved[0]), 0.0, atol=1e-9)


def test_axes_opposite_to_their_directions_there_are_refused():
    base = nominal().base.copy()
    base[2] = -base[2]
    mirrored = random_rotation(np.random.default_rng(302))
    built = Built(base @ mirrored.T, nominal().platform, nominal().alpha, nominal().beta)
    with pytest.raises(GeometryError, match='Z1C .* is opposite to'):
        in_usual_frames(built.geometry)


@pytest.mark.parametrize('arguments', [(None,), (Geometry(), 39.3)])
def test_what_is_no_mechanism_is_refused(arguments):
    with pytest.raises(InputError, match=str(arguments[-1])):
        in_usual_frames(*arguments)
