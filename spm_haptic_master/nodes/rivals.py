# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether a topic that belongs to one publisher has several."""

from __future__ import annotations

import time

from rclpy.node import Node
from spm_haptic_master.nodes.diagnostic_status import RIVALS_PERIOD


class Rivals:
    """
    The publishers on some topics, counted every `RIVALS_PERIOD`.

    Parameters
    ----------
    node : Node
        Node that counts them.
    topics : str
        Names of the topics, relative to the node's namespace.

    """

    def __init__(self, node: Node, *topics: str) -> None:
        self._node = node
        self._topics = tuple(map(node.resolve_topic_name, topics))
        self._count_at = 0.0
        self._found: str | None = None

    def found(self) -> str | None:
        """Return on which topic several nodes publish, and how many; None if on none."""
        now = time.monotonic()
        if now >= self._count_at:
            self._count_at = now + RIVALS_PERIOD
            self._found = next(
                (f'{count} publishers on {topic}' for topic in self._topics
                 if (count := self._node.count_publishers(topic)) > 1), None)
        return self._found
