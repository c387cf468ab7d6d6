# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node's entry on /diagnostics: every second, and at once when it changes."""

from __future__ import annotations

from collections.abc import Mapping
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

REPEAT_PERIOD = 1.0  # s
STEADY = Clock(clock_type=ClockType.STEADY_TIME)
"""For timers that must go on where simulated time stands still, or the clock is set back."""


class Health:
    """
    Publishes one diagnostic status, and logs trouble when it begins and ends.

    Parameters
    ----------
    node : Node
        Whose health it is.
    aspect : str
        What of the node, in a word or two; the status is named 'NODE: ASPECT'.
    hardware_id : str
        What hardware it speaks of.
    logs : bool
        Whether trouble is logged too; no, where it is a state of normal work.

    """

    def __init__(self, node: Node, aspect: str, hardware_id: str, logs: bool = True):
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._name = f'{node.get_fully_qualified_name().lstrip("/")}: {aspect}'
        self._hardware_id = hardware_id
        self._logs = logs
        self._said: tuple[bytes, str] | None = None
        self._troubled = False
        self._said_at = 0.0

    @property
    def message(self) -> str:
        """The message said last."""
        return self._said[1] if self._said else ''

    @property
    def level(self) -> bytes:
        """The level said last."""
        return self._said[0] if self._said else DiagnosticStatus.STALE

    def due(self, level: bytes, message: str) -> bool:
        """Tell whether this is news, or the last word a second old."""
        return (level, message) != self._said \
            or time.monotonic() - self._said_at >= REPEAT_PERIOD

    def say(self, level: bytes, message: str, values: Mapping[str, object]) -> None:
        """Publish the status now; log an error once, and its end."""
        if self._logs and (level, message) != self._said:
            self._log(level, message)
        self._said, self._said_at = (level, message), time.monotonic()
        array = DiagnosticArray(status=[DiagnosticStatus(
            level=level, name=self._name, message=message, hardware_id=self._hardware_id,
            values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()])])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _log(self, level: bytes, message: str) -> None:
        """Log trouble and its end; that a node starts is none."""
        # rclpy wants each severity logged from a place of its own.
        if level == ERROR:
            self._node.get_logger().error(message)
        elif level == WARN and self.level in (OK, ERROR):
            self._node.get_logger().warning(message)
        elif self.level in (WARN, ERROR) and self._troubled:
            self._node.get_logger().info(message)
        self._troubled = level == ERROR or (level == WARN and (self._troubled or self.level == OK))


def _text(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
