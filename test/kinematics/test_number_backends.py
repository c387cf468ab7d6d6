# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Functions of floats and of arrays are the same, also at their limits."""

import math

import numpy as np
import pytest
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.number_backends import ARRAYS, FLOATS


def both(name, *arguments):
    """Return what a function returns for floats, and for arrays of them."""
    arrays = [np.array([argument]) for argument in arguments]
    (of_arrays,) = getattr(ARRAYS, name)(*arrays)
    return getattr(FLOATS, name)(*arguments), float(of_arrays)


@pytest.mark.parametrize(
    ('square', 'root'),
    [(4.0, 2.0), (1e-20, 1e-10), (0.0, 0.0), (-1e-15, 0.0), (-0.9e-12, 0.0)],
)
def test_a_leg_reaches_a_pose_but_for_rounding(square, root):
    assert both('reach_root', square) == pytest.approx((root, root))


def test_a_leg_does_not_reach_beyond_rounding():
    with pytest.raises(UnreachableError, match='no configuration reaches the pose'):
        FLOATS.reach_root(-1.1e-12)
    assert np.isnan(ARRAYS.reach_root(np.array([-1.1e-12]))).all()


@pytest.mark.parametrize('b', [1.1e-6, -1.1e-6, 0.5, -2.0])
def test_a_leg_off_the_boundary_of_its_mode_has_rates(b):
    assert both('mode_reciprocal', b) == pytest.approx((1.0 / b, 1.0 / b))


@pytest.mark.parametrize('b', [0.9e-6, -0.9e-6, 0.0])
def test_a_leg_on_the_boundary_of_its_mode_has_none(b):
    with pytest.raises(SingularityError, match='on the boundary of its working mode'):
        FLOATS.mode_reciprocal(b)
    assert np.isnan(ARRAYS.mode_reciprocal(np.array([b]))).all()


@pytest.mark.parametrize(
    ('square', 'least', 'expected'),
    [(4.0, 1e-12, 0.5), (1.1e-12, 1e-12, 1.1e-12**-0.5), (0.9e-12, 1e-12, 0.0), (0.0, 0.0, 0.0)],
)
def test_a_reciprocal_root_is_zero_up_to_a_least_square(square, least, expected):
    floats = FLOATS.reciprocal_root(square, least)
    arrays = ARRAYS.reciprocal_root(np.array([square]), least)
    assert (floats, float(arrays[0])) == pytest.approx((expected, expected))


@pytest.mark.parametrize(
    ('angle', 'expected'),
    [
        (0.3, 0.3),
        (6.0, 6.0 - 2.0 * math.pi),
        (-10.0, 4.0 * math.pi - 10.0),
    ],
)
def test_a_remainder_is_less_the_nearest_turn(angle, expected):
    floats = FLOATS.remainder(angle, 2.0 * math.pi)
    arrays = ARRAYS.remainder(np.array([angle]), 2.0 * math.pi)
    assert (floats, float(arrays[0])) == pytest.approx((expected, expected))
