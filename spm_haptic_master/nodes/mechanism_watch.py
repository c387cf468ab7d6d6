# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mechanism of the driver on the topic `measured_js`, by its checksum on /diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from spm_haptic_master.nodes.diagnostic_status import CHECKSUM_KEY, ENCODERS

# Depth of the queue of /diagnostics, on which many nodes publish now and then (messages).
DEPTH = 10
# What the serialized entry of a driver has in it.
MARK = f': {ENCODERS}\0'.encode()


class MechanismWatch:
    """
    Compares a node's mechanism with that of the drivers whose samples it takes.

    A driver that publishes no checksum, such as a bag or another program, is not compared.

    Parameters
    ----------
    node : Node
        Node that takes samples from the topic `measured_js`.
    own : str
        Checksum of its mechanism.

    """

    def __init__(self, node: Node, own: str) -> None:
        self._node = node
        self._own = own
        self._topic = node.resolve_topic_name('measured_js')
        # Latest checksum of each driver, by its node's full name without the first slash.
        self._found: dict[str, str] = {}
        node.create_subscription(DiagnosticArray, '/diagnostics', self._take, DEPTH, raw=True)

    def differing(self) -> tuple[str, str] | None:
        """Return name and checksum of a driver with another mechanism, None if there is none."""
        if all(checksum == self._own for checksum in self._found.values()):
            return None
        for publisher in self._node.get_publishers_info_by_topic(self._topic):
            name = f'{publisher.node_namespace}/{publisher.node_name}'.strip('/')
            checksum = self._found.get(name, self._own)
            if checksum != self._own:
                return name, checksum
        return None

    def _take(self, diagnostics: bytes) -> None:
        if MARK not in diagnostics:
            return
        for status in deserialize_message(diagnostics, DiagnosticArray).status:
            name, _, aspect = status.name.partition(': ')
            for value in status.values:
                if aspect == ENCODERS and value.key == CHECKSUM_KEY:
                    self._found[name] = value.value
