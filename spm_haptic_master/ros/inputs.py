# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Subscriptions: which publishers are heard, which cannot be; the newest message on demand."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
import time
from typing import Any, Generic, TypeVar

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from spm_haptic_master.ros.diagnostic_status import RIVALS_PERIOD
from spm_haptic_master.ros.duplicate_publishers import full_name
from spm_haptic_master.ros.qos import DISPLAY

MessageType = TypeVar('MessageType')


@dataclass(slots=True)
class Input:
    """One subscription."""

    kind: type  # type of the messages
    topic: str  # full name
    callback: Callable[[Any], None]  # takes each message
    qos: QoSProfile  # what it asks for
    hears_both: bool  # whether it becomes best-effort where a publisher is
    raw: bool  # whether the messages are serialized
    gone: Callable[[], None] | None  # called where a publisher has gone, even if it is back
    subscription: Subscription | None = None
    heard: int = 0  # publishers that it hears

    def mismatch(self, publisher: TopicEndpointInfo) -> str:
        """Return what of a publisher differs, with what is expected; empty if it is heard."""
        expected = f'{self.kind.__module__.partition(".")[0]}/msg/{self.kind.__name__}'
        if publisher.topic_type != expected:
            return f'{publisher.topic_type}, expected {expected}'
        offered = publisher.qos_profile
        if self.qos.reliability == ReliabilityPolicy.RELIABLE \
                and offered.reliability == ReliabilityPolicy.BEST_EFFORT:
            return 'BEST_EFFORT, expected RELIABLE'
        if self.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL \
                and offered.durability == DurabilityPolicy.VOLATILE:
            return 'VOLATILE, expected TRANSIENT_LOCAL'
        return ''


class Inputs:
    """Subscriptions of a node that are reliable until a publisher is not."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._inputs: list[Input] = []
        self._poll_at = 0.0
        self._unheard = ''

    def subscribe(self, kind: type, topic: str, callback: Callable[[Any], None], qos: QoSProfile,
                  *, hears_both: bool = False, raw: bool = False,
                  gone: Callable[[], None] | None = None) -> None:
        """Subscribe; see `Input`."""
        found = Input(kind, self._node.resolve_topic_name(topic), callback, qos, hears_both, raw,
                      gone)
        self._inputs.append(found)
        self._make(found)

    def unheard(self) -> str:
        """Return which publisher is not heard, and why; empty if all are. Polled now and then."""
        now = time.monotonic()
        if now >= self._poll_at:
            self._poll_at = now + RIVALS_PERIOD
            self._unheard = next(filter(None, map(self._check, self._inputs)), '')
        return self._unheard

    def _check(self, found: Input) -> str:
        if self._node.count_publishers(found.topic) <= found.heard:
            return ''
        for publisher in self._node.get_publishers_info_by_topic(found.topic):
            mismatch = found.mismatch(publisher)
            if not mismatch:
                continue
            if found.hears_both and publisher.qos_profile.reliability \
                    == ReliabilityPolicy.BEST_EFFORT != found.qos.reliability:
                found.qos = copy(found.qos)
                found.qos.reliability = ReliabilityPolicy.BEST_EFFORT
                self._make(found)
                return ''
            return f'publisher {full_name(publisher)} on {found.topic} is {mismatch}'
        return ''

    def _make(self, found: Input) -> None:
        if found.subscription is not None:
            self._node.destroy_subscription(found.subscription)
        found.heard = 0

        def match(change: Any) -> None:
            found.heard = change.current_count
            if found.gone is not None and change.total_count_change > change.current_count_change:
                found.gone()

        found.subscription = self._node.create_subscription(
            found.kind, found.topic, found.callback, found.qos, raw=found.raw,
            event_callbacks=SubscriptionEventCallbacks(
                matched=match, use_default_callbacks=False))


class SampledTopic(Generic[MessageType]):
    """
    A topic of which the newest message is taken when it is needed, and no other one costs time.

    Its node is in no executor; it is not subscribed to until that is asked for.
    """

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
