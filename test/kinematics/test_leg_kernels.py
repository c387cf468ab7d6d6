# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Turn equations: both solutions of one, the common one of two, and those without any."""

import math

import numpy as np
import pytest
from spm_haptic_master.kinematics.leg_kernels import both_turns, common_turn


def value(equation, t):
    return equation[0] * math.cos(t) + equation[1] * math.sin(t) + equation[2]


def test_both_solutions_of_a_turn_equation():
    rng = np.random.default_rng(95)
    for first, second in rng.uniform(-3.0, 3.0, (20, 2)):
        # cos(t - middle) = cos(half) has the solutions middle - half and middle + half.
        middle, half = 0.5 * (first + second), 0.5 * (first - second)
        equation = 2.0 * np.array([math.cos(middle), math.sin(middle), -math.cos(half)])
        found = both_turns(tuple(equation.tolist()))
        assert found[0] <= found[1]
        for t in found:
            assert value(equation, t) == pytest.approx(0.0, abs=1e-12)
        assert min(abs(math.remainder(t - first, 2.0 * math.pi)) for t in found) < 1e-6
        assert min(abs(math.remainder(t - second, 2.0 * math.pi)) for t in found) < 1e-6


@pytest.mark.parametrize('equation, nearest', [
    ((1.0, 0.0, 2.0), math.pi), ((1.0, 0.0, -2.0), 0.0), ((0.0, 1.0, 3.0), -0.5 * math.pi)])
def test_without_a_solution_the_nearest_turn_twice(equation, nearest):
    for t in both_turns(equation):
        assert abs(math.remainder(t - nearest, 2.0 * math.pi)) < 1e-12


def test_an_equation_without_a_turn_has_two_distinct_candidates():
    assert both_turns((0.0, 0.0, 0.3)) == (-0.5 * math.pi, 0.5 * math.pi)


def test_common_solution_of_two_turn_equations():
    t = 2.2
    first, second = (
        (a, b, -a * math.cos(t) - b * math.sin(t)) for a, b in ((1.0, 2.0), (-0.5, 0.7)))
    cosine, sine, determinant = common_turn(first, second)
    assert determinant == pytest.approx(1.7)
    assert cosine / determinant == pytest.approx(math.cos(t))
    assert sine / determinant == pytest.approx(math.sin(t))
