# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated slave: a first-order lag to its command, which it holds."""

from math import exp

from mechanism import turn
import numpy as np
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.kinematics.rotations import quaternion_from_vector
from spm_haptic_master.simulation.instrument_wrist import InstrumentWrist


def test_the_error_shrinks_by_the_time_constant_in_steps_of_any_length():
    for steps in (1, 50):
        wrist = InstrumentWrist(quaternion_from_vector(0.4, 0.0, 0.0), 0.02)
        wrist.commanded = quaternion_from_vector(0.4, 0.0, 0.0)
        wrist.advance(1.0)
        np.testing.assert_allclose(
            matrix_from_quaternion(wrist.rotation), turn([0.4, 0.0, 0.0]), atol=1e-12)
        wrist.commanded = quaternion_from_vector(1.4, 0.0, 0.0)
        for _ in range(steps):
            wrist.advance(0.05 / steps)
        np.testing.assert_allclose(
            matrix_from_quaternion(wrist.rotation),
            turn([1.4 - exp(-2.5), 0.0, 0.0]), atol=1e-12)
