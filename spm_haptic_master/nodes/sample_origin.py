# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where `fkm` has its samples from: one driver, of its mechanism and calibration, and when."""

from __future__ import annotations

from functools import cache
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.ros import diagnostic_status
from spm_haptic_master.ros.cdr import SECOND
from spm_haptic_master.ros.diagnostic_status import BUSY_KEY, HOST_KEY, NOT_BUSY
from spm_haptic_master.ros.duplicate_publishers import Rivals
from spm_haptic_master.ros.overload import more_than, TOO_BUSY

# Reason of the silence and its cure where a driver differs, by the key of its entry on
# /diagnostics.
DIFFERENCES = {
    diagnostic_status.CHECKSUM_KEY: ('another mechanism in the driver',
                                     'give geometry.* and working_mode for all nodes, /**'),
    diagnostic_status.CALIBRATION_KEY: ('another calibration in the driver',
                                        'give fkm the calibration file of the driver')}
# Depth of the queue of /diagnostics, on which many nodes publish now and then (messages).
DEPTH = 10
# Bytes in the serialized entry of a driver.
MARK = f': {diagnostic_status.ENCODERS}\0'.encode()
# Age above which a driver's report on its machine is out of date (s).
OLDEST = 3.0 * diagnostic_status.REPEAT_PERIOD
# File with the kernel's boot id.
BOOT_ID = Path('/proc/sys/kernel/random/boot_id')


@cache
def host() -> str:
    """Return the boot id of this kernel: two processes with the same one share a clock."""
    try:
        return BOOT_ID.read_text().strip()
    except OSError:
        return 'unknown'


class SampleOrigin:
    """
    Finds why no sample can be taken, whatever its angles are.

    After `watch`, the driver of the topic is compared by what it reports on /diagnostics. A
    publisher that reports nothing, such as a bag or another program, is not compared.
    """

    def __init__(self, node: Node, mechanism: str, calibration: str) -> None:
        self._node = node
        self._topic = node.resolve_topic_name('measured_js')
        # What has to be the same in the driver of the topic.
        self._own = {diagnostic_status.CHECKSUM_KEY: mechanism,
                     diagnostic_status.CALIBRATION_KEY: calibration or diagnostic_status.UNNAMED}
        self._rivals = Rivals(node, 'orientation', 'measured_js')
        # Latest entry of each driver, by its node's full name without the first slash, and when
        # it came, s, monotonic.
        self._found: dict[str, tuple[dict[str, str], float]] = {}
        # Boot id of the driver; empty where it reports none.
        self._host = host()
        self._obstacle: tuple[str, str] | None = None
        self._find_at = 0.0

    def watch(self) -> None:
        """Expect the samples on the topic, and watch its drivers."""
        self._host = ''
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics', self._take, DEPTH, raw=True)

    def obstacle(self) -> tuple[str, str] | None:
        """Return reason and detail of what forbids any orientation, polled now and then; None."""
        now = time.monotonic()
        if now >= self._find_at:
            self._find_at = now + diagnostic_status.RIVALS_PERIOD
            rivals = self._rivals.found()
            self._obstacle = self._difference() if rivals is None else (rivals, 'expected one')
        return self._obstacle

    def overload(self) -> str:
        """Return the words of a driver of this host that lost time; empty if none did."""
        now = time.monotonic()
        return next((words for found, when in self._found.values()
                     if found.get(HOST_KEY) == host() and now - when < OLDEST
                     and (words := found.get(BUSY_KEY, NOT_BUSY)) != NOT_BUSY), '')

    def rejection(self, age: int, max_age: int, is_simulated: bool) -> RejectedError:
        """Return why a sample is rejected for its age (ns); whether /clock is the clock."""
        if age > 0 and self._host == host() and not is_simulated:
            return RejectedError(TOO_BUSY, f'a sample is {more_than(age / SECOND)} old, '
                                 f'limit {max_age / SECOND:g} s')
        return RejectedError(
            'stale sample' if age > 0 else 'sample from the future',
            f'{age / SECOND:.6f} s old, limit {max_age / SECOND:g} s'
            + ('; are the clocks of the two hosts synchronized?'
               if self._host not in ('', host()) else ''))

    def _difference(self) -> tuple[str, str] | None:
        """Return reason and detail of the first difference of the driver of the topic."""
        if not self._found:
            return None
        # Several publishers are rivals.
        names = (f'{publisher.node_namespace}/{publisher.node_name}'.strip('/')
                 for publisher in self._node.get_publishers_info_by_topic(self._topic))
        driver = next((name for name in names if name in self._found), '')
        found = self._found[driver][0] if driver else {}
        self._host = found.get(HOST_KEY, '')
        for key, expected in self._own.items():
            if found.get(key, expected) != expected:
                reason, cure = DIFFERENCES[key]
                return reason, f'{driver} has {found[key]}, expected {expected}: {cure}'
        return None

    def _take(self, diagnostics: bytes) -> None:
        if MARK not in diagnostics:
            return
        for status in deserialize_message(diagnostics, DiagnosticArray).status:
            name, _, aspect = status.name.partition(': ')
            if aspect == diagnostic_status.ENCODERS:
                self._found[name] = (
                    {each.key: each.value for each in status.values
                     if each.key in (*self._own, HOST_KEY, BUSY_KEY)}, time.monotonic())
