# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A vibration of the device is no noise of its sensors: it widens no limit."""

from math import inf

from device import about, encoders, joint_angles, random_pose, stamps, vibration
import numpy as np
import pytest
from spm_haptic_master.parameters.fkm import SUPERVISION_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.supervisor import make_supervisor


def vibrating():
    """Return the orientations of a device that vibrates at 200 Hz, by 0.2 deg."""
    rng = np.random.default_rng(4)
    return about(random_pose(rng), rng.normal(size=3), vibration(200.0, 1.2))


def play(supervisor, rotations, sensors=4):
    """Return the largest factor of each sensor's limits while the device moves."""
    readings = encoders(joint_angles(rotations, sensors))
    factors = []
    for stamp, angles in zip(stamps(len(readings)), readings, strict=True):
        supervisor.take(int(stamp), tuple(angles.tolist()))
        factors.append(supervisor.joints.factors)
    return np.max(factors, axis=0)


@pytest.mark.parametrize('sensors', [4, 6])
def test_a_vibration_does_not_widen_the_limits(sensors):
    """All joints seem noisier; the parity, which sees their noise, does not."""
    supervisor = make_supervisor(complete(SUPERVISION_SETTINGS, {'sensors': sensors}))
    assert np.all(play(supervisor, vibrating(), sensors) == 1.0)


def test_nor_those_of_a_joint_that_the_parity_does_not_see():
    """It vibrates if any other joint does."""
    supervisor = make_supervisor(complete(SUPERVISION_SETTINGS, {}))
    play(supervisor, vibrating())
    supervisor.joints.follow_noise([1.0, 1.0, 1.0, inf])
    assert supervisor.joints.factors == (1.0,) * 4
    # Alone it is noise: the limits allow for it.
    supervisor.joints.follow_noise([inf, inf, inf, inf])
    assert min(supervisor.joints.factors) > 1.25
