# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What can be checked is known before: the share of a region, and the least alert limit."""

from math import inf, sqrt

from device import joint_angles
import numpy as np
import pytest
from rig import product_limits
from spm_haptic_master import kinematics
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision import checkability as checkability_module
from spm_haptic_master.supervision.checkability import (
    checkability,
    region_poses,
    unchecked_anywhere,
)
from spm_haptic_master.supervision.protection import integrity, MISSED_DETECTION

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


def test_a_region_is_spread_evenly_over_its_cone_and_turns():
    """Five rings of the same area, eight azimuths, thirteen self-rotations."""
    tilt = np.radians(20.0)
    poses = region_poses(tilt, 0.1, 1.3)
    assert poses.shape == (520, 3, 3)
    for index, (ring, azimuth, turn) in {
        0: (0, 0, 0),
        12: (0, 0, 12),
        13: (0, 1, 0),
        103: (0, 7, 12),
        104: (1, 0, 0),
        519: (4, 7, 12),
    }.items():
        share = (ring + 0.5) / 5.0
        expected = kinematics.workspace_pose(
            np.arccos(1.0 - share * (1.0 - np.cos(tilt))),
            azimuth * np.pi / 4.0,
            0.1 + 0.1 * turn,
        )
        np.testing.assert_allclose(poses[index], expected, atol=1e-12)


def test_by_default_the_region_is_a_tilt_of_20_deg_and_turns_of_90(monkeypatch):
    regions = []

    def few_poses(*region):
        regions.append(np.degrees(region).tolist())
        return region_poses(*region)[:2]

    monkeypatch.setattr(checkability_module, 'region_poses', few_poses)
    of_rig(4, 0.05, 1.0)
    assert regions == [pytest.approx([20.0, 0.0, 90.0])]


@pytest.mark.parametrize('sensors', [4, 6])
@pytest.mark.parametrize(('rate', 'samples'), [(1000.0, 20), (4000.0, 80), (100.0, 10)])
def test_the_least_limits_are_the_parts_of_the_level_once_the_window_is_full(
    sensors, rate, samples
):
    """Of the best pose, by sensor; the window has ten samples at least."""
    limits = product_limits(bias=(1e-3,) * sensors)
    poses = region_poses(0.2, 0.2, 0.6)[[0, 300]]
    undetected = (limits.threshold(sensors - 3) + MISSED_DETECTION) / sqrt(samples)
    parts = []
    for pose in poses:
        estimate = kinematics.estimate_sample(
            tuple(joint_angles(pose[None], sensors)[0].tolist()),
            kinematics.UsedSensors(SIGMA[:sensors]),
            PAPER_GEOMETRY,
            tuple(kinematics.quaternion_from_matrix(pose).tolist()),
        )
        worth = integrity(estimate, limits.bias, (1.0,) * sensors, limits.parity_bias)
        parts.append(worth.parts(undetected))
    found = checkability(PAPER_GEOMETRY, SIGMA[:sensors], limits, poses, rate)
    assert found.least_limit == pytest.approx(np.min(parts, axis=0))
    assert found.share == pytest.approx(np.mean(np.array(parts) <= limits.alert_limit, axis=0))
    if rate == 1000.0:
        assert checkability(PAPER_GEOMETRY, SIGMA[:sensors], limits, poses) == found


def test_where_no_pose_is_within_reach_no_limit_is_large_enough():
    beyond = region_poses(np.radians(100.0), 0.0, np.radians(60.0))[-5:]
    found = of_rig(4, 0.05, 1.0, beyond)
    assert found.least_limit == (inf,) * 4
    assert found.nowhere == (0, 1, 2, 3)
