# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds the publishers on a topic that may have only one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import os
import time

from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo
from spm_haptic_master.exceptions import RivalError
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.diagnostic_status import RIVALS_PERIOD
from spm_haptic_master.timing import Periodic

# What to do about a second publisher.
CURE = 'end one of them, or start it with another ROS_DOMAIN_ID or in another namespace'
# Time for which a process searches for others before it publishes (s): they announce themselves
# every 0.25 s (config/fastdds.xml).
LOOK = 0.5
# Largest time of a round that counts (s): on a busy machine rounds and announcements take longer,
# and so the search does.
LONGEST_ROUND = 0.06
# Longest wait for another publisher to end (s): a process that was killed counts for 20 s, until
# its DDS lease ends.
LONGEST_WAIT = 25.0
# Period of the search (s).
LOOK_PERIOD = 0.05
# Name of a publisher whose node is not known, as rmw has it, and in a message.
UNKNOWN = '_NODE_NAME_UNKNOWN_'
NO_NAME = 'a node without a name'


class Rivals:
    """
    The publishers on some topics of a node's namespace, counted every `RIVALS_PERIOD`.

    Parameters
    ----------
    node : Node
        The node that needs to have one publisher on each.
    *topics : str
        Relative names of the topics.

    """

    def __init__(self, node: Node, *topics: str) -> None:
        self._node = node
        self._topics = tuple(map(node.resolve_topic_name, topics))
        self._count = Periodic(RIVALS_PERIOD)
        self._found: str | None = None

    def found(self) -> str | None:
        """Return on which topic several nodes publish, their names and the cure; None if none."""
        if self._count.is_due(time.monotonic()):
            reasons = map(self._several, self._topics)
            self._found = next(filter(None, reasons), None)
        return self._found

    def _several(self, topic: str) -> str | None:
        """Return the names of the nodes that publish on a topic, and the cure; None of one."""
        # The names are looked up only where there are several.
        if self._node.count_publishers(topic) < 2:
            return None
        names = publishers(self._node, topic)
        if len(names) < 2:
            return None
        return f'{len(names)} publishers on {topic}: {", ".join(names)}; {CURE}'


def wait_until_alone(topics: Mapping[str, str], is_ended: Callable[[], object]) -> None:
    """
    Return once no other process publishes on topics that this one is going to publish on.

    The nodes of this search publish nothing: a second publisher would silence the first.

    Parameters
    ----------
    topics : mapping
        The relative name of each topic, by the name of the node that will publish on it.
    is_ended : callable
        Returns whether the process is to end.

    Raises
    ------
    RivalError
        Another process still publishes after `LONGEST_WAIT`.
    ExternalShutdownException
        The process is to end.

    """
    nodes = [Node(name, enable_rosout=False, start_parameter_services=False) for name in topics]
    try:
        _wait(nodes, list(topics.values()), is_ended)
    finally:
        for node in nodes:
            node.destroy_node()


def _wait(
    nodes: Sequence[Node],
    topics: Sequence[str],
    is_ended: Callable[[], object],
) -> None:
    """Return after `LOOK` without another publisher; errors as `wait_until_alone`."""
    began = time.monotonic()
    passed = 0.0
    searched = 0.0
    taken = ''
    logged = ''
    while taken or searched < LOOK:
        if is_ended():
            raise ExternalShutdownException
        taken = _first_taken(nodes, topics)
        before = passed
        passed = time.monotonic() - began
        searched += min(passed - before, LONGEST_ROUND)
        if taken and passed > LONGEST_WAIT:
            raise RivalError(taken)
        # A node's name is known a moment after its publisher, on a busy machine a second.
        is_named = NO_NAME not in taken or passed > LOOK
        if taken and taken != logged and is_named:
            logged = taken
            node_log.warning(
                nodes[0], f'nothing published: {taken}; waiting {LONGEST_WAIT:g} s for its end'
            )
        time.sleep(LOOK_PERIOD)


def _first_taken(nodes: Sequence[Node], topics: Sequence[str]) -> str:
    """Return which nodes publish on the first topic that is taken, and the cure; empty if none."""
    for node, topic in zip(nodes, topics, strict=True):
        full = node.resolve_topic_name(topic)
        names = publishers(node, full)
        if names:
            domain = os.environ.get('ROS_DOMAIN_ID') or '0'
            listed = ', '.join(names)
            return (
                f'{full} is published by {listed} already: end that one, or start this '
                f'one with another ROS_DOMAIN_ID (now {domain}) or in another namespace'
            )
    return ''


def publishers(node: Node, topic: str) -> tuple[str, ...]:
    """Return the full names of the nodes that publish on a topic, one for each publisher."""
    found = node.get_publishers_info_by_topic(topic)
    return tuple(sorted(map(full_name, found)))


def full_name(publisher: TopicEndpointInfo) -> str:
    """Return the full name of a publisher's node, or words where it is not known."""
    if publisher.node_name == UNKNOWN:
        return NO_NAME
    return f'{publisher.node_namespace.rstrip("/")}/{publisher.node_name}'
