# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `teleop` commands the slave: its pose, the velocity of that pose, and its jaw."""

from __future__ import annotations

from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from spm_haptic_master.nodes.latest_angle import LatestAngle
from spm_haptic_master.nodes.teleop_factory import command_period
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.cdr import PoseWriter
from spm_haptic_master.ros.inputs import Inputs
from spm_haptic_master.ros.qos import COMMANDS, EVENTS, SAMPLES
from spm_haptic_master.teleoperation.command import Command, Motion
from spm_haptic_master.teleoperation.fading_twist import FadingTwist
from spm_haptic_master.teleoperation.jaw import FollowingJaw
from spm_haptic_master.timing import SECOND

# Twists of zero at the end: MoveIt Servo stops at the first one that arrives.
ZEROS = 4
# Time without a command after which the twist fades (command periods).
FADE_PERIODS = 2.5
# Largest age of the gripper's angle (s): clients publish at 50 Hz or more.
GRIPPER_TIMEOUT = 0.1


class CommandOutput:
    """
    Publishes `servo_cp`, and `delta_twist_cmds` while it has a subscriber.

    Parameters
    ----------
    node
        Node that publishes.
    values
        Checked settings of `teleop`: accelerations, frame and rate of the commands.
    now
        Present time, s, monotonic, as all times of this class.

    """

    def __init__(
        self,
        node: Node,
        values: Values,
        now: float,
    ) -> None:
        self._pose_out = node.create_publisher(PoseStamped, 'servo_cp', COMMANDS)
        self._twist_out = node.create_publisher(TwistStamped, 'delta_twist_cmds', COMMANDS)
        self._twist = TwistStamped()
        self._fading = FadingTwist(
            acceleration=values['teleop.acceleration_limit'],
            sliding_acceleration=values['teleop.insertion_acceleration_limit'],
            zeros=ZEROS,
        )
        self._period = command_period(values)
        self._commanded_at = now
        self._twisted_at = now
        self.set_frame(values['teleop.frame_id'])

    def set_frame(self, frame: str) -> None:
        """
        Have the frame_id of the commands.

        Parameters
        ----------
        frame : str
            Frame of the slave's poses.

        """
        self._write = PoseWriter(frame).write
        self._twist.header.frame_id = frame

    def publish(
        self,
        stamp: int,
        command: Command,
        now: float,
    ) -> None:
        """
        Publish a command.

        Parameters
        ----------
        stamp
            Stamp of the orientation that it follows from, ns.
        command
            Pose and motion of the slave's tip.
        now
            Present time, s, monotonic.

        """
        pose = command.pose
        message = self._write(stamp, pose.position, pose.rotation)
        self._pose_out.publish(message)
        if self._twist_out.get_subscription_count():
            passed = max(now - self._twisted_at, self._period)
            motion = self._fading.follow(command.motion, passed)
            self._publish_twist(stamp, motion)
        else:
            self._fading.stop()
        self._commanded_at = now
        self._twisted_at = now

    def fade(
        self,
        stamp: int,
        now: float,
        is_engaged: bool,
    ) -> None:
        """
        Publish the velocity that is left, unless a command has just come.

        Parameters
        ----------
        stamp : int
            Stamp of the twist, ns.
        now : float
            Present time, s, monotonic.
        is_engaged : bool
            Whether commands are expected: then the twist fades only after FADE_PERIODS without
            one.

        """
        if is_engaged and now - self._commanded_at <= FADE_PERIODS * self._period:
            return
        motion = self._fading.fade(now - self._twisted_at)
        self._twisted_at = now
        if motion is not None and self._twist_out.get_subscription_count():
            self._publish_twist(stamp, motion)

    def _publish_twist(self, stamp: int, motion: Motion) -> None:
        """Publish a twist: angular velocity, rad/s, and velocity of the tip, m/s."""
        header = self._twist.header
        twist = self._twist.twist
        header.stamp.sec, header.stamp.nanosec = divmod(stamp, SECOND)
        twist.angular.x, twist.angular.y, twist.angular.z = motion.angular
        twist.linear.x, twist.linear.y, twist.linear.z = motion.linear
        self._twist_out.publish(self._twist)


class JawOutput:
    """
    Publishes `slave/jaw/servo_jp` with each command, while the gripper's angle arrives.

    The jaw begins where `slave/jaw/measured_js` says that it is. Without that, or without
    `gripper/measured_js`, nothing is published.

    Parameters
    ----------
    node
        Node that publishes.
    values
        Checked settings of `teleop`: speed of alignment, largest age of the jaw's angle.
    inputs
        Subscriptions of the node.

    """

    def __init__(
        self,
        node: Node,
        values: Values,
        inputs: Inputs,
    ) -> None:
        self._align_speed: float = values['gripper.align_speed']
        self._accepts_unstamped: bool = values['teleop.slave_without_stamps']
        self._gripper = LatestAngle(GRIPPER_TIMEOUT)
        self._jaw = LatestAngle(values['teleop.slave_timeout'])
        # The course of the jaw, and the number of the start of the slave that it belongs to.
        self._following: FollowingJaw | None = None
        self._start = 0
        self._message = JointState(name=['jaw'])
        self._out = node.create_publisher(JointState, 'slave/jaw/servo_jp', COMMANDS)
        inputs.subscribe(JointState, 'gripper/measured_js', self._gripper.take, SAMPLES)
        inputs.subscribe(JointState, 'slave/jaw/measured_js', self._on_jaw, EVENTS)

    def follow(
        self,
        stamp: int,
        start: int,
        now: float,
    ) -> None:
        """
        Command the jaw together with a command of the slave.

        Parameters
        ----------
        stamp
            Stamp of the command, ns.
        start
            How often the slave has begun to follow: a new start takes a new offset.
        now
            Present time, s, monotonic.

        """
        gripper = self._gripper.at(now)
        if gripper is None:
            self._following = None
            return
        if self._following is None or start != self._start:
            jaw = self._jaw.at(now)
            if jaw is None:
                return
            self._start = start
            self._following = FollowingJaw(self._align_speed, gripper, jaw, stamp)
        angle = self._following.advance(gripper, stamp)
        header = self._message.header
        header.stamp.sec, header.stamp.nanosec = divmod(stamp, SECOND)
        self._message.position = [angle]
        self._out.publish(self._message)

    def _on_jaw(self, message: JointState) -> None:
        """Take the angle of the slave's jaw; one without a stamp only if that is accepted."""
        stamp = message.header.stamp
        if stamp.sec or stamp.nanosec or self._accepts_unstamped:
            self._jaw.take(message)
