# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The state of a calibration by motion, for `view`.

`calibration/coverage` (String, latched) has a JSON object: `text`, what to do next, and `covered`,
shares 0 .. 1 by name; an empty object when the recording has ended.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import json

from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

# Topic of the state, and name of its node.
COVERAGE_TOPIC = 'calibration/coverage'
NODE = 'calibrate'
# Longest time for the last message to arrive (s).
LAST_TIMEOUT = 0.5
# Takes an instruction and the shares of what it needs, 0 .. 1, by name.
Publish = Callable[[str, Mapping[str, float]], None]


@contextmanager
def published(remaps: Sequence[str]) -> Iterator[Publish]:
    """
    Publish a calibration's state in the namespace of ROS remappings.

    The node has a context of its own, which takes no signals: Ctrl-C is the program's.

    Parameters
    ----------
    remaps : sequence of str
        ROS remappings, as after `-r`; __ns gives the namespace.

    Yields
    ------
    callable
        Publishes an instruction and the shares of what it needs.

    Raises
    ------
    InputError
        A remapping is not valid.

    """
    namespace, _, name = Parameters(remaps=remaps).full_name(NODE).rpartition('/')
    context = Context()
    context.init(args=[])
    node = Node(
        name,
        namespace=namespace,
        context=context,
        start_parameter_services=False,
        enable_rosout=False,
        use_global_arguments=False,
    )
    out = node.create_publisher(String, COVERAGE_TOPIC, STATE)
    try:
        yield lambda text, covered: out.publish(
            String(data=json.dumps({'text': text, 'covered': dict(covered)}))
        )
    finally:
        out.publish(String(data='{}'))
        out.wait_for_all_acked(Duration(seconds=LAST_TIMEOUT))
        context.try_shutdown()
