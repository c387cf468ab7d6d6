# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A box of angles that the hand feels: free inside, a spring outside.

It is as the box of CRTK's haptic example, which has positions: a wrench with an empty header for
each `measured_cp`. It needs a master with force.enabled:=true and
force.engaged_by:=operating_state, which somebody has to enable.
"""

from geometry_msgs.msg import PoseStamped, WrenchStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    vector_from_quaternion,
)
from std_msgs.msg import String

# Half the width of the box (rad), and the stiffness of its walls (N m/rad).
WIDTH, STIFFNESS = 0.02, 1.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Box(Node):
    """Commands the torque of the walls."""

    def __init__(self):
        super().__init__('box')
        self.center, self.engaged = None, False
        self.out = self.create_publisher(WrenchStamped, 'servo_cf', 10)
        self.create_subscription(String, 'force_state', self.take_state, LATCHED)
        self.create_subscription(PoseStamped, 'measured_cp', self.push, 10)

    def take_state(self, state):
        """Take the state of the force feedback."""
        self.engaged = state.data == 'engaged'

    def push(self, pose):
        """Push back into the box, which is where the handle was when force began."""
        q = pose.pose.orientation
        now = q.x, q.y, q.z, q.w
        if self.center is None or not self.engaged:
            self.center = now
        turned = vector_from_quaternion(*multiply_quaternions(now, conjugate(self.center)))
        wrench = WrenchStamped()
        torque = wrench.wrench.torque
        torque.x, torque.y, torque.z = (
            -STIFFNESS * (angle - min(max(angle, -WIDTH), WIDTH)) for angle in turned
        )
        self.out.publish(wrench)


rclpy.init()
try:
    rclpy.spin(Box())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
