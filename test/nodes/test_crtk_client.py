# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A CRTK client of the running master: it enables, homes, follows, and has to let go.

The client is that of crtk_python_client 1.4.0: the same topics, waits and conditions. The messages
are those of crtk_msgs, or of test/crtk_package.py where that is not installed.
"""

import os
import sys
import time

import crtk_package
from geometry_msgs.msg import PoseStamped, TwistStamped
from harness import SIM, stamp
import numpy as np
import pytest
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import inverse, matrix_from_zxz
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

pytestmark = pytest.mark.process

# Time that a busy machine may need (s).
PATIENCE = 60.0
# A pause of a busy machine is no silence.
PATIENT = {'sample_timeout': 2.0, 'max_age': 2.0}
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OUTPUTS = {'measured_cp': PoseStamped, 'setpoint_cp': PoseStamped, 'measured_cv': TwistStamped,
           'crtk/measured_js': JointState, 'gripper/measured_js': JointState}


@pytest.fixture(scope='module')
def crtk_path(tmp_path_factory):
    """Give the folder for PYTHONPATH from which crtk_msgs comes, and have it here, too."""
    if crtk_package.is_installed():
        yield ''
        return
    if not crtk_package.can_be_built():
        pytest.skip('neither crtk_msgs nor what builds messages of its fields is installed')
    folder = str(crtk_package.build(tmp_path_factory.mktemp('crtk')))
    sys.path.insert(0, folder)
    yield folder
    sys.path.remove(folder)
    for name in [name for name in sys.modules if name.split('.')[0] == crtk_package.PACKAGE]:
        del sys.modules[name]


class Client:
    """The operating state as crtk_python_client 1.4.0 has it, and a second one's commands."""

    def __init__(self, observer):
        from crtk_msgs.msg import OperatingState, StringStamped

        self._observer, self._command = observer, StringStamped
        self._state = OperatingState()
        observer.node.create_subscription(OperatingState, 'operating_state', self._take, 10)
        self._out = observer.node.create_publisher(StringStamped, 'state_command', LATCHED)

    def _take(self, message):
        if stamp(message) > stamp(self._state):
            self._state = message

    def send(self, command):
        self._out.publish(self._command(string=command))

    def is_homed(self):
        return self._state.is_homed

    def waits_for(self, state):
        return self._observer.spin_until(lambda: self._state.state == state, PATIENCE)

    def enable(self):
        self.send('enable')
        return self.waits_for('ENABLED')

    def home(self):
        self.send('home')
        return self.is_homed() or self._observer.spin_until(self.is_homed, PATIENCE)


@pytest.fixture
def client(crtk_path, observer, start):
    """Give a client of a running and healthy master whose state it has heard."""
    states = observer.collect(String, 'state', STATE)
    start('master', parameters={**SIM, **PATIENT, 'rate': 200},
          PYTHONPATH=os.pathsep.join(filter(None, [crtk_path, os.environ.get('PYTHONPATH')])))
    client = Client(observer)
    assert client.waits_for('DISABLED')
    assert observer.spin_until(lambda: states and states[-1][1].data == 'healthy', PATIENCE)
    return client


def test_it_lets_go_by_is_homed_alone_and_comes_back(client, observer):
    # Home before enable is no hindrance.
    client.send('home')
    observer.spin(0.5)
    assert not client.is_homed()
    for command in ('disable', 'pause', 'unhome'):
        assert client.enable() and client.home() and client.is_homed(), command
        client.send(command)
        # All that dvrk_teleoperation.py 2.4.0 looks at before each of its commands.
        assert observer.spin_until(lambda: not client.is_homed(), PATIENCE), command
        observer.spin(0.5)
        assert not client.is_homed(), command
    assert client.enable() and client.home() and client.is_homed()


@pytest.fixture
def fkm():
    """Give the node in this process; its timers never run."""
    rclpy.init()
    node = Fkm(Parameters((), (), ()))
    for timer in node.timers:
        timer.cancel()
    executor = EventsExecutor()
    executor.add_node(node)
    yield node, executor
    node.destroy_node()
    executor.shutdown()
    rclpy.shutdown()


def test_an_output_begins_when_its_subscriber_comes_not_at_the_next_poll(fkm, observer):
    node, executor = fkm
    joints = inverse(matrix_from_zxz(*np.radians([130.0, 50.0, 30.0])))
    angles = (*map(float, joints.theta1), float(joints.theta3a))
    arrived = {topic: observer.collect(kind, topic) for topic, kind in OUTPUTS.items()}

    def sampled():
        executor.spin_once(timeout_sec=0.001)
        node.take(time.time_ns(), angles)
        return all(arrived.values())

    assert observer.spin_until(sampled, PATIENCE), {
        topic: len(messages) for topic, messages in arrived.items()}
