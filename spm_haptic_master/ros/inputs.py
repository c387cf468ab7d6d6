# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Subscriptions: which publishers are heard, which cannot be; the newest message on demand."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
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
from spm_haptic_master.timing import Periodic

MessageType = TypeVar('MessageType')


class Inputs:
    """
    Subscriptions of a node that hear every publisher they can.

    Reliable subscriptions fall back to best effort once a publisher offers only that; latched ones
    do not. Which publisher cannot be heard is in `unheard`.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._inputs: list[_Input] = []
        self._poll = Periodic(RIVALS_PERIOD)
        self._unheard = ''

    def subscribe(
        self,
        kind: type,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile,
        *,
        raw: bool = False,
        gone: Callable[[], None] = lambda: None,
    ) -> None:
        """
        Subscribe to a topic.

        Parameters
        ----------
        kind : type
            Type of the messages.
        topic : str
            Relative name.
        callback : callable
            Gets each message, serialized if `raw`.
        qos : QoSProfile
            Quality of service as long as all publishers offer it.
        raw : bool
            Whether the callback takes serialized messages.
        gone : callable
            Called when a publisher has gone, even if it is back.

        """
        self._inputs.append(
            _Input(
                node=self._node,
                kind=kind,
                topic=topic,
                callback=callback,
                qos=qos,
                raw=raw,
                gone=gone,
            )
        )

    def unheard(self) -> str:
        """Return which publisher is not heard, and why; empty if all are. Polled now and then."""
        if self._poll.is_due(time.monotonic()):
            reasons = (each.unheard() for each in self._inputs)
            self._unheard = next(filter(None, reasons), '')
        return self._unheard


class _Input:
    """One subscription: made again with best effort where a publisher offers only that."""

    def __init__(
        self,
        node: Node,
        kind: type,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile,
        raw: bool,
        gone: Callable[[], None],
    ) -> None:
        self._node = node
        self._kind = kind
        self._topic = node.resolve_topic_name(topic)
        self._callback = callback
        self._qos = qos
        self._raw = raw
        self._gone = gone
        self._is_latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        self._subscribe()

    def _subscribe(self) -> None:
        """Make the subscription with the present quality of service."""
        # Publishers that it hears.
        self._heard = 0
        events = SubscriptionEventCallbacks(matched=self._match, use_default_callbacks=False)
        self._subscription = self._node.create_subscription(
            self._kind,
            self._topic,
            self._callback,
            self._qos,
            raw=self._raw,
            event_callbacks=events,
        )

    def _match(self, change: Any) -> None:
        """Count the publishers that are heard; DDS calls this where they change."""
        self._heard = change.current_count
        if change.total_count_change > change.current_count_change:
            self._gone()

    def unheard(self) -> str:
        """Return which publisher is not heard, and why; empty if all are."""
        if self._node.count_publishers(self._topic) <= self._heard:
            return ''
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        return next(filter(None, map(self._mismatch, publishers)), '')

    def _mismatch(self, publisher: TopicEndpointInfo) -> str:
        """Return why a publisher is not heard, or become best-effort for it."""
        package, _, _ = self._kind.__module__.partition('.')
        expected = f'{package}/msg/{self._kind.__name__}'
        offered = publisher.qos_profile
        is_best_effort = offered.reliability == ReliabilityPolicy.BEST_EFFORT
        reason = ''
        if publisher.topic_type != expected:
            reason = f'{publisher.topic_type}, expected {expected}'
        elif is_best_effort and self._qos.reliability != ReliabilityPolicy.BEST_EFFORT:
            if self._is_latched:
                reason = 'BEST_EFFORT, expected RELIABLE'
            else:
                self._fall_back_to_best_effort()
        elif self._is_latched and offered.durability == DurabilityPolicy.VOLATILE:
            reason = 'VOLATILE, expected TRANSIENT_LOCAL'
        if not reason:
            return ''
        return f'publisher {full_name(publisher)} on {self._topic} is {reason}'

    def _fall_back_to_best_effort(self) -> None:
        """Subscribe again, without asking for lost messages."""
        self._qos = copy(self._qos)
        self._qos.reliability = ReliabilityPolicy.BEST_EFFORT
        self._node.destroy_subscription(self._subscription)
        self._subscribe()


class SampledTopic(Generic[MessageType]):
    """
    The newest message of a topic, taken on demand: its node is in no executor.

    Parameters
    ----------
    taker : Node
        A node that no executor spins.
    kind : type
        Type of the messages.
    topic : str
        Name of the topic.

    """

    def __init__(
        self,
        taker: Node,
        kind: type[MessageType],
        topic: str,
    ) -> None:
        self._taker = taker
        self._kind = kind
        self._topic = topic
        self._subscription: Subscription | None = None

    def subscribe(self) -> None:
        """Subscribe, if that has not been done."""
        if self._subscription is None:
            # No executor ever calls it back.
            self._subscription = self._taker.create_subscription(
                self._kind, self._topic, lambda _: None, DISPLAY, raw=True
            )

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
        if taken is None:
            return None
        message: MessageType = deserialize_message(taken[0], self._kind)
        return message
