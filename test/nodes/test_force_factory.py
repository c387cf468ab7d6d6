# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback as the parameters of fkm describe it, and the frames of its torques."""

import numpy as np
import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.force import ForceLimits, ForceSample, Wrench
from spm_haptic_master.force.statics import rotated, unrotated
from spm_haptic_master.kinematics import (
    inverse,
    matrix_from_zxz,
    quaternion_from_matrix,
    workspace_pose,
)
from spm_haptic_master.nodes.factories import limits_from, make_motors
from spm_haptic_master.nodes.force_inputs import WrenchFrames
from spm_haptic_master.parameters.nodes import NODE_SETTINGS
from spm_haptic_master.parameters.setting import complete

DRIVES = {'force.without_drives': False, 'drives.interface': 'virtual',
          'drives.channel': 'bus_of_the_drives', 'drives.rated_torque': [0.5]}
BASE_DEG, HANDLE_DEG = [90.0, 20.0, -30.0], [10.0, -40.0, 70.0]
TORQUE = (0.1, -0.2, 0.3)
MOUNTED = {'mounting.base_zxz_deg': BASE_DEG, 'mounting.handle_zxz_deg': HANDLE_DEG}


def values(**given):
    return complete(NODE_SETTINGS['fkm'], given)


def test_the_defaults_are_those_of_the_limits():
    assert limits_from(values()) == ForceLimits()
    assert values()['force.enabled'] is False


@pytest.mark.parametrize(('given', 'words'), [
    ({'force.sigma_full': 0.05}, r'force.sigma_full.*0.05.*above force.sigma_off \(0.05\)'),
    ({'force.small_torque': 0.4}, r'force.small_torque.*0.4.*at most force.torque_limit \(0.3'),
    ({'rate': 200.0}, r"'rate' is 200.*at least 250 Hz with force.enabled"),
    ({'force.without_drives': False}, 'force.without_drives.*the bus of the drives in'),
    ({**DRIVES, 'force.without_drives': True}, 'force.without_drives.*True.*not both'),
    ({**DRIVES, 'drives.node_id': [11, 12]}, r'drives.node_id.*\[11, 12\].*3 drives \(force'),
    ({**DRIVES, 'drives.torque_limit': 0.4}, r'drives.torque_limit.*0.4.*at least force.motor'),
])
def test_settings_that_contradict_each_other_are_refused(given, words):
    with pytest.raises(SettingError, match=words):
        make_motors(values(**{'force.without_drives': True, **given}))


@pytest.mark.parametrize('motors', [3, 4])
def test_the_motors_of_a_described_device(motors):
    given = {'force.motors': motors, 'force.gravity_handle': [0.0, 0.0, 0.004]}
    controller, drives = make_motors(values(**given, **{'force.without_drives': True}))
    assert drives is None and controller.acknowledge() is False
    _, drives = make_motors(values(**given, **DRIVES, **{
        'drives.node_id': list(range(11, 11 + motors))}))
    assert drives.motors == motors


@pytest.mark.parametrize('weight', [(0.0, 0.0, 0.0), (0.0, 0.0, 0.004)])
def test_the_weight_of_the_settings_is_held(weight):
    controller, _ = make_motors(values(**{
        'force.gravity_handle': weight, 'force.without_drives': True}))
    R = workspace_pose(0.1, 0.4, 0.3)
    joints, quaternion, still = inverse(R), tuple(quaternion_from_matrix(R).tolist()), (0.0,) * 3
    angles = (*joints.theta1.tolist(), float(joints.theta3a))
    for stamp in range(1, 800_000_000, 1_000_000):
        output = controller.take(ForceSample(
            stamp, angles, quaternion, still, wrench=Wrench(stamp, still)))
    assert output.state.text == 'engaged'
    assert any(output.motor_torque) is any(weight)


def frames(given, reference):
    return WrenchFrames(values(**given), reference)


def test_a_mounted_device_takes_torques_in_all_its_frames():
    found = frames(MOUNTED, 'spm_table')
    table_base = matrix_from_zxz(*np.radians(BASE_DEG))
    platform_handle = matrix_from_zxz(*np.radians(HANDLE_DEG))
    expected = {'spm_base': (False, np.eye(3)), 'spm_table': (False, table_base.T),
                '': (False, table_base.T), 'spm_platform': (True, np.eye(3)),
                'spm_handle': (True, platform_handle)}
    for name, (in_handle, matrix) in expected.items():
        frame = found.by_name[name]
        assert frame.in_handle is in_handle
        torque = rotated(frame.rotation, TORQUE)
        np.testing.assert_allclose(torque, matrix @ TORQUE, atol=1e-12)
        np.testing.assert_allclose(unrotated(frame.rotation, torque), TORQUE, atol=1e-12)
    assert (found.spatial.name, found.body.name) == ('spm_table', 'spm_handle')


def test_the_same_torque_on_the_handle_in_two_frames():
    """By way of R_table_handle, as `orientation` has it, and by way of R_base_platform."""
    found = frames(MOUNTED, 'spm_table')
    base_platform = matrix_from_zxz(2.0, 1.0, 0.5)
    table_handle = matrix_from_zxz(*np.radians(BASE_DEG)) @ base_platform @ matrix_from_zxz(
        *np.radians(HANDLE_DEG))
    in_base = rotated(found.spatial.rotation, tuple(table_handle @ TORQUE))
    in_platform = rotated(found.body.rotation, TORQUE)
    np.testing.assert_allclose(in_base, base_platform @ in_platform, atol=1e-12)


@pytest.mark.parametrize('name', ['', 'spm_base', 'spm_handle', 'spm_platform'])
def test_a_device_without_mounting_has_two_frames(name):
    found = frames({}, 'spm_base')
    frame = found.by_name[name]
    assert rotated(frame.rotation, TORQUE) == TORQUE == unrotated(frame.rotation, TORQUE)
    assert frame.in_handle is (name in ('spm_handle', 'spm_platform'))
    assert found.body.name == 'spm_platform'


def test_another_frame_is_none_of_the_device():
    assert set(frames({}, 'spm_base').by_name) == {'', 'spm_base', 'spm_handle', 'spm_platform'}
