# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `teleop` hears of the slave: its pose, its trocar, and its operating state."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from math import isfinite
from typing import Any

from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from spm_haptic_master.nodes.slave_torque import components
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.inputs import Inputs
from spm_haptic_master.ros.qos import EVENTS, STATE
from spm_haptic_master.teleoperation.command import Pose
from spm_haptic_master.teleoperation.engaging import Teleoperation
from spm_haptic_master.teleoperation.operating_state import ENABLED

POSE_TOPIC = 'slave/measured_cp'
TROCAR_TOPIC = 'slave/trocar'
STATE_TOPIC = 'slave/operating_state'
# Receives what follows from a message, and is called with the lock of the machine.
Take = Callable[[Callable[[Any], None], Any], None]


class SlaveInputs:
    """
    Passes what the slave publishes to the tele-operation.

    Parameters
    ----------
    node
        Node that subscribes.
    values
        Checked settings of `teleop`.
    machine
        The tele-operation.
    take
        Calls a function with a message while it holds the lock of the machine.
    use_frame
        Called with the frame_id of the slave's pose when that changes.

    """

    def __init__(
        self,
        node: Node,
        values: Values,
        machine: Teleoperation,
        take: Take,
        use_frame: Callable[[str], None],
    ) -> None:
        self._machine = machine
        self._use_frame = use_frame
        self._accepts_unstamped: bool = values['teleop.slave_without_stamps']
        # Frame, stamp and content of the slave's last pose; None before the first.
        self.frame: str | None = None
        self._stamp: tuple[int, int] | None = None
        self.pose: Pose | None = None
        # Frame of the trocar, None before one came, and whether its position is usable.
        self._trocar_frame: str | None = None
        self._is_trocar_finite = True
        self.inputs = Inputs(node)
        self.inputs.subscribe(
            PoseStamped, POSE_TOPIC, lambda pose: take(self._on_pose, pose), EVENTS
        )
        self.inputs.subscribe(
            PointStamped, TROCAR_TOPIC, lambda point: take(self._on_trocar, point), STATE
        )
        self._subscribe_to_state(node, lambda state: take(self._on_state, state))

    def obstacle(self) -> str:
        """
        Return which topic of the slave cannot be used, and why; empty if all can.

        Returns
        -------
        str
            A topic that is not heard, a trocar that is not finite, or one in another frame than
            the poses.

        """
        unheard = self.inputs.unheard()
        if unheard:
            return unheard
        if not self._is_trocar_finite:
            return f'{TROCAR_TOPIC} is not finite'
        if self.frame is None or self._trocar_frame in (None, '', self.frame):
            return ''
        return (
            f'{TROCAR_TOPIC} is in frame {self._trocar_frame!r}; '
            f'expected {self.frame!r} as {POSE_TOPIC}, or none'
        )

    def _subscribe_to_state(self, node: Node, callback: Callable[[Any], None]) -> None:
        """Subscribe to the operating state, where its messages are installed."""
        with suppress(ImportError):
            from crtk_msgs import msg

            # dVRK latches it and publishes changes alone; others repeat it, not latched. One of
            # the two does not match such a publisher, which is no reason for a warning.
            quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
            for qos in (EVENTS, STATE):
                node.create_subscription(
                    msg.OperatingState, STATE_TOPIC, callback, qos, event_callbacks=quiet
                )

    def _on_pose(self, message: PoseStamped) -> None:
        """
        Take a pose of the slave; one without a stamp, or that is not finite, is none.

        A pose with the stamp of the last one is ignored. Poses without a stamp are used with
        `teleop.slave_without_stamps`.

        Parameters
        ----------
        message : PoseStamped
            Pose of the slave's tip in its frame, m.

        """
        given = message.header.stamp
        stamp = given.sec, given.nanosec
        is_stamped = any(stamp)
        # A bridge may repeat its last pose.
        if is_stamped and stamp == self._stamp:
            return
        self._stamp = stamp
        # As dVRK publishes it while its arm is not ready.
        is_invalid = not (is_stamped or self._accepts_unstamped)
        position = components(message.pose.position)
        if is_invalid or not all(map(isfinite, position)):
            self.pose = None
        else:
            self._take_frame(message.header.frame_id)
            q = message.pose.orientation
            self.pose = Pose((q.x, q.y, q.z, q.w), position)
        self._machine.take_slave(self.pose)

    def _take_frame(self, frame: str) -> None:
        """Disengage where the slave's poses are in another frame now."""
        if frame != self.frame:
            self._machine.disengage('another frame of the slave')
            self.frame = frame
            self._use_frame(frame)

    def _on_trocar(self, message: PointStamped) -> None:
        """
        Take the trocar; its frame is compared when the poses' is known.

        Parameters
        ----------
        message : PointStamped
            Position of the trocar, m.

        """
        position = components(message.point)
        self._trocar_frame = message.header.frame_id
        self._is_trocar_finite = all(map(isfinite, position))
        if self._is_trocar_finite:
            self._machine.take_trocar(position)
        else:
            self._machine.disengage(f'{TROCAR_TOPIC} is not finite')

    def _on_state(self, message: Any) -> None:
        """Take the operating state: the slave may be followed while it is enabled and homed."""
        obstacle = ''
        if message.state != ENABLED:
            obstacle = f'slave {message.state or "without a state"}'
        elif not message.is_homed:
            obstacle = 'slave not homed'
        self._machine.take_slave_obstacle(obstacle)
