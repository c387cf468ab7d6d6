# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Constant rotations of base and handle: on orientations, covariances and frames."""

import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.fkm import check_frames, INTERFACE_SETTINGS
from spm_haptic_master.parameters.geometry import mounting_from, MOUNTING_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision import supervise

BASE_DEG = [30.0, 40.0, -70.0]
HANDLE_DEG = [10.0, -20.0, 200.0]


@pytest.mark.parametrize(
    'base, handle',
    [
        (BASE_DEG, HANDLE_DEG),
        (BASE_DEG, [0.0] * 3),
        ([0.0] * 3, HANDLE_DEG),
    ],
)
def test_the_supervision_publishes_the_handle_on_the_table(base, handle):
    pose = kinematics.workspace_pose(*np.radians([10.0, 100.0, 60.0]))
    joints = kinematics.inverse(pose)
    noise = np.random.default_rng(1).normal(0.0, 5e-4, (40, 4))
    angles = [*joints.theta1, joints.theta3a] + noise
    stamps = np.arange(40) * 1_000_000
    plain = supervise(stamps, angles)
    mounted = supervise(
        stamps, angles, mounting__base_zxz_deg=base, mounting__handle_zxz_deg=handle
    )
    seen = plain.published
    assert seen.sum() == 36
    assert (mounted.published == seen).all()
    table = kinematics.matrix_from_zxz(*np.radians(base))
    grip = kinematics.matrix_from_zxz(*np.radians(handle))
    inner = kinematics.matrix_from_quaternion(plain.quaternion[seen])
    outer = kinematics.matrix_from_quaternion(mounted.quaternion[seen])
    np.testing.assert_allclose(outer, table @ inner @ grip, rtol=0.0, atol=1e-14)
    expected = table @ plain.covariance[seen] @ table.T
    np.testing.assert_allclose(mounted.covariance[seen], expected, rtol=0.0, atol=1e-20)
    # What is decided on is the mechanism's own.
    np.testing.assert_array_equal(mounted.protection_level, plain.protection_level)
    assert mounted.state == plain.state
    mounting = mounting_from(
        complete(
            MOUNTING_SETTINGS, {'mounting.base_zxz_deg': base, 'mounting.handle_zxz_deg': handle}
        )
    )
    back = mounting.unmounted(tuple(mounted.quaternion[-1].tolist()))
    np.testing.assert_allclose(
        kinematics.matrix_from_quaternion(back), inner[-1], rtol=0.0, atol=1e-14
    )
    assert mounting_from(complete(MOUNTING_SETTINGS, {})) is None


def test_the_handles_frame_has_a_name_of_its_own():
    check_frames(complete(INTERFACE_SETTINGS, {}))
    values = complete(INTERFACE_SETTINGS, {'mounting.handle_frame_id': 'spm_platform'})
    with pytest.raises(SettingError, match='than that of mounting.platform_frame_id'):
        check_frames(values)
