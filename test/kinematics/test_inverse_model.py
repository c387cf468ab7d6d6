# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Inverse model: the golden values, the loops it must close, the reach it must not overstate."""

import math

from built_mechanism import nominal, random_built, random_nominal
from mechanism import CENTRE, MODES, random_rotations, turn, zxz
import numpy as np
import pytest
from readings import all_angles
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics import inverse, mechanism_angles


@pytest.mark.parametrize('mode, th1, th2a, th3a', [
    ((1, 1, 1), 63.57909396, 101.63324416, 0.90461292),
    ((-1, -1, -1), 166.55321231, -101.63324416, 125.15989244)])
def test_golden_values_at_phi_50(mode, th1, th2a, th3a):
    joints = inverse(zxz(*CENTRE, math.radians(50.0)), working_mode=mode)
    np.testing.assert_allclose(np.degrees(joints.theta1), th1, atol=1e-8)
    assert math.degrees(joints.theta2a) == pytest.approx(th2a, abs=1e-8)
    assert math.degrees(joints.theta3a) == pytest.approx(th3a, abs=1e-8)


def test_unreachable_is_exactly_what_the_links_cannot_span():
    rng = np.random.default_rng(3)
    for built in (nominal(), *(random_nominal(rng) for _ in range(4))):
        R, g = random_rotations(rng, 300).reshape(20, 15, 3, 3), built.geometry
        joints, expected = inverse(R, g), built.margins(R).min(-1) >= 0.0
        assert joints.theta1.shape == (20, 15, 3) and 0 < expected.sum() < 300
        for values in (*np.moveaxis(joints.theta1, -1, 0), joints.theta2a, joints.theta3a,
                       joints.theta3b, joints.theta3c):
            np.testing.assert_array_equal(np.isfinite(values), expected)
        for place in np.ndindex(20, 15):
            numbers = tuple(R[place].ravel().tolist())
            if expected[place]:
                inverse(R[place], g)
                mechanism_angles(numbers, g)
            else:
                with pytest.raises(UnreachableError, match='no configuration'):
                    inverse(R[place], g)
                with pytest.raises(UnreachableError):
                    mechanism_angles(numbers, g)


def test_third_joints_of_a_mechanism_as_built():
    rng = np.random.default_rng(301)
    for trial in range(30):
        built, mode = random_built(rng), MODES[trial % 8]
        R = built.reachable_rotation(rng)
        angles = all_angles(R, built.geometry, mode)
        for k, second in enumerate(built.second_axes(angles[:3])):
            first, at_zero, third, zero = built.zero[k]
            # Z2k as the platform sees it, which only th3k moves.
            seen = zero.T @ turn(-angles[3 + k] * third) @ at_zero
            np.testing.assert_allclose(R @ seen, second, atol=1e-12)
            assert np.linalg.norm(first) == pytest.approx(1.0)
