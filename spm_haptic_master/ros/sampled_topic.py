# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A topic of which the newest message is taken when it is needed, and no other one costs time."""

from __future__ import annotations

from typing import Generic, TypeVar

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

# QoS of what is only displayed: the newest message, and no acknowledgement that a publisher or
# its other subscribers would ever wait for.
DISPLAY = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

MessageType = TypeVar('MessageType')


class SampledTopic(Generic[MessageType]):
    """A subscription of a node in no executor; not subscribed to until that is asked for."""

    def __init__(self, taker: Node, kind: type[MessageType], topic: str) -> None:
        self._taker, self._kind, self._topic = taker, kind, topic
        self._subscription: Subscription | None = None

    def subscribe(self) -> None:
        """Subscribe, if that has not been done."""
        if self._subscription is None:
            # No executor ever calls it back.
            self._subscription = self._taker.create_subscription(
                self._kind, self._topic, lambda _: None, DISPLAY, raw=True)

    def unsubscribe(self) -> None:
        """End the subscription, if there is one."""
        if self._subscription is not None:
            self._taker.destroy_subscription(self._subscription)
            self._subscription = None

    def take(self) -> MessageType | None:
        """Return the newest message that has not been taken, None without one."""
        if self._subscription is None:
            return None
        with self._subscription.handle:
            taken = self._subscription.handle.take_message(self._subscription.msg_type, True)
        return None if taken is None else deserialize_message(taken[0], self._kind)
