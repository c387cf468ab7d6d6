# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node of the test's own process, which gets its messages by plain calls."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import threading

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from spm_haptic_master.benchmark.child_process import private_environment


@contextmanager
def ros(namespace: str = '/') -> Iterator[None]:
    """Have rclpy in this process, in the domain of the run and in a namespace."""
    rclpy.init(args=['--ros-args', '-r', f'__ns:={namespace}'],
               domain_id=int(private_environment()['ROS_DOMAIN_ID']))
    try:
        yield
    finally:
        rclpy.try_shutdown()


@contextmanager
def spinning(node: Node) -> Iterator[None]:
    """Have a node work in a thread of its own, and destroy it."""
    executor, ended = EventsExecutor(), threading.Event()
    executor.add_node(node)

    def spin():
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.01)

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        executor.shutdown()
        node.destroy_node()


def deliver(node: Node, topic: str, message: object) -> None:
    """Give a node a message on a topic that it has subscribed to."""
    (subscription,) = (each for each in node.subscriptions
                       if each.topic_name == node.resolve_topic_name(topic))
    subscription.callback(message)
