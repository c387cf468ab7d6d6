# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the force feedback publishes: the rendered torque, its state, its entry on /diagnostics."""

from __future__ import annotations

from collections.abc import Iterable

from geometry_msgs.msg import WrenchStamped
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from spm_haptic_master.force import Condition, ForceOutput, ForceState
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion
from spm_haptic_master.nodes.wrench_frames import unrotated, WrenchFrame, WrenchFrames
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.cdr import SECOND
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, StatusPublisher, WARN
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.timing import StampGrid
from std_msgs.msg import String

# Levels of the states; the others are OK.
LEVELS = {Condition.FADING: WARN, Condition.FAULT: ERROR}
# States that are not left while there is an obstacle.
WAITING = frozenset((Condition.OFF, Condition.READY))
# What the entry on /diagnostics describes.
HARDWARE = 'motors'


class ForceOutputs:
    """Publishers of the force feedback."""

    def __init__(self, node: Node, values: Values, frames: WrenchFrames) -> None:
        self._matched = PublisherEventCallbacks(matched=lambda _: self.count_subscribers())
        self.wanted = False  # whether the rendered torque has a subscriber
        # The grid of the other CRTK topics.
        self._grid = StampGrid(values['crtk_rate'], values['rate'])
        self._outs: list[tuple[WrenchFrame, WrenchStamped, Publisher]] = []
        for topic, frame in (('spatial/measured_cf', frames.spatial),
                             ('body/measured_cf', frames.body)):
            message = WrenchStamped()
            message.header.frame_id = frame.name
            self._outs.append((frame, message, node.create_publisher(
                WrenchStamped, topic, SAMPLES, event_callbacks=self._matched)))
        self._state_out = node.create_publisher(String, 'force_state', STATE)
        self._status = StatusPublisher(node, 'force', HARDWARE)

    def count_subscribers(self) -> None:
        """Find whether the rendered torque has a subscriber; it is called for each new one."""
        self.wanted = any(out.get_subscription_count() for _, _, out in self._outs)

    def publish(self, stamp: int, output: ForceOutput,
                quaternion: Quaternion[float] | None) -> None:
        """
        Publish the rendered torque of a sample, if it is due and known; its stamp is in ns.

        `quaternion` is R_base_platform; None where no orientation is published.
        """
        if output.rendered is None or quaternion is None or not self._grid.is_due(stamp):
            return
        for frame, message, out in self._outs:
            torque = output.rendered
            if frame.in_handle:
                torque = unrotated(rotation_from_quaternion(*quaternion), torque)
            field, time = message.wrench.torque, message.header.stamp
            field.x, field.y, field.z = frame.outwards(torque)
            time.sec, time.nanosec = divmod(stamp, SECOND)
            out.publish(message)

    def announce(self, states: Iterable[ForceState]) -> None:
        """Publish states that have been entered."""
        for state in states:
            self._state_out.publish(String(data=state.text))

    def is_due(self, output: ForceOutput, caution: str) -> bool:
        """Return whether the entry on /diagnostics changed or is to be repeated."""
        return self._status.is_due(*_summary(output, caution))

    def report(self, output: ForceOutput, caution: str, figures: dict[str, object]) -> None:
        """Publish the entry on /diagnostics; `caution` is what should be investigated."""
        level, text = _summary(output, caution)
        self._status.publish(level, text, figures, logged=(
            LEVELS.get(output.state.condition, OK), output.state.text))


def _summary(output: ForceOutput, caution: str) -> tuple[bytes, str]:
    """Return level and message: the state, what it waits for, and what to investigate."""
    condition = output.state.condition
    level, text = LEVELS.get(condition, OK), output.state.text
    if condition in WAITING and output.obstacle is not None:
        text = f'{text}; {output.obstacle.value}'
    if caution:
        level, text = max(level, WARN), f'{text}; {caution}'
    return level, text
