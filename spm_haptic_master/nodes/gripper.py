# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The gripper of the handle as CRTK clients read it: one position, of an axis or a constant."""

from __future__ import annotations

from math import isfinite, radians

from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState, Joy
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.qos import EVENTS
from std_msgs.msg import Header

# Value of the setting of the axis without one.
NO_AXIS = -1


class Gripper:
    """
    Publishes `gripper/measured_js`; with an axis it takes its value from `gripper/joy`.

    Parameters
    ----------
    node : Node
        Node of the device.
    values : mapping
        Checked values of `FKM_SETTINGS`.
    header : Header
        Header of the message, which the node sets.
    publisher : Publisher
        That of `gripper/measured_js`.

    """

    def __init__(self, node: Node, values: Values, header: Header, publisher: Publisher) -> None:
        self._axis: int = values['gripper.axis']
        self._closed, self._open = map(radians, values['gripper.range_deg'])
        self._message = JointState(header=header, name=['gripper'])
        # With an axis nothing is published before its first value.
        if self._axis == NO_AXIS:
            self._message.position = [radians(values['gripper.position_deg'])]
        else:
            node.create_subscription(Joy, 'gripper/joy', self._take, EVENTS)
        self._out = publisher

    def is_wanted(self) -> bool:
        """Return whether it has a subscriber, and a position."""
        return len(self._message.position) > 0 and self._out.get_subscription_count() > 0

    def publish(self) -> None:
        """Publish the position, with the header as it is."""
        self._out.publish(self._message)

    def _take(self, joy: Joy) -> None:
        """Take the value of the axis; a message without a usable one changes nothing."""
        if self._axis >= len(joy.axes) or not isfinite(joy.axes[self._axis]):
            return
        part = 0.5 * (max(-1.0, min(1.0, joy.axes[self._axis])) + 1.0)
        self._message.position = [self._closed + part * (self._open - self._closed)]
