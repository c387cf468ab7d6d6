# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds the publishers on a topic that may have only one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
UNKNOWN, NO_NAME = '_NODE_NAME_UNKNOWN_', 'a node without a name'


class Rivals:
    """The publishers on some topics of a node's namespace, counted every `RIVALS_PERIOD`."""

    def __init__(self, node: Node, *topics: str) -> None:
        self._node = node
        self._topics = tuple(map(node.resolve_topic_name, topics))
        self._count = Periodic(RIVALS_PERIOD)
        self._found: str | None = None

    def found(self) -> str | None:
        """Return on which topic several nodes publish, their names and the cure; None if none."""
        if self._count.is_due(time.monotonic()):
            self._found = next(filter(None, map(self._several, self._topics)), None)
        return self._found

    def _several(self, topic: str) -> str | None:
        # The names are looked up only where there are several.
        if self._node.count_publishers(topic) < 2:
            return None
        names = publishers(self._node, topic)
        return (
            f'{len(names)} publishers on {topic}: {", ".join(names)}; {CURE}'
            if len(names) > 1
            else None
        )


def wait_until_alone(topics: Mapping[str, str], is_ended: Callable[[], object]) -> None:
    """
    Return once no other process publishes on topics that this one is going to publish on.

    `topics` has the relative name of each by the name of the node that will publish on it. The
    nodes of this search publish nothing: a second publisher would silence the first. RivalError
    after `LONGEST_WAIT`; ExternalShutdownException where the process is to end.
    """
    nodes = [Node(name, enable_rosout=False, start_parameter_services=False) for name in topics]
    try:
        looked = [
            (node, node.resolve_topic_name(topic))
            for node, topic in zip(nodes, topics.values(), strict=True)
        ]
        began = time.monotonic()
        passed, looked_for, taken, logged = 0.0, 0.0, '', ''
        while taken or looked_for < LOOK:
            if is_ended():
                raise ExternalShutdownException
            taken = next(filter(None, (_taken(*each) for each in looked)), '')
            last, passed = passed, time.monotonic() - began
            looked_for += min(passed - last, LONGEST_ROUND)
            if taken and passed > LONGEST_WAIT:
                raise RivalError(taken)
            # A node's name is known a moment after its publisher, on a busy machine a second.
            if taken not in ('', logged) and (NO_NAME not in taken or passed > LOOK):
                logged = taken
                node_log.warning(
                    nodes[0], f'nothing published: {taken}; waiting {LONGEST_WAIT:g} s for its end'
                )
            time.sleep(LOOK_PERIOD)
    finally:
        for node in nodes:
            node.destroy_node()


def _taken(node: Node, topic: str) -> str:
    """Return which nodes publish on a topic, and the cure; empty if none does."""
    names, domain = ', '.join(publishers(node, topic)), os.environ.get('ROS_DOMAIN_ID') or '0'
    return (
        names
        and f'{topic} is published by {names} already: end that one, or start this '
        f'one with another ROS_DOMAIN_ID (now {domain}) or in another namespace'
    )


def publishers(node: Node, topic: str) -> tuple[str, ...]:
    """Return the full names of the nodes that publish on a topic, one for each publisher."""
    return tuple(sorted(map(full_name, node.get_publishers_info_by_topic(topic))))


def full_name(publisher: TopicEndpointInfo) -> str:
    """Return the full name of a publisher's node, or words where it is not known."""
    return (
        NO_NAME
        if publisher.node_name == UNKNOWN
        else f'{publisher.node_namespace.rstrip("/")}/{publisher.node_name}'
    )
