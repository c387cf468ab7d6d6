# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The driver on the topic `measured_js`: what it reports of itself on /diagnostics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from spm_haptic_master.ros.diagnostic_status import (
    BUSY_KEY,
    ENCODERS,
    HOST_KEY,
    NOT_BUSY,
    REPEAT_PERIOD,
)

# Depth of the queue of /diagnostics, on which many nodes publish now and then (messages).
DEPTH = 10
# What the serialized entry of a driver has in it.
MARK = f': {ENCODERS}\0'.encode()
# Age above which a driver's report on its machine says nothing about now (s).
OLDEST = 3.0 * REPEAT_PERIOD
# File with the kernel's boot id.
BOOT_ID = Path('/proc/sys/kernel/random/boot_id')


@cache
def host() -> str:
    """Return the boot id of this kernel: two processes with the same one share a clock."""
    try:
        return BOOT_ID.read_text().strip()
    except OSError:
        return 'unknown'


class Difference(NamedTuple):
    """
    What differs in a driver.

    Attributes
    ----------
    driver : str
        Full name of its node without the first slash.
    key : str
        Key of its entry on /diagnostics.
    found, expected : str
        Value in the driver, and that of the node that watches.

    """

    driver: str
    key: str
    found: str
    expected: str


class DriverWatch:
    """
    Compares a node with the drivers whose samples it takes, and their hosts with its own.

    What a driver does not publish is not compared, nor a driver that publishes nothing, such as a
    bag or another program.

    Parameters
    ----------
    node : Node
        Node that takes samples from the topic `measured_js`.
    own : mapping of str to str
        Its own values, by the key of a driver's entry on /diagnostics.

    """

    def __init__(self, node: Node, own: Mapping[str, str]) -> None:
        self._node = node
        self._own = dict(own)
        self._topic = node.resolve_topic_name('measured_js')
        # Latest values of each driver, by its node's full name without the first slash.
        self._found: dict[str, dict[str, str]] = {}
        # When its entry came, s, monotonic.
        self._found_at: dict[str, float] = {}
        node.create_subscription(DiagnosticArray, '/diagnostics', self._take, DEPTH, raw=True)

    def difference(self) -> Difference | None:
        """Return the first difference of a driver of the topic, None if there is none."""
        if all(self._compared(name) is None for name in self._found):
            return None
        return next(filter(None, map(self._compared, self._drivers())), None)

    def hosts(self) -> set[str]:
        """Return the boot ids of the hosts of the topic's drivers, as far as they report them."""
        return {found[HOST_KEY] for name in self._drivers()
                if HOST_KEY in (found := self._found.get(name, {}))}

    def overload(self) -> str:
        """Return the words of a driver of this host that lost time; empty if none did."""
        now = time.monotonic()
        return next((words for name, found in self._found.items()
                     if found.get(HOST_KEY) == host() and now - self._found_at[name] < OLDEST
                     and (words := found.get(BUSY_KEY, NOT_BUSY)) != NOT_BUSY), '')

    def _drivers(self) -> Iterator[str]:
        """Yield the names of the nodes that publish on the topic."""
        for publisher in self._node.get_publishers_info_by_topic(self._topic):
            yield f'{publisher.node_namespace}/{publisher.node_name}'.strip('/')

    def _compared(self, driver: str) -> Difference | None:
        found = self._found.get(driver, {})
        return next((Difference(driver, key, found[key], expected)
                     for key, expected in self._own.items()
                     if found.get(key, expected) != expected), None)

    def _take(self, diagnostics: bytes) -> None:
        if MARK not in diagnostics:
            return
        for status in deserialize_message(diagnostics, DiagnosticArray).status:
            name, _, aspect = status.name.partition(': ')
            if aspect == ENCODERS:
                self._found[name] = {value.key: value.value for value in status.values
                                     if value.key in (*self._own, HOST_KEY, BUSY_KEY)}
                self._found_at[name] = time.monotonic()
