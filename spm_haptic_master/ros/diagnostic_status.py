# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node's entry on /diagnostics: published every second, and at once when it changes."""

from __future__ import annotations

from collections.abc import Mapping
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from spm_haptic_master.ros import node_log

OK: bytes = DiagnosticStatus.OK
WARN: bytes = DiagnosticStatus.WARN
ERROR: bytes = DiagnosticStatus.ERROR

# Time between two counts of the publishers on a topic (s).
RIVALS_PERIOD = 0.2
# Period of an unchanged entry on /diagnostics (s).
REPEAT_PERIOD = 1.0
# Period at which a node checks its state for a change (s): faults are due within 50 ms.
CHECK_PERIOD = 0.02
# Hardware id of entries on the mechanism as a whole.
MECHANISM = 'spherical parallel manipulator'
# Aspect of the driver's entry, and the key of a node's mechanism in its entry.
ENCODERS = 'encoders'
CHECKSUM_KEY = 'mechanism'
CALIBRATION_KEY = 'calibration'
# Value of the latter where the calibration has no name.
UNNAMED = 'not named'
# Key of the joints without a reading in the driver's latest set, in its entry.
MISSING_KEY = 'joints missing'
# Key of a caution in fkm's entry, which has it only where something should be investigated.
CAUTION_KEY = 'caution'
# Clock of timers that continue while simulated time stands still or the clock is set back.
STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class StatusPublisher:
    """
    Publishes the status 'NODE: ASPECT'; logs where errors and warnings begin and end.

    Parameters
    ----------
    node : Node
        The node whose entry it is.
    aspect : str
        What the entry is about: the second half of its name.
    hardware_id : str
        The device, such as 'can0' or the mechanism.
    logs : bool
        Whether changes of level and message are logged.

    """

    def __init__(
        self,
        node: Node,
        aspect: str,
        hardware_id: str,
        logs: bool = True,
    ) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._name = f'{node.get_fully_qualified_name().lstrip("/")}: {aspect}'
        self._hardware_id = hardware_id
        self._logs = logs
        # Message published last.
        self.message = ''
        # Level and subject published last, and when (s, monotonic).
        self._subject: tuple[bytes, str] | None = None
        self._published_at = 0.0
        # Level and message that the log is up to date with.
        self._logged = OK, ''
        # Whether the start of the node is over, whose warnings are not logged.
        self._is_started = False

    def is_due(self, level: bytes, subject: str) -> bool:
        """Return whether level or subject changed, or `REPEAT_PERIOD` has passed."""
        if (level, subject) != self._subject:
            return True
        return time.monotonic() - self._published_at >= REPEAT_PERIOD

    def publish(
        self,
        level: bytes,
        message: str,
        values: Mapping[str, object],
        subject: str | None = None,
        logged: tuple[bytes, str] | None = None,
        starting: bool = False,
    ) -> None:
        """
        Publish the status now, and log a change.

        Parameters
        ----------
        level : bytes
            OK, WARN or ERROR.
        message : str
            The state in words.
        values : mapping
            Key/value pairs of the entry; a float is printed with six digits.
        subject : str, optional
            Identifies a change where the message has running figures.
        logged : tuple of bytes and str, optional
            Level and message of the log, where a caution comes and goes in normal work.
        starting : bool, optional
            Whether the node starts: what it waits for is not logged, but an error is.

        """
        self._is_started = self._is_started or not starting or level == ERROR
        if self._logs and self._is_started:
            logged_level, logged_message = logged or (level, message)
            self._log(logged_level, logged_message)
        self._subject = level, message if subject is None else subject
        self.message = message
        self._published_at = time.monotonic()
        status = DiagnosticStatus(
            level=level,
            name=self._name,
            message=message,
            hardware_id=self._hardware_id,
        )
        for key, value in values.items():
            entry = KeyValue(key=key, value=_text(value))
            status.values.append(entry)
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _log(self, level: bytes, message: str) -> None:
        """Log an error or a warning, and its end."""
        if (level, message) == self._logged:
            return
        previous, _ = self._logged
        self._logged = level, message
        if level == ERROR:
            node_log.error(self._node, message)
        elif level == WARN:
            node_log.warning(self._node, message)
        elif previous != OK:
            node_log.info(self._node, message)


def _text(value: object) -> str:
    """Return a value in an entry: a float with six digits."""
    if isinstance(value, float):
        return f'{value:.6g}'
    return str(value)
