# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Jumps that no parity shows are detected by the motion, whatever the noise just before them."""

from device import encoders, joint_angles, motion, Outcome
import numpy as np
import pytest

# Seeds of the noise; the jump (sample).
SEEDS, JUMP = 60, 150
# Jumps, deg: th3A at the singularity; th1A and th1B that leave the parity as it is.
JUMPS = {'singular': [0.0, 0.0, 0.0, 5.0], 'rest': [2.0, -1.87, 0.0, 0.0]}


@pytest.mark.parametrize('kind', JUMPS)
@pytest.mark.parametrize(('noise', 'bits'), [(0.04, 12), (0.04, 14), (0.006, 17)])
def test_a_jump_that_no_parity_shows_is_detected_with_any_noise_before_it(kind, noise, bits):
    rotations = motion(kind, 0.18)
    angles = joint_angles(rotations)
    angles[JUMP:] += np.radians(JUMPS[kind])
    missed = [seed for seed in range(SEEDS) if Outcome(
        rotations, encoders(angles, noise, bits, seed), sigma_deg=[noise] * 4).published[-1]]
    assert not missed
