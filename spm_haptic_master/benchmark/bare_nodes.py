# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bare rclpy nodes: they pass on the same messages as the pipeline and compute nothing."""

from __future__ import annotations

import threading
import time

from geometry_msgs.msg import QuaternionStamped
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.ros import runner
from spm_haptic_master.ros.diagnostic_status import OK, StatusPublisher
from spm_haptic_master.ros.parameters import ParameterNode, Parameters
from spm_haptic_master.ros.qos import SAMPLES

# Longest wait for a deadline (s): the thread polls its end after each.
WAIT_TIMEOUT = 0.05
# Time between two statuses (s).
HEALTH_PERIOD = 1.0
# Frame of the orientations.
FRAME = 'spm_base'
# Four "joint angles" that are a unit quaternion: the relay copies them.
POSITIONS = [0.5, 0.5, 0.5, 0.5]


class BareDriver(ParameterNode):
    """Publishes `measured_js` on a grid, and its counts on /diagnostics."""

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('bare_driver', parameters)
        self._sets = 0
        self._grid = DeadlineGrid(1.0 / float(str(self.given['rate'])))
        self._publisher = self.create_publisher(JointState, 'measured_js', SAMPLES)
        self._status = StatusPublisher(self, 'encoders', 'bare', logs=False)
        self.create_timer(HEALTH_PERIOD, self._report)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='driver')
        self._thread.start()

    def destroy_node(self) -> None:
        """Stop the thread and destroy the node."""
        self._stop.set()
        self._thread.join()
        super().destroy_node()

    def _run(self) -> None:
        message = JointState(name=list(JOINT_NAMES), position=POSITIONS)
        stamp = message.header.stamp
        while not self._stop.is_set():
            if not self._grid.wait(WAIT_TIMEOUT):
                continue
            stamp.sec, stamp.nanosec = divmod(time.time_ns(), 1_000_000_000)
            self._sets += 1
            self._publisher.publish(message)

    def _report(self) -> None:
        self._status.publish(OK, 'publishing', {
            'sets': self._sets, 'missed deadlines': self._grid.missed})


class BareRelay(ParameterNode):
    """Copies the four positions of each `measured_js` into an `orientation`."""

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('bare_relay', parameters)
        self._message = QuaternionStamped()
        self._message.header.frame_id = FRAME
        self._publisher = self.create_publisher(QuaternionStamped, 'orientation', SAMPLES)
        self.create_subscription(JointState, 'measured_js', self._relay, SAMPLES)

    def _relay(self, joints: JointState) -> None:
        message = self._message
        message.header.stamp = joints.header.stamp
        quaternion = message.quaternion
        quaternion.x, quaternion.y, quaternion.z, quaternion.w = joints.position
        self._publisher.publish(message)


class BareListener(ParameterNode):
    """Subscribes to `orientation`, as `diagnostics` does, and ignores it."""

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('bare_listener', parameters)
        self.create_subscription(QuaternionStamped, 'orientation', lambda _: None, SAMPLES)


# The nodes of each process, in the order of `master`.
NODES: dict[str, tuple[type[ParameterNode], ...]] = {
    'bare_driver': (BareDriver,), 'bare_relay': (BareRelay,), 'bare_listener': (BareListener,),
    'bare_master': (BareRelay, BareListener, BareDriver)}


def main(name: str, args: list[str]) -> int:
    """Run the bare node of that name, or all three as one process ('bare_master')."""
    def compose(_: Future, add: runner.AddNode) -> None:
        for node in NODES[name]:
            add(node)

    return runner.run(name, compose, args)
