# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated device is moved and fails on request, and its truth is known."""

from math import radians

from fkm_rig import matrix
from in_process import hosted
import numpy as np
from rclpy.task import Future
from spm_haptic_master.kinematics import Geometry, inverse, workspace_pose
from spm_haptic_master.nodes.encoder_driver import EncoderDriver
from spm_haptic_master.ros import node_log
from spm_haptic_master.simulation.rig import read_rig
from std_msgs.msg import Float64MultiArray, String

THERE = workspace_pose(radians(10.0), radians(40.0), radians(5.0))


def run(host, script, count):
    """Publish samples, and do what the script has for the number of each; return their angles."""
    found = []

    def listen(_, angles):
        found.append(angles)
        script.get(len(found), lambda: None)()
        if len(found) == count:
            host.node._stop.set()

    host.node.listener = listen
    host.node._run()
    return np.array(found)


def off(rotation, pose):
    """Return the angle between two poses, deg."""
    return np.degrees(np.arccos(np.clip(0.5 * (np.trace(rotation @ pose.T) - 1.0), -1.0, 1.0)))


def test_the_pose_follows_and_faults_come_and_go_beside_the_truth(monkeypatch, tmp_path):
    logged = []
    monkeypatch.setattr(node_log, 'warning', lambda _, text: logged.append(text))
    with hosted(lambda given: EncoderDriver(given, Future()), 'source:=sim', 'rate:=200.0',
                'sim.trajectory:=fixed', 'sim.rig_seed:=5', 'sim.noise_deg:=0.04') as host:
        def steer(*pose):
            return lambda: host.give('simulation/steer', Float64MultiArray(data=pose))

        def fail(text):
            return lambda: host.give('simulation/fault', String(data=text))

        angles = run(host, {
            100: steer(radians(10.0), radians(40.0), radians(5.0)),
            # What cannot be done is said in one line, and changes nothing.
            600: steer(1.0, 0.0, 0.0), 601: steer(1.0), 602: fail('melt:joint_1a'),
            800: fail('offset:joint_1b=5, offset:joint_3a=-3'), 1000: fail(''),
            1200: steer()}, 1800)
        truth = np.array([matrix(each.quaternion) for each in host.sent[
            'ground_truth/orientation']])
        assert len(truth) == len(angles) == 1800
        assert off(truth[99], THERE) > 10.0
        assert off(truth[599], THERE) < 0.5 and off(truth[1199], THERE) < 0.5
        # Back to its own pose, far from there.
        assert off(truth[-1], truth[0]) < 0.5
        assert [text.partition(': ')[0] for text in logged] == [
            'simulation/steer', 'simulation/steer', 'simulation/fault']
        assert '1 numbers; expected' in logged[1] and "'melt:joint_1a'; expected" in logged[2]
        assert [each.data for each in host.sent['simulation/faults']] == [
            '', 'offset:joint_1b=5, offset:joint_3a=-3', '']
        # Truth and rig give the readings, but for noise and faults.
        path = tmp_path / 'rig.json'
        path.write_text(host.sent['ground_truth/rig'][0].data)
        rig = read_rig(path, Geometry(), 0.0)
    joints = inverse(truth, rig.geometry)
    expected = np.array([
        [sensor.with_harmonics(angle) for sensor, angle in zip(rig.sensors, row, strict=True)]
        for row in np.column_stack([joints.theta1, joints.theta3a])])
    error = np.degrees(angles - expected)
    for begin, end, mean in ((0, 790, 0.0), (810, 990, (0.0, 5.0, 0.0, -3.0)), (1010, 1800, 0.0)):
        np.testing.assert_allclose(error[begin:end].mean(0), mean, atol=0.02)
        np.testing.assert_allclose(error[begin:end].std(0), 0.0405, rtol=0.3)
