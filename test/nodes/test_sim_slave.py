# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated slave: a wrist, or a laparoscopic arm that pivots about its trocar."""

from geometry_msgs.msg import PoseStamped
from in_process import hosted
from mechanism import turn, zxz
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import matrix_from_quaternion, quaternion_from_matrix
from spm_haptic_master.nodes.sim_slave import SimSlave

TROCAR = np.array([0.1, 0.0, 0.25])
LAPAROSCOPIC = (
    'slave.trocar:=[0.1, 0.0, 0.25]',
    'slave.depth:=0.1',
    'slave.pose_zxz_deg:=[0.0, 180.0, 0.0]',
)


def command(host, rotation, position):
    message = PoseStamped()
    q = message.pose.orientation
    p = message.pose.position
    q.x, q.y, q.z, q.w = map(float, quaternion_from_matrix(rotation))
    p.x, p.y, p.z = map(float, position)
    host.give('servo_cp', message)
    host.run(0.5)


def pose(host):
    found = host.last('slave/measured_cp').pose
    q = found.orientation
    p = found.position
    return matrix_from_quaternion([q.x, q.y, q.z, q.w]), np.array([p.x, p.y, p.z])


def test_a_laparoscopic_slave_turns_about_its_trocar_and_slides():
    with hosted(SimSlave, *LAPAROSCOPIC) as host:
        host.run(0.1)
        point = host.last('slave/trocar')
        assert point.header.frame_id == 'slave_base'
        np.testing.assert_allclose((point.point.x, point.point.y, point.point.z), TROCAR)
        rotation, position = pose(host)
        np.testing.assert_allclose(position, TROCAR - [0.0, 0.0, 0.1], atol=1e-12)
        wanted = turn([0.2, 0.1, 0.0]) @ rotation
        command(host, wanted, TROCAR + 0.13 * wanted[:, 2])
        rotation, position = pose(host)
        np.testing.assert_allclose(rotation, wanted, atol=1e-6)
        np.testing.assert_allclose(position, TROCAR + 0.13 * wanted[:, 2], atol=1e-6)


def test_a_command_whose_shaft_passes_the_trocar_is_refused():
    """As that of a tip which keeps its position while the orientation turns."""
    with hosted(SimSlave, *LAPAROSCOPIC) as host:
        host.run(0.1)
        before = pose(host)
        command(host, turn([0.2, 0.0, 0.0]) @ before[0], before[1])
        host.run(1.0)
        np.testing.assert_allclose(pose(host)[0], before[0], atol=1e-12)
        np.testing.assert_allclose(pose(host)[1], before[1], atol=1e-12)
        assert host.entry('tracking').message == (
            'has refused commands whose shaft passes the trocar'
        )
        assert host.figures('tracking')['commands refused'] == '1'


def test_its_jaw_follows():
    with hosted(SimSlave, *LAPAROSCOPIC) as host:
        host.run(0.1)
        assert host.last('slave/jaw/measured_js').position[0] == 0.0
        host.give('slave/jaw/servo_jp', JointState(name=['jaw'], position=[0.4]))
        host.run(0.5)
        assert host.last('slave/jaw/measured_js').position[0] == pytest.approx(0.4, abs=1e-6)


def test_a_wrist_turns_and_its_tip_stays():
    with hosted(SimSlave) as host:
        command(host, zxz(0.3, 0.2, 0.1), (1.0, 2.0, 3.0))
        np.testing.assert_allclose(pose(host)[0], zxz(0.3, 0.2, 0.1), atol=1e-6)
        np.testing.assert_allclose(pose(host)[1], np.zeros(3))
