# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Encoders slower than the bus: the age of a reading is in the level."""

from device import encoders, joint_angles, motion, Outcome
import numpy as np
import pytest


@pytest.mark.parametrize('speed', [0.5, 1.0])
@pytest.mark.parametrize('every', [2, 4])
@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_the_error_is_within_the_level(sensors, every, speed, noise=0.04, bits=14):
    """All encoders hold their readings for some samples; largest speed of a joint in rad/s."""
    fastest = 1000.0 * np.abs(np.diff(joint_angles(motion('fast', 2.0)), axis=0)).max()
    # As fast as that at 1 kHz.
    rotations = motion('fast', 0.4, 1000.0 * fastest / speed)
    angles = encoders(joint_angles(rotations, sensors), noise, bits)
    held = angles[np.arange(len(angles)) // every * every]
    run = Outcome(rotations, held, sigma_deg=[noise] * 4)
    out = run.published
    assert out[10:].mean() > 0.99, run.states
    assert np.all(run.error[out] <= run.result.protection_level[out])
