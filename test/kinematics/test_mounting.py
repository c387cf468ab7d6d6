# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Constant rotations of base and handle: on orientations, covariances and frames' names."""

import numpy as np
import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics import (
    estimate,
    inverse,
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
    workspace_pose,
)
from spm_haptic_master.kinematics.angular_velocity import AngularVelocity
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.parameters.fkm import check_frames, INTERFACE_SETTINGS
from spm_haptic_master.parameters.geometry import mounting_from, MOUNTING_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision import supervise

BASE_DEG, HANDLE_DEG = [30.0, 40.0, -70.0], [10.0, -20.0, 200.0]
TABLE, HANDLE = (matrix_from_zxz(*np.radians(angles)) for angles in (BASE_DEG, HANDLE_DEG))
POSES = workspace_pose(np.radians([0.0, 10.0, 15.0]), np.radians([0.0, 100.0, 200.0]),
                       np.radians([20.0, 60.0, 90.0]))


def mounting(base=BASE_DEG, handle=HANDLE_DEG):
    """Return the Mounting of parameters."""
    return mounting_from(complete(MOUNTING_SETTINGS, {
        'mounting.base_zxz_deg': base, 'mounting.handle_zxz_deg': handle}))


def test_there_is_none_by_default():
    assert mounting_from(complete(MOUNTING_SETTINGS, {})) is None


def test_the_orientation_is_that_of_the_handle_on_the_table():
    for pose in POSES:
        quaternion = tuple(quaternion_from_matrix(pose).tolist())
        found = mounting().mounted(quaternion)
        np.testing.assert_allclose(
            matrix_from_quaternion(found), TABLE @ pose @ HANDLE, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(mounting().unmounted(found), quaternion, rtol=0.0, atol=1e-14)


def test_each_side_alone():
    quaternion = tuple(quaternion_from_matrix(POSES[0]).tolist())
    for found, expected in (
            (mounting(handle=[0.0] * 3), TABLE @ POSES[0]),
            (mounting(base=[0.0] * 3), POSES[0] @ HANDLE)):
        np.testing.assert_allclose(
            matrix_from_quaternion(found.mounted(quaternion)), expected, rtol=0.0, atol=1e-14)


def test_the_covariance_is_that_of_the_error_in_the_tables_frame():
    rng = np.random.default_rng(13)
    spread = rng.normal(size=(3, 3)) * 1e-3
    # Rotation errors, on the left of R_base_platform, and what they are of R_table_handle.
    errors = rng.normal(size=(200, 3)) @ spread.T
    seen = []
    for error in errors:
        angle = np.linalg.norm(error)
        turned = matrix_from_quaternion([*np.sin(angle / 2.0) * error / angle,
                                         np.cos(angle / 2.0)]) @ POSES[1]
        apart = TABLE @ turned @ HANDLE @ (TABLE @ POSES[1] @ HANDLE).T
        seen.append([apart[2, 1] - apart[1, 2], apart[0, 2] - apart[2, 0],
                     apart[1, 0] - apart[0, 1]])
    expected = np.cov(np.array(seen).T / 2.0)
    found = np.reshape(mounting().covariance(tuple(np.cov(errors.T).ravel())), (3, 3))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-4 * np.abs(expected).max())


def test_the_angular_velocity_of_mounted_orientations_is_in_the_tables_frame():
    rate = np.array([0.3, -0.2, 0.5])
    plain, mounted = AngularVelocity(20_000_000), AngularVelocity(20_000_000)
    for stamp in range(0, 21_000_000, 1_000_000):
        angle = np.linalg.norm(rate) * stamp * 1e-9
        turn = [*np.sin(angle / 2.0) * rate / np.linalg.norm(rate), np.cos(angle / 2.0)]
        quaternion = tuple(quaternion_from_matrix(matrix_from_quaternion(turn) @ POSES[0]))
        plain.add(stamp, quaternion)
        mounted.add(stamp, mounting().mounted(quaternion))
    np.testing.assert_allclose(plain.value(), rate, atol=1e-4)
    np.testing.assert_allclose(mounted.value(), TABLE @ plain.value(), rtol=0.0, atol=1e-12)


def test_the_supervision_publishes_as_mounted():
    joints = inverse(POSES[0])
    angles = np.tile([*joints.theta1, joints.theta3a], (40, 1)) \
        + np.random.default_rng(1).normal(0.0, 5e-4, (40, 4))
    stamps = np.arange(40) * 1_000_000
    plain = supervise(stamps, angles)
    mounted = supervise(stamps, angles, mounting__base_zxz_deg=BASE_DEG,
                        mounting__handle_zxz_deg=HANDLE_DEG)
    seen = plain.published
    assert seen.sum() == 36 and (mounted.published == seen).all()
    np.testing.assert_allclose(
        matrix_from_quaternion(mounted.quaternion[seen]),
        TABLE @ matrix_from_quaternion(plain.quaternion[seen]) @ HANDLE, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(mounted.covariance[seen], TABLE @ plain.covariance[seen] @ TABLE.T,
                               rtol=0.0, atol=1e-20)
    # What is decided on is the mechanism's own.
    np.testing.assert_array_equal(mounted.protection_level, plain.protection_level)
    assert mounted.state == plain.state
    fit = estimate(joints.theta1, joints.theta3a, np.radians(0.04))
    np.testing.assert_allclose(mounting().covariance(tuple(fit.covariance.ravel())),
                               (TABLE @ fit.covariance @ TABLE.T).ravel(), rtol=0.0, atol=1e-20)


def test_no_rotation_changes_nothing():
    quaternion = (0.1, -0.5, 0.5, 0.7)
    assert Mounting().mounted(quaternion) == quaternion


@pytest.mark.parametrize(('given', 'expected'), [
    ({'mounting.base_zxz_deg': [0.0, 0.0]}, "'mounting.base_zxz_deg' .* a list of 3"),
    ({'mounting.handle_zxz_deg': [0.0, float('nan'), 0.0]}, "'mounting.handle_zxz_deg' .*nan"),
    ({'mounting.base_zxz_deg': [0.0, 400.0, 0.0]}, "'mounting.base_zxz_deg' .* from -360 to 360"),
])
def test_what_is_no_mounting_is_refused(given, expected):
    with pytest.raises(SettingError, match=expected):
        complete(MOUNTING_SETTINGS, given)


@pytest.mark.parametrize(('given', 'expected'), [
    ({}, None),
    ({'mounting.table_frame_id': 'spm_base'}, "'mounting.table_frame_id' is 'spm_base'; expected "
     'another frame than that of frame_id'),
    ({'mounting.handle_frame_id': 'spm_platform'}, 'than that of mounting.platform_frame_id'),
])
def test_frames_have_names_of_their_own(given, expected):
    values = complete(INTERFACE_SETTINGS, given)
    if expected is None:
        check_frames(values)
        return
    with pytest.raises(SettingError, match=expected):
        check_frames(values)
