# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated device is moved and fails on request, by topics that no other source has."""

from math import radians

from geometry_msgs.msg import QuaternionStamped
from harness import SIM
import numpy as np
import pytest
from spm_haptic_master.kinematics import matrix_from_quaternion, workspace_pose
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, FAULTS_TOPIC, STEER_TOPIC
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import Float64MultiArray, String

pytestmark = pytest.mark.process
PATIENCE = 60.0
RATE = {'rate': 200.0, 'max_age': 1.0}


def off(message, pose):
    """Return the angle from an orientation to a pose, rad."""
    q = message.quaternion
    rotation = matrix_from_quaternion((q.x, q.y, q.z, q.w))
    return np.arccos(np.clip(0.5 * (np.trace(rotation @ pose.T) - 1.0), -1.0, 1.0))


def test_the_pose_follows_and_faults_come_and_go(start, observer):
    orientations = observer.collect(QuaternionStamped, 'orientation')
    states = observer.collect(String, 'state', STATE)
    faults = observer.collect(String, FAULTS_TOPIC, STATE)
    steer = observer.node.create_publisher(Float64MultiArray, STEER_TOPIC, 1)
    fail = observer.node.create_publisher(String, FAULT_TOPIC, 1)
    program = start('master', parameters={**SIM, **RATE, 'sim.trajectory': 'fixed'})
    assert observer.spin_until(
        lambda: orientations and faults and steer.get_subscription_count()
        and fail.get_subscription_count(), PATIENCE)
    assert faults[-1][1].data == ''
    there = workspace_pose(radians(10.0), radians(40.0), radians(5.0))
    assert off(orientations[-1][1], there) > radians(10.0)
    steer.publish(Float64MultiArray(data=[radians(10.0), radians(40.0), radians(5.0)]))
    assert observer.spin_until(
        lambda: off(orientations[-1][1], there) < radians(0.5), PATIENCE)
    assert states[-1][1].data == 'healthy'
    # What cannot be done is said in one line, and changes nothing.
    for out, message, words in (
            (steer, Float64MultiArray(data=[1.0, 0.0, 0.0]), 'simulation/steer: '),
            (steer, Float64MultiArray(data=[1.0]), 'simulation/steer: 1 numbers; expected'),
            (fail, String(data='melt:joint_1a'), "fault 'melt:joint_1a'; expected")):
        out.publish(message)
        assert observer.spin_until(lambda: words in program.stderr, PATIENCE)  # noqa: B023
    assert program.stderr.count('simulation/') == 3

    fail.publish(String(data='offset:joint_1b=5'))
    assert observer.spin_until(lambda: states[-1][1].data.startswith('silent'), PATIENCE)
    assert faults[-1][1].data == 'offset:joint_1b=5'
    fail.publish(String())
    assert observer.spin_until(lambda: states[-1][1].data == 'healthy', PATIENCE)
    fail.publish(String(data='dropout:joint_3a'))
    assert observer.spin_until(
        lambda: states[-1][1].data == 'silent: no joint samples', PATIENCE)
    fail.publish(String())
    assert observer.spin_until(lambda: states[-1][1].data == 'healthy', PATIENCE)
    # Back to its own pose, far from there.
    steer.publish(Float64MultiArray())
    assert observer.spin_until(
        lambda: off(orientations[-1][1], there) > radians(10.0), PATIENCE)
