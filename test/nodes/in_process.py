# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node of the test's own process, which gets its messages by plain calls."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.node import Node
from spm_haptic_master.benchmark.child_process import private_environment


@contextmanager
def ros() -> Iterator[None]:
    """Have rclpy in this process, in the domain of the run."""
    rclpy.init(args=[], domain_id=int(private_environment()['ROS_DOMAIN_ID']))
    try:
        yield
    finally:
        rclpy.try_shutdown()


def deliver(node: Node, topic: str, message: object) -> None:
    """Give a node a message on a topic that it has subscribed to."""
    (subscription,) = (each for each in node.subscriptions
                       if each.topic_name == node.resolve_topic_name(topic))
    subscription.callback(message)
