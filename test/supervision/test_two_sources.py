# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples of two devices in turn, then a pause, then those of one: orientations again."""

from device import encoders
import numpy as np
import pytest
from spm_haptic_master.kinematics import Geometry, measured_angles, zxz_rotation
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.simulation.trajectories import fig9
from spm_haptic_master.supervision.supervisor import make_supervisor

MS = 1_000_000


@pytest.fixture(scope='module')
def angles():
    """Return readings of the motion of `make run`, a self-rotation through the singularity."""
    return encoders(np.array([
        measured_angles(zxz_rotation(*fig9(index * 1e-3)), Geometry(), RIG_WORKING_MODE, 4)
        for index in range(6000)]))


@pytest.mark.parametrize('seed', range(20, 60))
def test_after_two_that_publish_at_once_one_is_followed_again(angles, seed):
    rng = np.random.default_rng(seed)
    begin, length = int(rng.integers(500, 2500)), int(rng.integers(20, 250))
    phase = int(rng.integers(1, MS))
    both = [(index * MS, angles[index]) for index in range(begin + length)] + [
        ((begin + index) * MS + phase, angles[index]) for index in range(length)]
    again = begin + length + 1500
    samples = sorted(both, key=lambda each: each[0]) + [
        (index * MS, angles[index]) for index in range(again, again + 1500)]
    supervisor = make_supervisor(complete(FKM_SETTINGS, {}))
    for stamp, angle in samples:
        verdict = supervisor.take(1000 * MS + stamp, tuple(angle.tolist()))
    assert verdict.text == 'healthy'
