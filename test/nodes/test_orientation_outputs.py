# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What fkm publishes beside the orientation, and the frames of a mounted device."""

import sys
import time
from types import SimpleNamespace

from fkm_rig import angles, fkm_rig, matrix, PERIOD, POSE
from geometry_msgs.msg import PoseStamped
from harness import stamp
from in_process import ros
import numpy as np
import pytest
from rclpy.experimental.events_executor import EventsExecutor
from sensor_msgs.msg import JointState, Joy
from spm_haptic_master.kinematics import matrix_from_zxz, workspace_pose
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.parameters.resolver import Parameters

CRTK = 'measured_cp', 'setpoint_cp', 'measured_cv', 'crtk/measured_js', 'gripper/measured_js'
BASE_DEG = [30.0, 40.0, -70.0]
HANDLE_DEG = [0.0, 0.0, 45.0]
TABLE, HANDLE = (matrix_from_zxz(*np.radians(turn)) for turn in (BASE_DEG, HANDLE_DEG))
MOUNTED = (
    f'mounting.base_zxz_deg:={BASE_DEG}',
    f'mounting.handle_zxz_deg:={HANDLE_DEG}',
    'mounting.table_frame_id:=operating_table',
)


def turning(count, speed=0.5, sensors=4):
    """Return samples of a turn about the platform's axis, from phi = 20 deg on, rad/s."""
    return [
        angles(workspace_pose(0.0, 0.0, np.radians(20.0) + speed * PERIOD * number), sensors)
        for number in range(count)
    ]


def angular(message):
    velocity = message.twist.angular
    return np.array([velocity.x, velocity.y, velocity.z])


def test_k3_no_gripper_is_published_where_none_is_configured():
    """A slave whose jaw follows a constant closes or opens by itself at engaging."""
    for settings, expected in (((), []), (('gripper.position_deg:=20.0',), [np.radians(20.0)])):
        with fkm_rig('crtk_rate:=20.0', *settings) as rig:
            rig.qualify()
            rig.send_many(20, angles())
            found = [message.position[0] for message in rig.sent['gripper/measured_js']]
            assert found[-1:] == pytest.approx(expected)


GRIPPER = ('gripper.axis:=1', 'gripper.range_deg:=[0.0, 60.0]')


def test_the_gripper_is_published_once_its_axis_has_a_usable_value():
    """Beyond the ends of its axis it stays at the end of its range."""
    with fkm_rig('crtk_rate:=20.0', *GRIPPER) as rig:
        samples = turning(400)
        rig.send_many(0, *samples[:100])
        for joy in (Joy(), Joy(axes=[0.0, float('nan')])):
            rig.host.give('gripper/joy', joy)
        rig.send_many(0, *samples[100:150])
        assert rig.sent['measured_cp']
        assert rig.sent['gripper/measured_js'] == []
        begin = 150
        for value, degrees in ((0.5, 45.0), (-5.0, 0.0), (5.0, 60.0)):
            rig.host.give('gripper/joy', Joy(axes=[0.0, value]))
            rig.send_many(0, *samples[begin : begin + 46])
            begin += 46
            found = rig.host.last('gripper/measured_js').position[0]
            assert found == pytest.approx(np.radians(degrees))


def test_poses_have_a_rate_of_their_own_and_equal_stamps():
    with fkm_rig('crtk_rate:=20.0', *GRIPPER) as rig:
        samples = turning(354)
        rig.send_many(0, *samples[:150])
        rig.host.give('gripper/joy', Joy(axes=[0.0, 0.5]))
        rig.send_many(0, *samples[150:154])
        rig.sent.clear()
        rig.send_many(0, *samples[154:])
        stamps = [stamp(each) for each in rig.sent['measured_cp']]
        # Every tenth of 200 Hz.
        assert set(np.diff(stamps)) == {50_000_000}
        for topic in CRTK:
            assert [stamp(each) for each in rig.sent[topic]] == stamps, topic
        oriented = {stamp(each): each for each in rig.sent['orientation']}
        for pose in rig.sent['measured_cp']:
            assert pose.pose.orientation == oriented[stamp(pose)].quaternion
            assert pose.header.frame_id == 'spm_base'
        for twist in rig.sent['measured_cv']:
            speed = np.linalg.norm(angular(twist))
            assert speed == pytest.approx(0.5, rel=1e-3)


def test_a_joint_without_a_reading_is_nan_while_the_orientation_goes_on():
    with fkm_rig('sensors:=6') as rig:
        samples = turning(200, sensors=6)
        rig.send_many(0, *samples[:100])
        assert rig.state == 'healthy'
        rows = [[*row[:4], float('nan'), row[5]] for row in samples[100:]]
        assert len(rig.send_many(0, *rows)) > 95
        assert rig.state == 'degraded: joint_3b missing'
        assert np.isnan(rig.host.last('crtk/measured_js').position).tolist() == [
            False,
            False,
            False,
            False,
            True,
            False,
        ]


def test_a_subscriber_that_comes_late_gets_no_velocity_of_long_ago():
    with fkm_rig('crtk_rate:=0.0') as rig:
        rig.send_many(0, *turning(50))
        assert rig.sent['measured_cv']
        rig.host.subscribed = lambda topic: topic not in ('measured_cv', 'protection_level')
        rig.host.run(0.02)
        rig.sent.clear()
        rig.send_many(0, *turning(50))
        assert rig.sent['measured_cp']
        assert not rig.sent['measured_cv']
        assert not rig.sent['protection_level']
        rig.host.run(1.0)
        rig.host.subscribed = lambda topic: True
        rig.host.run(0.02)
        rig.send_many(0, *turning(50, speed=0.1))
        assert rig.sent['measured_cv']
        for twist in rig.sent['measured_cv']:
            np.testing.assert_allclose(np.linalg.norm(angular(twist)), 0.1, rtol=1e-2)


def test_an_output_begins_when_its_subscriber_comes_not_at_the_next_poll(observer):
    arrived = {}
    with ros():
        node = Fkm(Parameters())
        executor = EventsExecutor()
        for timer in node.timers:
            timer.cancel()
        executor.add_node(node)
        arrived = observer.collect(PoseStamped, 'measured_cp')

        def sampled():
            executor.spin_once(timeout_sec=0.001)
            node.take(time.time_ns(), tuple(angles()))
            return arrived

        assert observer.spin_until(sampled, 60.0)
        executor.shutdown()
        node.destroy_node()


@pytest.fixture(scope='module')
def plain_and_mounted():
    """Return what is published of a motion without a mounting, and with one."""
    noise = np.radians(0.02) * np.random.default_rng(3).normal(size=(150, 4))
    samples = np.array(turning(150)) + noise
    found = []
    for settings in ((), MOUNTED):
        with fkm_rig('crtk_rate:=0.0', *settings) as rig:
            rig.send_many(0, *samples.tolist())
            found.append(rig.sent)
    return found


def pairs(plain_and_mounted, topic):
    """Return the messages of a topic, each without the mounting and with it."""
    plain, mounted = plain_and_mounted
    assert plain[topic]
    return zip(plain[topic], mounted[topic], strict=True)


@pytest.mark.parametrize(
    ('topic', 'of'),
    [
        ('orientation', lambda message: matrix(message.quaternion)),
        ('measured_cp', lambda message: matrix(message.pose.orientation)),
    ],
    ids=['orientation', 'measured_cp'],
)
def test_orientations_are_those_of_the_handle_on_the_table(plain_and_mounted, topic, of):
    for before, after in pairs(plain_and_mounted, topic):
        np.testing.assert_allclose(of(after), TABLE @ of(before) @ HANDLE, atol=1e-12)
        assert before.header.frame_id == 'spm_base'
        assert after.header.frame_id == 'operating_table'


def test_the_covariance_is_that_on_the_table(plain_and_mounted):
    for before, after in pairs(plain_and_mounted, 'pose_with_covariance'):
        inner = np.reshape(before.pose.covariance, (6, 6))[3:, 3:]
        covariance = np.reshape(after.pose.covariance, (6, 6))
        outer = covariance[3:, 3:]
        assert not covariance[:3].any()
        assert not covariance[:, :3].any()
        assert np.diag(outer).min() > 0.0
        np.testing.assert_allclose(outer, TABLE @ inner @ TABLE.T, atol=1e-15)


def test_the_angular_velocity_is_that_on_the_table(plain_and_mounted):
    for before, after in pairs(plain_and_mounted, 'measured_cv'):
        np.testing.assert_allclose(angular(after), TABLE @ angular(before), atol=1e-9)


def test_the_covariance_is_the_scatter_that_the_orientations_have():
    rng = np.random.default_rng(5)
    noise = np.radians(0.04)
    rows = np.array(angles()) + noise * rng.normal(size=(600, 4))
    with fkm_rig('sigma_deg:=[0.04, 0.04, 0.04, 0.04]') as rig:
        answers = rig.send_many(0, *rows.tolist())
        covariance = np.reshape(rig.host.last('pose_with_covariance').pose.covariance, (6, 6))
    turns = [matrix(each.quaternion) @ POSE.T for each in answers]
    vectors = 0.5 * np.array(
        [[t[2, 1] - t[1, 2], t[0, 2] - t[2, 0], t[1, 0] - t[0, 1]] for t in turns]
    )
    np.testing.assert_allclose(
        vectors.std(axis=0),
        np.sqrt(np.diag(covariance)[3:]),
        rtol=0.15,
    )


@pytest.mark.parametrize('is_installed', [True, False])
@pytest.mark.parametrize(
    ('settings', 'words'),
    [
        (MOUNTED, 'spm_base on operating_table, spm_handle on spm_platform'),
        (MOUNTED[1:], 'spm_handle on spm_platform'),
        ((), None),
    ],
)
def test_the_frames_are_on_diagnostics_and_on_tf_where_it_is_installed(
    monkeypatch, is_installed, settings, words
):
    monkeypatch.setitem(sys.modules, 'tf2_msgs', SimpleNamespace())
    monkeypatch.setitem(
        sys.modules,
        'tf2_msgs.msg',
        SimpleNamespace(TFMessage=SimpleNamespace) if is_installed else None,
    )
    with fkm_rig(*settings) as rig:
        rig.host.run(1.0)
        found = rig.host.figures('orientation').get('mounting')
        messages = rig.sent['/tf_static']
        if words is None or not is_installed:
            assert found == (words and f'{words} (not on /tf_static: no tf2_msgs)')
            assert not messages
            return
        assert found == words
        (message,) = messages
        transforms = {each.child_frame_id: each for each in message.transforms}
        assert words == ', '.join(
            f'{child} on {each.header.frame_id}' for child, each in transforms.items()
        )
        for child, expected in (('spm_base', TABLE), ('spm_handle', HANDLE)):
            if child in transforms:
                np.testing.assert_allclose(
                    matrix(transforms[child].transform.rotation), expected, atol=1e-14
                )


def test_the_position_is_the_insertion_along_the_handles_axis_at_its_time():
    """0 without an insertion sensor, as a pose about the centre; no pose where it was lost."""
    with fkm_rig('crtk_rate:=0.0') as rig:
        rig.qualify()
        still = rig.host.last('measured_cp').pose.position
        assert (still.x, still.y, still.z) == (0.0, 0.0, 0.0)

        def slide(metres):
            message = JointState(name=['insertion'], position=[metres])
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(
                rig.host.time_ns(), 10**9
            )
            rig.host.give('insertion/measured_js', message)

        for metres in (0.05, 0.12):
            slide(metres)
            rig.send(angles())
            pose = rig.host.last('measured_cp').pose
            found = np.array([pose.position.x, pose.position.y, pose.position.z])
            np.testing.assert_allclose(found, metres * matrix(pose.orientation)[:, 2], atol=1e-9)
        for topic in ('measured_cp', 'setpoint_cp', 'orientation'):
            rig.sent[topic].clear()
        rig.send_many(20, angles())
        assert len(rig.sent['orientation']) == 20
        # Three periods and 10 ms after its last reading.
        assert 4 <= len(rig.sent['measured_cp']) == len(rig.sent['setpoint_cp']) <= 6
        slide(0.1)
        rig.send(angles())
        assert rig.host.last('measured_cp').pose.position != pose.position
