# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The protection level of fkm, what it declares unchecked, and the acknowledgement of a fault."""

import time

from diagnostic_msgs.msg import DiagnosticArray
from harness import Observer, start_program, status
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import inverse, workspace_pose
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger

pytestmark = pytest.mark.process

# Self-rotation far from the singularity (deg).
CLEAR = 20.0


def angles(phi):
    joints = inverse(workspace_pose(0.0, 0.0, np.radians(phi)))
    return np.array([*map(float, joints.theta1), float(joints.theta3a)])


class Rig:
    """An fkm, with this test in the place of the encoder driver."""

    def __init__(self):
        self.program = start_program('fkm', parameters={'recovery': 0.2, 'max_age': 1.0})
        self.observer = Observer()
        self.levels = self.observer.collect(Float64MultiArray, 'protection_level')
        self.states = self.observer.collect(String, 'state', STATE)
        self.health = self.observer.collect(DiagnosticArray, '/diagnostics')
        node = self.observer.node
        self.publisher = node.create_publisher(JointState, 'measured_js', 10)
        self.parameters = node.create_client(SetParameters, 'fkm/set_parameters')
        self.acknowledge = node.create_client(Trigger, 'fkm/acknowledge')
        assert self.observer.spin_until(
            lambda: self.publisher.get_subscription_count() > 0
            and self.acknowledge.service_is_ready() and self.parameters.service_is_ready(), 15.0)
        self.noise = np.random.default_rng(4)

    def send(self, position, seconds, until=lambda: False):
        """Send noisy samples at some 200 Hz."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            reading = position + np.radians(0.02) * self.noise.normal(size=4)
            message = JointState(name=list(JOINT_NAMES), position=reading.tolist())
            message.header.stamp = self.observer.node.get_clock().now().to_msg()
            self.publisher.publish(message)
            self.observer.spin(0.005)
        return until()

    def call(self, client, request):
        future = client.call_async(request)
        assert self.observer.spin_until(future.done, 10.0)
        return future.result()

    def entry(self):
        return status(self.health, 'fkm: orientation')

    def state(self):
        return self.states[-1][1].data if self.states else ''


@pytest.fixture(scope='module')
def rig():
    made = Rig()
    yield made
    made.observer.close()
    assert made.program.stop() == 0


def test_the_level_and_the_time_unchecked_come_with_each_orientation(rig):
    place = angles(CLEAR)
    assert rig.send(place, 20.0, lambda: len(rig.levels) > 100)
    _, message = rig.levels[-1]
    assert message.layout.dim[0].label.split(', ') == [
        'protection_level_deg', *(f'unchecked_{name}_s' for name in JOINT_NAMES),
        *(f'bound_{name}_deg' for name in JOINT_NAMES)]
    level, *more = message.data
    assert 0.2 < level < 1.0
    # A device that has not moved is not checked; what a fault may do is bounded.
    assert min(more[:4]) == float('inf')
    assert level == pytest.approx(max(more[4:]))
    # The alert limit is live: below the level of healthy sensors nothing goes out.
    request = SetParameters.Request(parameters=[
        Parameter('alert_limit_deg', value=0.1).to_parameter_msg()])
    assert rig.call(rig.parameters, request).results[0].successful
    reason = 'silent: protection level above the alert limit'
    assert rig.send(place, 20.0, lambda: rig.state() == reason)
    del rig.levels[:]
    rig.send(place, 0.2)
    assert not rig.levels
    request.parameters[0].value.double_value = 1.0
    rig.call(rig.parameters, request)
    assert rig.send(place, 20.0, lambda: rig.state() == 'healthy')
    assert 'no fault waits' in rig.call(rig.acknowledge, Trigger.Request()).message


def test_two_sensors_that_jump_wait_for_the_acknowledgement(rig):
    place = angles(CLEAR)
    assert rig.send(place, 20.0, lambda: len(rig.levels) > 50)
    wrong = place + np.radians([25.0, -20.0, 0.0, 0.0])
    assert rig.send(wrong, 20.0, lambda: rig.state().endswith('to be acknowledged'))
    # They stay: an interference of some milliseconds would clear by itself.
    rig.send(wrong, 0.5)
    # Right again, and consistent for longer than the recovery: not by itself.
    rig.send(place, 1.0)
    assert rig.state().endswith('to be acknowledged')
    assert rig.call(rig.acknowledge, Trigger.Request()).success
    assert rig.send(place, 20.0, lambda: rig.state() == 'healthy')
