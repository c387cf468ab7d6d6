# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated surgeon: pedals and `enable`, and a record of all that the slave is commanded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
import threading
import time
from types import TracebackType
from typing import Any

from benchmarks.pipeline.child_process import POLL_PERIOD, wait_until
from benchmarks.sliding_hand import SlidingHand
from geometry_msgs.msg import PoseStamped, QuaternionStamped
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Joy
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, STEER_TOPIC
from spm_haptic_master.ros.qos import EVENTS, SAMPLES, STATE
from spm_haptic_master.timing import SECOND
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger

# Longest wait of the executor (s).
SPIN_TIMEOUT = 0.05
# Time between two messages of a pedal (s).
REPEAT_PERIOD = 0.1
# Longest wait for the answer of a service (s).
ANSWER_TIMEOUT = 10.0
# Longest wait until the nodes have found each other (s).
DISCOVERY_TIMEOUT = 30.0


@dataclass(frozen=True, slots=True)
class Arrived:
    """A pose that has arrived; a busy observer does not change its time of publication."""

    at: int  # time of its publication, ns since the Unix epoch
    stamp: int  # stamp of the message, ns
    quaternion: tuple[float, float, float, float]  # unit quaternion x, y, z, w
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m; of an orientation zero


class Surgeon:
    """
    A node in a thread of its own, with the pedals of one arm; as a context manager it ends.

    `orientations`: it records the master's orientations as well. `watch` is called repeatedly
    while it waits, and ends the wait by raising. `commands`, `poses` and `orientations` are what
    has arrived on `servo_cp`, `slave/measured_cp` and `orientation`; `states` the times of
    arrival, ns, and texts on `teleop_state`.
    """

    def __init__(
        self,
        orientations: bool = False,
        namespace: str = '',
        watch: Callable[[], object] = lambda: None,
    ) -> None:
        self._watch = watch
        self._context = rclpy.Context()
        # The arguments of the program are for others.
        rclpy.init(args=[], context=self._context)
        self._node = Node('surgeon', context=self._context, namespace=namespace)
        # EventsExecutor (rclpy 7.1.6) does not pass on when a message was published.
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.commands: list[Arrived] = []
        self.poses: list[Arrived] = []
        self.orientations: list[Arrived] = []
        self.states: list[tuple[int, str]] = []
        self._record(PoseStamped, 'servo_cp', self.commands)
        self._record(PoseStamped, 'slave/measured_cp', self.poses)
        if orientations:
            self._record(QuaternionStamped, 'orientation', self.orientations)
        self._node.create_subscription(String, 'teleop_state', self._on_state, STATE)
        self._pedals = {
            name: self._node.create_publisher(Joy, name, EVENTS) for name in ('presence', 'clutch')
        }
        self._clients = {
            name: self._node.create_client(Trigger, name) for name in ('enable', 'disable')
        }
        self._fault = self._node.create_publisher(String, FAULT_TOPIC, EVENTS)
        self._steer = self._node.create_publisher(Float64MultiArray, STEER_TOPIC, EVENTS)
        self.hand = SlidingHand(self._node, lambda: not self.state.startswith('disengaged'))
        # Pedals as they are, repeated: one that falls silent is released. The lock keeps a
        # repetition from following a change.
        self._held: dict[str, bool] = {}
        self._pressing = threading.Lock()
        self._repeat_at = 0.0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._spin, name='surgeon')
        self._thread.start()

    def __enter__(self) -> Surgeon:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def state(self) -> str:
        """Return the latest state of the tele-operation; empty before the first."""
        return self.states[-1][1] if self.states else ''

    def press(self, pedal: str, pressed: bool) -> None:
        """Press or release a pedal: 'presence' or 'clutch'."""
        with self._pressing:
            self._held[pedal] = pressed
            self._pedals[pedal].publish(Joy(buttons=[int(pressed)]))

    def inject(self, faults: str) -> None:
        """Set the faults of the simulated encoders; an empty text ends them."""
        self._fault.publish(String(data=faults))

    def steer(self, tilt: float, azimuth: float, phi: float) -> None:
        """Have the simulated handle go to a pose: angles of its axis, rad."""
        self._steer.publish(Float64MultiArray(data=[tilt, azimuth, phi]))

    def enable(self) -> str:
        """Enable the master, and return what it answers; empty without an answer."""
        future = self._clients['enable'].call_async(Trigger.Request())
        self.wait_until(future.done, ANSWER_TIMEOUT)
        return future.result().message if future.done() else ''

    def engage(self, timeout: float = DISCOVERY_TIMEOUT) -> bool:
        """Have the slave follow: presence, and enable until it is taken; False if it never is."""
        end = time.monotonic() + timeout
        self.press('presence', True)
        while time.monotonic() < end:
            if self.enable() == 'ENABLED' and self.await_state('engaged', 0.5):
                return True
            self.press('presence', True)
        return False

    def await_ready(self, timeout: float = DISCOVERY_TIMEOUT) -> bool:
        """Wait until the nodes are there and poses come; False if they do not."""
        return self.wait_until(
            lambda: (
                self.poses
                and self.states
                and all(out.get_subscription_count() for out in self._pedals.values())
                and self._clients['enable'].service_is_ready()
            ),
            timeout,
        )

    def await_state(self, beginning: str, timeout: float) -> bool:
        """Wait for a state of the tele-operation; False if it does not come."""
        return self.wait_until(lambda: self.state.startswith(beginning), timeout)

    def wait_until(self, condition: Callable[[], object], timeout: float) -> bool:
        """Wait until a condition holds; False if it does not within that time, s."""

        def holds() -> object:
            self._watch()
            return condition()

        return wait_until(holds, timeout)

    def sleep(self, seconds: float) -> None:
        """Wait for a time, s."""
        self._watch()
        time.sleep(seconds)

    def await_rest(self, since: Callable[[], int], quiet: float, timeout: float) -> bool:
        """Wait until a count has not grown for a time, s; False if it does not stop."""
        end = time.monotonic() + timeout
        count, unchanged = since(), time.monotonic()
        while time.monotonic() < end:
            time.sleep(POLL_PERIOD)
            if since() != count:
                count, unchanged = since(), time.monotonic()
            elif time.monotonic() - unchanged >= quiet:
                return True
        return False

    def close(self) -> None:
        """Leave the DDS domain."""
        self.hand.close()
        self._end.set()
        self._thread.join()
        self._node.destroy_node()
        self._executor.shutdown()
        with suppress(Exception):
            rclpy.shutdown(context=self._context)

    def _spin(self) -> None:
        while not self._end.is_set():
            self._executor.spin_once(timeout_sec=SPIN_TIMEOUT)
            if time.monotonic() >= self._repeat_at:
                self._repeat_at = time.monotonic() + REPEAT_PERIOD
                self._repeat()

    def _repeat(self) -> None:
        with self._pressing:
            for pedal, pressed in self._held.items():
                self._pedals[pedal].publish(Joy(buttons=[int(pressed)]))

    def _on_state(self, message: String) -> None:
        self.states.append((time.time_ns(), message.data))

    def _record(self, kind: Any, topic: str, into: list[Arrived]) -> None:
        def take(message: Any, info: Mapping[str, int]) -> None:
            stamp = message.header.stamp
            position = 0.0, 0.0, 0.0
            if kind is QuaternionStamped:
                q = message.quaternion
            else:
                q, p = message.pose.orientation, message.pose.position
                position = p.x, p.y, p.z
            into.append(
                Arrived(
                    info['source_timestamp'],
                    stamp.sec * SECOND + stamp.nanosec,
                    (q.x, q.y, q.z, q.w),
                    position,
                )
            )

        callback: Any = take
        self._node.create_subscription(kind, topic, callback, SAMPLES)
