# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which publishers an input hears, which it names, and when one of them has gone."""

from itertools import count

from benchmarks.pipeline import child_process
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from spm_haptic_master.ros import duplicate_publishers, inputs
from spm_haptic_master.ros.inputs import Inputs, SampledTopic
from spm_haptic_master.ros.qos import EVENTS, STATE
from std_msgs.msg import Bool, String

# Time that a busy machine may need (s).
PATIENCE = 20.0
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
VOLATILE = QoSProfile(depth=1, durability=DurabilityPolicy.VOLATILE)


@pytest.fixture
def rig(monkeypatch):
    """Give a node with inputs, one of another process, and what spins until a condition holds."""
    monkeypatch.setattr(inputs, 'RIVALS_PERIOD', 0.0)
    monkeypatch.setattr(duplicate_publishers, 'RIVALS_PERIOD', 0.0)
    monkeypatch.setattr(child_process, 'POLL_PERIOD', 0.005)
    nodes = []
    for name, namespace in ('listener', '/left'), ('other', ''):
        context = rclpy.Context()
        rclpy.init(context=context)
        nodes.append(rclpy.create_node(name, namespace=namespace, context=context))
    executor = SingleThreadedExecutor(context=nodes[0].context)
    executor.add_node(nodes[0])

    yield (
        *nodes,
        lambda condition: child_process.wait_until(
            lambda: executor.spin_once(timeout_sec=0.01) or condition(), PATIENCE
        ),
    )
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
        node.context.try_shutdown()


@pytest.mark.parametrize(
    ('wanted', 'kind', 'offered', 'reason'),
    [
        (STATE, String, BEST_EFFORT, 'BEST_EFFORT, expected RELIABLE'),
        (STATE, String, VOLATILE, 'VOLATILE, expected TRANSIENT_LOCAL'),
        (EVENTS, Bool, EVENTS, 'std_msgs/msg/Bool, expected std_msgs/msg/String'),
    ],
)
def test_a_publisher_that_is_not_heard_is_named_with_the_reason(
    rig, wanted, kind, offered, reason
):
    node, other, spin_until = rig
    found = Inputs(node)
    found.subscribe(String, 'topic', pytest.fail, wanted)
    assert found.unheard() == ''
    other.create_publisher(kind, '/left/topic', offered)
    line = f'publisher /other on /left/topic is {reason}'
    assert spin_until(lambda: found.unheard() == line), found.unheard()


@pytest.mark.parametrize('raw', [False, True])
@pytest.mark.parametrize(
    ('wanted', 'offered'),
    [
        (EVENTS, EVENTS),
        (EVENTS, STATE),
        (BEST_EFFORT, EVENTS),
        (EVENTS, BEST_EFFORT),
    ],
)
def test_an_input_follows_a_publisher_and_reports_when_it_has_gone(rig, wanted, offered, raw):
    node, other, spin_until = rig
    heard = []
    gone = []
    found = Inputs(node)
    found.subscribe(
        String,
        'topic',
        heard.append,
        wanted,
        raw=raw,
        gone=lambda: gone.append(1),
    )
    out = other.create_publisher(String, '/left/topic', offered)
    message = String(data='a')
    assert spin_until(lambda: found.unheard() or out.publish(message) or heard)
    assert heard[0] == (serialize_message(message) if raw else message)
    assert EVENTS.reliability == ReliabilityPolicy.RELIABLE
    assert gone == []
    other.destroy_publisher(out)
    assert spin_until(lambda: gone)
    # One of another type stays unheard.
    other.create_publisher(Bool, '/left/topic', EVENTS)
    assert spin_until(lambda: 'is std_msgs/msg/Bool' in found.unheard())


def test_a_late_subscriber_gets_the_newest_state_alone(rig):
    node, other, spin_until = rig
    out = other.create_publisher(String, '/left/topic', STATE)
    heard = []
    for text in 'ab':
        out.publish(String(data=text))
    Inputs(node).subscribe(
        String,
        'topic',
        heard.append,
        QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    )
    assert spin_until(lambda: heard)
    assert heard[0] == String(data='b')


def test_several_publishers_on_one_topic_are_named(rig):
    node, other, spin_until = rig
    found = duplicate_publishers.Rivals(node, 'free', 'topic')
    node.create_publisher(String, 'topic', EVENTS)
    assert spin_until(lambda: node.count_publishers('/left/topic') == 1)
    assert found.found() is None
    other.create_publisher(String, '/left/topic', EVENTS)
    # The name of a node is known a moment after its publisher.
    assert spin_until(
        lambda: (
            found.found()
            == (
                f'2 publishers on /left/topic: /left/listener, /other; {duplicate_publishers.CURE}'
            )
        )
    ), found.found()


def test_the_newest_message_is_taken_and_no_other(rig):
    node, other, _ = rig
    topic = SampledTopic(node, String, 'shown')
    assert topic.take() is None
    out = other.create_publisher(String, '/left/shown', EVENTS)
    for _ in range(2):
        topic.subscribe()
    assert child_process.wait_until(lambda: out.get_subscription_count() == 1, PATIENCE)
    sent = count()

    def is_newest_taken():
        # The publisher may know the subscription before it is known by it: a message is lost then.
        for _ in range(3):
            text = str(next(sent))
            out.publish(String(data=text))
        return topic.take() == String(data=text)

    assert child_process.wait_until(is_newest_taken, PATIENCE)
    assert topic.take() is None
    for _ in range(2):
        topic.unsubscribe()
    assert child_process.wait_until(lambda: out.get_subscription_count() == 0, PATIENCE)
    assert topic.take() is None
