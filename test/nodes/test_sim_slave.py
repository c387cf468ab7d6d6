# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated slave: a first-order lag to its command, which it holds."""

from math import exp

import numpy as np
import pytest
from spm_haptic_master.kinematics.rotations import quaternion_from_vector
from spm_haptic_master.nodes.sim_slave import follow


@pytest.mark.parametrize('steps', [1, 5000])
def test_the_error_shrinks_by_the_time_constant_in_steps_of_any_length(steps):
    def turned(angle):
        return quaternion_from_vector(0.6 * angle, 0.48 * angle, -0.64 * angle)

    rotation = turned(0.4)
    for _ in range(steps):
        rotation = follow(rotation, turned(1.4), 2.5 / steps)
    np.testing.assert_allclose(rotation, turned(1.4 - exp(-2.5)), atol=1e-9)
    assert np.linalg.norm(rotation) == pytest.approx(1.0, abs=1e-12)
