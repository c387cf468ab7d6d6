# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated slave: a first-order lag to its command, which it holds."""

from math import exp

import numpy as np
import pytest
from spm_haptic_master.kinematics.rotations import quaternion_from_vector
from spm_haptic_master.simulation.instrument_wrist import InstrumentWrist


@pytest.mark.parametrize('steps', [1, 50])
def test_the_error_shrinks_by_the_time_constant_in_steps_of_any_length(steps):
    def turned(angle):
        return quaternion_from_vector(0.6 * angle, 0.48 * angle, -0.64 * angle)

    # It is as good as a rotation again after the first step.
    wrist = InstrumentWrist(tuple(1.001 * np.array(turned(0.4))), 0.02)
    for _ in range(steps):
        wrist.advance(1.0 / steps)
    np.testing.assert_allclose(wrist.rotation, turned(0.4), atol=1e-3)
    assert np.linalg.norm(wrist.rotation) == pytest.approx(1.0, abs=1e-12)
    wrist = InstrumentWrist(turned(0.4), 0.02)
    wrist.commanded = turned(1.4)
    for _ in range(steps):
        wrist.advance(0.05 / steps)
    np.testing.assert_allclose(wrist.rotation, turned(1.4 - exp(-2.5)), atol=1e-12)
