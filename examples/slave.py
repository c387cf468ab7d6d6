# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A whole slave behind `teleop`: it follows `servo_cp` and holds without it."""

import time

from geometry_msgs.msg import PoseStamped
import rclpy
from rclpy.node import Node


class Slave(Node):
    """Takes commanded poses, publishes where it is."""

    def __init__(self):
        super().__init__('slave')
        self.commanded_at = 0.0
        self.pose = PoseStamped()
        self.pose.header.frame_id = 'slave_base'
        self.out = self.create_publisher(PoseStamped, 'slave/measured_cp', 10)
        self.create_subscription(PoseStamped, 'servo_cp', self.follow, 10)
        self.create_timer(0.005, self.publish)

    def follow(self, command):
        """Take a command: of a real slave, the setpoint of its controller."""
        self.commanded_at = time.monotonic()
        self.pose.pose = command.pose

    def publish(self):
        """Publish the pose; without commands for 20 ms a real slave holds, brakes on."""
        if time.monotonic() - self.commanded_at > 0.02:
            pass  # no command comes until the surgeon enables again
        self.pose.header.stamp = self.get_clock().now().to_msg()
        self.out.publish(self.pose)


rclpy.init()
rclpy.spin(Slave())
