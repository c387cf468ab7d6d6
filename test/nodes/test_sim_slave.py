# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated slave follows `servo_cp` with a lag, and nothing else."""

from fkm_rig import matrix
from geometry_msgs.msg import PoseStamped
from harness import stamp
from in_process import hosted
from mechanism import zxz
import numpy as np
import pytest
from spm_haptic_master.kinematics import quaternion_from_matrix
from spm_haptic_master.nodes.sim_slave import LONGEST_STEP, SimSlave


def command(quaternion):
    message = PoseStamped()
    q = message.pose.orientation
    q.x, q.y, q.z, q.w = (float(each) for each in quaternion)
    return message


def test_it_follows_any_rotation_and_no_other_command():
    there = zxz(*np.radians([60.0, 40.0, 50.0]))
    with hosted(SimSlave, 'slave.pose_zxz_deg:=[30.0, 40.0, 50.0]', 'slave.rate:=200.0',
                'slave.time_constant:=0.1', 'slave.frame_id:=wrist') as host:
        def away():
            """Return the angle from the last pose to the command, rad."""
            turn = matrix(host.last('slave/measured_cp').pose.orientation).T @ there
            return np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))

        host.run(0.1)
        assert away() == pytest.approx(np.radians(30.0))
        for wrong in ((0.0, 0.0, 0.0, 0.0), (float('nan'), 0.0, 0.0, 1.0)):
            host.give('servo_cp', command(wrong))
        host.give('servo_cp', command(quaternion_from_matrix(there)))
        host.run(0.1)
        assert away() == pytest.approx(np.radians(30.0) * np.exp(-1.0), rel=0.05)
        # A process that was stopped does not jump.
        before = away()
        host.pause(5.0)
        host.run(0.005)
        assert away() > before * np.exp(-(LONGEST_STEP + 0.01) / 0.1)
        host.run(2.0)
        assert away() < 1e-3
        poses = host.sent['slave/measured_cp']
        assert len({stamp(each) for each in poses}) == len(poses) > 400
        assert {each.header.frame_id for each in poses} == {'wrist'}
        figures = host.figures('tracking')
        assert figures['commands'] == '1' and float(figures['tracking error (deg)']) < 0.01
