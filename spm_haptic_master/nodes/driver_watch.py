# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Mechanism and calibration of the driver on the topic `measured_js`, from /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from spm_haptic_master.nodes.diagnostic_status import ENCODERS

# Depth of the queue of /diagnostics, on which many nodes publish now and then (messages).
DEPTH = 10
# What the serialized entry of a driver has in it.
MARK = f': {ENCODERS}\0'.encode()


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
    Compares a node with the drivers whose samples it takes.

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
        node.create_subscription(DiagnosticArray, '/diagnostics', self._take, DEPTH, raw=True)

    def difference(self) -> Difference | None:
        """Return the first difference of a driver of the topic, None if there is none."""
        if all(self._compared(name) is None for name in self._found):
            return None
        for publisher in self._node.get_publishers_info_by_topic(self._topic):
            name = f'{publisher.node_namespace}/{publisher.node_name}'.strip('/')
            difference = self._compared(name)
            if difference is not None:
                return difference
        return None

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
                                     if value.key in self._own}
