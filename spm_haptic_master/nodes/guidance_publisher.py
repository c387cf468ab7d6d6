# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The state of a calibration by motion, for `view`.

`calibration/coverage` (String, latched) has a JSON object: `text`, what to do next, and `covered`,
shares 0 .. 1 by name; an empty object when the recording has ended.
"""

from __future__ import annotations

from collections.abc import Mapping
import json

from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

# Topic of the state.
COVERAGE_TOPIC = 'calibration/coverage'
# Longest time for the last message to arrive (s).
LAST_TIMEOUT = 0.5


class GuidancePublisher:
    """
    A node in a context of its own, which takes no signals: Ctrl-C is the program's.

    Parameters
    ----------
    name : str
        Fully qualified name of the node.

    """

    def __init__(self, name: str) -> None:
        namespace, _, node = name.rpartition('/')
        self._context = Context()
        self._context.init(args=[])
        self._node = Node(node, namespace=namespace, context=self._context,
                          start_parameter_services=False, enable_rosout=False,
                          use_global_arguments=False)
        self._out = self._node.create_publisher(String, COVERAGE_TOPIC, STATE)

    def publish(self, text: str, covered: Mapping[str, float]) -> None:
        """Publish what to do next and the shares of what is needed."""
        self._out.publish(String(data=json.dumps({'text': text, 'covered': dict(covered)})))

    def close(self) -> None:
        """Say that the recording has ended, and end the node."""
        self._out.publish(String(data='{}'))
        self._out.wait_for_all_acked(Duration(seconds=LAST_TIMEOUT))
        self._node.destroy_node()
        self._context.try_shutdown()
