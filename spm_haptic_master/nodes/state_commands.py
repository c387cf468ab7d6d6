# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The commands of CRTK clients, of those that latch them and of those that do not.

A client of CRTK latches one `enable` at its start, which a volatile subscription misses where the
client was there first; a latched subscription does not hear clients that do not latch. Here are
both, and each command counts once. A latched command is delivered whenever publisher and
subscription meet, however old it is, so that its age decides.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import time
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.diagnostic_status import STEADY
from spm_haptic_master.ros.qos import EVENTS, STATE
from spm_haptic_master.timing import SECOND

TOPIC = 'state_command'
# Period at which commands are taken (s).
POLL_PERIOD = 0.01
# Age, by the publisher's clock, at which a command is too old (s).
OLDEST = 1.0
# Number of commands that are remembered, so that none counts twice.
REMEMBERED = 100


class StateCommands:
    """
    Takes the commands of a topic.

    Parameters
    ----------
    node
        Node that owns the name of the topic and the timer.
    kind
        Type of the messages.
    text_of
        Returns the command of a message.
    execute
        Called with each command.

    """

    def __init__(
        self,
        node: Node,
        kind: type,
        text_of: Callable[[Any], str],
        execute: Callable[[str], object],
    ) -> None:
        self._node = node
        self._text_of = text_of
        self._execute = execute
        # In no executor: EventsExecutor (rclpy 7.1.6) does not pass on when a message was sent.
        self._taker = Node(
            f'{node.get_name()}_commands',
            context=node.context,
            namespace=node.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        topic = node.resolve_topic_name(TOPIC)
        self._subscriptions: list[Subscription] = [
            self._taker.create_subscription(kind, topic, lambda _: None, qos)
            for qos in (EVENTS, STATE)
        ]
        # Times of publication, ns, and texts of the last commands.
        self._seen: deque[tuple[int, str]] = deque(maxlen=REMEMBERED)
        node.create_timer(POLL_PERIOD, self.poll, clock=STEADY)

    def poll(self) -> None:
        """Execute what has come since the last call."""
        for subscription in self._subscriptions:
            handle = subscription.handle
            with handle:
                while taken := handle.take_message(subscription.msg_type, False):
                    message, info = taken
                    self._take(self._text_of(message), info['source_timestamp'])

    def close(self) -> None:
        """End the subscriptions."""
        self._taker.destroy_node()

    def _take(self, text: str, published: int) -> None:
        """Execute a command published at a time, ns, unless it is old or known."""
        if (published, text) in self._seen:
            return
        self._seen.append((published, text))
        age = (time.time_ns() - published) / SECOND
        if age > OLDEST:
            node_log.warning(
                self._node,
                f'{TOPIC} {text!r} ignored: it is {age:.0f} s old, expected {OLDEST:g} s or less',
            )
            return
        self._execute(text)
