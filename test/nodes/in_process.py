# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes of the test's own process, which get their messages and their time by plain calls."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
import os
import signal
import sys
import time
from types import SimpleNamespace
from unittest import mock

from benchmarks.pipeline.child_process import private_environment
import rclpy
from rclpy.node import Node
from rclpy.qos import qos_check_compatible, QoSCompatibility
from rclpy.serialization import deserialize_message, serialize_message
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros.parameters import ParameterNode

# A start that no stamp of a real clock has (ns).
EPOCH = 1_800_000_000_000_000_000


def exit_code(main: Callable, *arguments: str) -> int:
    """Run a program in this process; return its exit code."""
    before = {
        number: signal.getsignal(number)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    }
    try:
        with mock.patch.dict(os.environ):
            return main([*arguments])
    except SystemExit as end:
        return end.code
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def ros(*remaps: str) -> Iterator[None]:
    """Have rclpy in this process, in the domain of the run and with names such as '__ns:=/a'."""
    rclpy.init(
        args=['--ros-args', *(word for each in remaps for word in ('-r', each))],
        domain_id=int(private_environment()['ROS_DOMAIN_ID']),
    )
    try:
        yield
    finally:
        rclpy.try_shutdown()


class Messages(list):
    """Serialized messages and their types, read where they are looked at: few of them are."""

    def __getitem__(self, index):
        found = super().__getitem__(index)
        return [*map(_read, found)] if isinstance(index, slice) else _read(found)

    def __iter__(self):
        return map(_read, super().__iter__())


def _read(entry: tuple[object, type | None]) -> object:
    data, kind = entry
    return data if kind is None else deserialize_message(data, kind)


class Queue(list):
    """Messages that wait at a subscription, each with the time of its publication, ns."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def take_message(self, kind, raw):
        if not self:
            return None
        message, published = self.pop(0)
        return message, {'source_timestamp': published}


class Hosted:
    """
    Nodes, all that they publish, and the time, which stands still between calls.

    `sent` has the messages by topic, as it is in the code, and `times` when they were published
    (s of `monotonic`); the nodes receive them from each other.
    Each topic has one publisher, but for those of `publishers`: names of nodes by full topic.
    `subscribed` decides for a topic whether it has subscribers.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.sent: dict[str, Messages] = defaultdict(Messages)
        self.times: dict[str, list[float]] = defaultdict(list)
        self.publishers: dict[str, tuple[str, ...]] = {}
        self.subscribed: Callable[[str], bool] = lambda topic: True
        # What DDS calls where the publishers of a full topic change.
        self.matched: dict[str, Callable] = {}
        # Subscriptions to messages without type support, by topic: callbacks, and what waits.
        self.callbacks: dict[str, Callable] = {}
        self.queues: dict[str, list[Queue]] = defaultdict(list)
        self._passed = 0
        self._due: dict[object, int] = {}

    @property
    def node(self) -> Node:
        """Return the first node."""
        return self.nodes[0]

    # Time of the nodes, in place of the module `time`
    def monotonic(self) -> float:
        return 1e-9 * self._passed + 1000.0

    def time_ns(self) -> int:
        return EPOCH + self._passed

    def time(self) -> float:
        return 1e-9 * self.time_ns()

    def pause(self, seconds: float) -> None:
        """Let the time pass while the process does not run."""
        self._passed += round(seconds * 1e9)

    sleep = pause

    def run(self, seconds: float) -> None:
        """Let the time pass, with the timers of the nodes."""
        end = self._passed + round(seconds * 1e9)
        while True:
            for timer in (timer for node in self.nodes for timer in node.timers):
                self._due.setdefault(timer, self._passed + timer.timer_period_ns)
            timer, due = min(self._due.items(), key=lambda each: each[1], default=(None, end + 1))
            if due > end:
                break
            self._passed = max(self._passed, due)
            self._due[timer] = self._passed + timer.timer_period_ns
            timer.callback()
        self._passed = end

    def give(self, topic: str, message: object) -> None:
        """Deliver a message on a topic, of the first node's names, to its subscribers."""
        assert self._deliver(self.node.resolve_topic_name(topic), message)

    def _deliver(self, name: str, message: object) -> int:
        found = [
            each for node in self.nodes for each in node.subscriptions if each.topic_name == name
        ]
        for each in found:
            is_raw = isinstance(message, bytes)
            each.callback(
                message
                if is_raw is each.raw
                else serialize_message(message)
                if each.raw
                else deserialize_message(message, each.msg_type)
            )
        return len(found)

    def check_qos(self) -> None:
        """Check that DDS would connect all publishers of a topic with its subscriptions."""
        for out in (each for node in self.nodes for each in node.publishers):
            for each in (each for node in self.nodes for each in node.subscriptions):
                if each.topic_name == out.topic_name:
                    found, reason = qos_check_compatible(out.qos_profile, each.qos_profile)
                    assert found != QoSCompatibility.ERROR, (out.topic_name, reason)

    def restart_publisher(self, topic: str) -> None:
        """Have DDS report that another publisher has taken the place of the one of a topic."""
        self.matched[self.node.resolve_topic_name(topic)](
            SimpleNamespace(
                current_count=1,
                current_count_change=0,
                total_count_change=1,
            )
        )

    def call(self, name: str) -> object:
        """Call a service of the node that takes no arguments, by its name in the code."""
        (service,) = (
            each for node in self.nodes for each in node.services if each.srv_name == name
        )
        return service.callback(service.srv_type.Request(), service.srv_type.Response())

    def last(self, topic: str) -> object:
        """Return the latest message on a topic; None without one."""
        return self.sent[topic][-1] if self.sent[topic] else None

    def entry(self, aspect: str) -> object:
        """Return the latest entry of an aspect on /diagnostics; None without one."""
        arrays = self.sent['/diagnostics']
        return next(
            (
                status
                for index in reversed(range(len(arrays)))
                for status in arrays[index].status
                if status.name.endswith(f': {aspect}')
            ),
            None,
        )

    def figures(self, aspect: str) -> dict[str, str]:
        """Return keys and values of that entry."""
        return {each.key: each.value for each in self.entry(aspect).values}

    def _create_publisher(self, create: Callable) -> Callable:
        def created(node, kind, topic, *args, **options):
            is_real = hasattr(kind, 'get_fields_and_field_types')
            out = create(node, kind, topic, *args, **options) if is_real else SimpleNamespace()

            def publish(message):
                self.times[topic].append(self.monotonic())
                # A copy: nodes use their messages again.
                self.sent[topic].append(
                    (deepcopy(message), None)
                    if not is_real
                    else (
                        message if isinstance(message, bytes) else serialize_message(message),
                        kind,
                    )
                )
                if is_real:
                    self._deliver(out.topic_name, message)

            out.publish = publish
            out.wait_for_all_acked = lambda timeout: None
            out.get_subscription_count = lambda: int(self.subscribed(topic))
            return out

        return created

    def _create_subscription(self, create: Callable) -> Callable:
        def created(node, kind, topic, callback, *args, event_callbacks=None, **options):
            if not hasattr(kind, 'get_fields_and_field_types'):
                self.callbacks[topic] = callback
                self.queues[topic].append(Queue())
                return SimpleNamespace(handle=self.queues[topic][-1], msg_type=kind)
            if event_callbacks is not None:
                self.matched[topic] = event_callbacks.matched
                event_callbacks.matched(
                    SimpleNamespace(
                        current_count=1,
                        current_count_change=1,
                        total_count_change=1,
                    )
                )
            return create(
                node, kind, topic, callback, *args, event_callbacks=event_callbacks, **options
            )

        return created

    def _infos(self, topic: str) -> list[SimpleNamespace]:
        return [
            SimpleNamespace(
                node_name=name, node_namespace='/', endpoint_gid=f'{name:12.12}{topic}'.encode()
            )
            for name in self.publishers.get(topic, ('other',))
        ]


@contextmanager
def hosted(
    make: Callable, *settings: str, remaps: Sequence[str] = (), subscribes: bool = False
) -> Iterator[Hosted]:
    """
    Yield what `make` returns for parameters such as 'rate:=200.0': a node, or a list of them.

    With `subscribes` they take their samples or orientations from the topics.
    """
    host = Hosted()
    modules = [
        module
        for name, module in sys.modules.items()
        if name.startswith('spm_haptic_master') and getattr(module, 'time', None) is time
    ]
    with (
        mock.patch.object(Node, 'create_publisher', host._create_publisher(Node.create_publisher)),
        mock.patch.object(
            Node, 'create_subscription', host._create_subscription(Node.create_subscription)
        ),
        ros(*remaps),
    ):
        for module in modules:
            module.time = host
        try:
            made = make(Parameters(arguments=list(settings), remaps=remaps))
            host.nodes += made if isinstance(made, list) else [made]
            for node in host.nodes:
                if isinstance(node, ParameterNode):
                    node.check_live_settings()
                node.count_publishers = lambda topic: len(host._infos(topic))
                node.get_publishers_info_by_topic = host._infos
                if subscribes:
                    node.subscribe()
            yield host
            host.check_qos()
            for node in reversed(host.nodes):
                node.destroy_node()
                assert not [*node.publishers, *node.subscriptions, *node.timers]
        finally:
            for module in modules:
                module.time = time
