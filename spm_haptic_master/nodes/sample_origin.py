# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where `fkm` has its samples from: one driver, of its mechanism and calibration, and when."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.ros import diagnostic_status
from spm_haptic_master.ros.duplicate_publishers import publishers, Rivals
from spm_haptic_master.ros.overload import more_than, TOO_BUSY
from spm_haptic_master.ros.qos import EVENTS
from spm_haptic_master.timing import Periodic, SECOND

# Reason of the silence and its cure where a driver differs, by the key of its entry on
# /diagnostics.
DIFFERENCES = {
    diagnostic_status.CHECKSUM_KEY: (
        'another mechanism in the driver',
        'give geometry.* and working_mode for all nodes, /**',
    ),
    diagnostic_status.CALIBRATION_KEY: (
        'another calibration in the driver',
        'give fkm the calibration file of the driver',
    ),
}
# Bytes in the serialized entry of a driver.
MARK = f': {diagnostic_status.ENCODERS}\0'.encode()


class SampleOrigin:
    """
    Finds why no sample can be taken, whatever its angles are.

    After `watch` the driver of the topic is compared by its entry on /diagnostics; a publisher
    without one, such as a bag, is not compared.

    Parameters
    ----------
    node : Node
        The node that takes the samples.
    mechanism : str
        Checksum of its mechanism.
    calibration : str
        Name of its calibration; empty: not named.

    """

    def __init__(
        self,
        node: Node,
        mechanism: str,
        calibration: str,
    ) -> None:
        self._node = node
        self._topic = node.resolve_topic_name('measured_js')
        # What has to be the same in the driver of the topic.
        self._own = {
            diagnostic_status.CHECKSUM_KEY: mechanism,
            diagnostic_status.CALIBRATION_KEY: calibration or diagnostic_status.UNNAMED,
        }
        self._rivals = Rivals(node, 'orientation', 'measured_js')
        # Latest entry of each driver, by its node's full name without the first slash.
        self._found: dict[str, dict[str, str]] = {}
        # Whether the driver is another process.
        self._is_watching = False
        self._obstacle: tuple[str, str] | None = None
        self._poll = Periodic(diagnostic_status.RIVALS_PERIOD)

    def watch(self) -> None:
        """Expect the samples on the topic, and watch its drivers."""
        self._is_watching = True
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics', self._take, EVENTS, raw=True
        )

    def obstacle(self) -> tuple[str, str] | None:
        """Return reason and detail of what forbids any orientation, polled now and then; None."""
        if self._poll.is_due(time.monotonic()):
            rivals = self._rivals.found()
            if rivals is None:
                self._obstacle = self._difference()
            else:
                self._obstacle = (rivals, 'expected one')
        return self._obstacle

    def rejection(self, age: int, max_age: int) -> RejectedError:
        """
        Return why a sample is rejected for its age.

        Parameters
        ----------
        age : int
            Age of the sample, ns; negative: from the future.
        max_age : int
            Largest age, ns.

        Returns
        -------
        RejectedError
            With the reason in words, and what to look for.

        """
        limit = f'limit {max_age / SECOND:g} s'
        if age > 0 and not self._is_watching:
            return RejectedError(TOO_BUSY, f'a sample is {more_than(age / SECOND)} old, {limit}')
        reason = 'sample from the future'
        if age > 0:
            reason = 'stale sample'
        return RejectedError(
            reason,
            f'{age / SECOND:.6f} s old, {limit}: a host is too busy, or the clocks of two hosts '
            'are not synchronized',
        )

    def _difference(self) -> tuple[str, str] | None:
        """Return reason and detail of the first difference of the driver of the topic."""
        if not self._found:
            return None
        driver = ''
        for name in publishers(self._node, self._topic):
            if name.strip('/') in self._found:
                driver = name.strip('/')
                break
        found = self._found.get(driver, {})
        for key, expected in self._own.items():
            if found.get(key, expected) != expected:
                reason, cure = DIFFERENCES[key]
                return reason, f'{driver} has {found[key]}, expected {expected}: {cure}'
        return None

    def _take(self, diagnostics: bytes) -> None:
        """Store what a driver reports of its mechanism and calibration."""
        if MARK not in diagnostics:
            return
        for status in deserialize_message(diagnostics, DiagnosticArray).status:
            name, _, aspect = status.name.partition(': ')
            if aspect == diagnostic_status.ENCODERS:
                values = {}
                for entry in status.values:
                    if entry.key in self._own:
                        values[entry.key] = entry.value
                self._found[name] = values
