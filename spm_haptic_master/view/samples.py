# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The topics of a device that are only drawn: dexterity, readings, torques."""

from __future__ import annotations

from collections.abc import Callable

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from spm_haptic_master.description.three_encoders import ThreeEncoders
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.ros.inputs import SampledTopic
from spm_haptic_master.timing import SECOND
from std_msgs.msg import Float64MultiArray

# Topics of the torques commanded and rendered, in the handle's frame.
TORQUE_TOPICS = 'body/servo_cf', 'body/measured_cf'
# Time after which a torque without a new message is over (s).
TORQUE_TIMEOUT = 0.25


class Samples:
    """The newest message of each topic, taken when it is drawn by a node of no executor."""

    def __init__(self, taker: Node, name: Callable[[str], str]) -> None:
        self._dexterity = SampledTopic(taker, Float64MultiArray, name('dexterity'))
        self._readings = SampledTopic(taker, JointState, name('readings'))
        self._wrenches = [SampledTopic(taker, WrenchStamped, name(topic))
                          for topic in TORQUE_TOPICS]
        # Dexterity of three encoders, and of all.
        self.dexterities: tuple[float, ...] | None = None
        # Commanded and rendered, N m, in the handle's frame; None without messages.
        self.torques: list[tuple[float, ...] | None] = [None, None]
        # When each torque came (s).
        self._came = [0.0, 0.0]

    def take(self, now: float, watched: bool, three: ThreeEncoders) -> None:
        """Take the newest messages at a time, s; subscribe only while somebody looks."""
        for topic in (self._dexterity, self._readings, *self._wrenches):
            if watched:
                topic.subscribe()
            else:
                topic.unsubscribe()
        dexterity = self._dexterity.take()
        if dexterity is not None:
            self.dexterities = tuple(dexterity.data) if len(dexterity.data) == 2 else None
        three.solve(None if self.dexterities is None else self.dexterities[0])
        readings = self._readings.take()
        if readings is not None and list(readings.name[:4]) == list(JOINT_NAMES):
            stamp = readings.header.stamp
            three.add_readings(stamp.sec * SECOND + stamp.nanosec, readings.position[:3])
        for index, topic in enumerate(self._wrenches):
            wrench = topic.take()
            if wrench is not None:
                torque = wrench.wrench.torque
                self.torques[index], self._came[index] = (torque.x, torque.y, torque.z), now
            elif now - self._came[index] > TORQUE_TIMEOUT:
                self.torques[index] = None
