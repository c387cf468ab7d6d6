# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands of `teleop` as a rate, for MoveIt Servo: it fades to zero where they end."""

from __future__ import annotations

from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.ros.cdr import SECOND
from spm_haptic_master.ros.qos import COMMANDS
from spm_haptic_master.teleoperation.command_limits import FadingTwist

# Twists of zero at the end: MoveIt Servo stops at the first one that arrives.
ZEROS = 4


class TwistOutput:
    """
    Publishes `delta_twist_cmds` while it has a subscriber.

    The acceleration of its fading is in rad/s^2, the period of the commands and the times
    (monotonic) in s.
    """

    def __init__(self, node: Node, acceleration: float, period: float, now: float) -> None:
        self._out = node.create_publisher(TwistStamped, 'delta_twist_cmds', COMMANDS)
        self._message, self._is_wanted = TwistStamped(), False
        self._fading = FadingTwist(acceleration, ZEROS)
        self._period, self._passed = period, now

    def set_frame(self, frame: str) -> None:
        """Have the frame_id of the messages."""
        self._message.header.frame_id = frame

    def count_subscribers(self) -> None:
        """Find whether anybody listens: call it at each poll."""
        self._is_wanted = self._out.get_subscription_count() > 0

    def follow(self, stamp: int, velocity: Vector[float], now: float) -> None:
        """Publish the velocity of a command (rad/s) with its stamp (ns)."""
        self._publish(stamp, self._fading.follow(velocity, max(now - self._passed, self._period)))
        self._passed = now

    def fade(self, stamp: int, now: float) -> None:
        """Publish the velocity that is left, as long as it is not zero."""
        self._publish(stamp, self._fading.fade(now - self._passed))
        self._passed = now

    def _publish(self, stamp: int, velocity: Vector[float] | None) -> None:
        if velocity is None or not self._is_wanted:
            return
        header, angular = self._message.header, self._message.twist.angular
        header.stamp.sec, header.stamp.nanosec = divmod(stamp, SECOND)
        angular.x, angular.y, angular.z = velocity
        self._out.publish(self._message)
