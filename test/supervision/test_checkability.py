# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What can be checked is known before: the share of a region, and the least alert limit."""

import numpy as np
from rig import product_limits
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.checkability import (
    checkability,
    region_poses,
    unchecked_anywhere,
)

SIGMA = tuple(np.radians([0.04] * 6))


def of_rig(sensors, bias_deg, alert_deg, poses=None):
    limits = product_limits(
        bias=tuple(np.radians([bias_deg] * sensors)), alert_limit=np.radians(alert_deg)
    )
    return checkability(PAPER_GEOMETRY, SIGMA[:sensors], limits, poses)


def test_every_sensor_of_six_is_checked_everywhere_and_th3a_of_four_not_at_the_singularity():
    assert of_rig(6, 0.05, 1.0).share == (1.0,) * 6
    four = of_rig(4, 0.05, 1.0)
    assert four.nowhere == ()
    assert min(four.share[:3]) > 0.75
    assert 0.3 < four.share[3] < 0.8


def test_below_the_least_limit_a_sensor_is_checked_nowhere():
    least = np.degrees(of_rig(4, 0.05, 1.0).least_limit)
    assert of_rig(4, 0.05, 1.001 * least[3]).share[3] > 0.0
    assert 3 in of_rig(4, 0.05, 0.999 * least[3]).nowhere


def test_bias_as_large_as_the_alert_limit_leaves_no_sensor_checked():
    assert of_rig(4, 1.0, 1.0).nowhere == (0, 1, 2, 3)


def test_poses_out_of_reach_do_not_count():
    poses = region_poses(np.radians(20.0), 0.0, np.radians(60.0))
    beyond = region_poses(np.radians(100.0), 0.0, np.radians(60.0))
    assert of_rig(4, 0.05, 1.0, poses).share[0] > 0.9
    assert of_rig(4, 0.05, 1.0, beyond[-50:]).share == (0.0,) * 4


def test_the_words_name_the_sensors_that_are_checked_nowhere_and_their_limits():
    """As fkm warns at its start."""
    assert unchecked_anywhere(complete(FKM_SETTINGS, {})) == ''
    words = unchecked_anywhere(complete(FKM_SETTINGS, {'bias_deg': [0.25] * 4}))
    assert words.startswith('checked nowhere in the workspace at alert_limit_deg 1: ')
    assert 'joint_3a (from 1.' in words
