# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated hand that slides the handle along its axis."""

from __future__ import annotations

from collections.abc import Callable
import threading
import time

from rclpy.node import Node
from sensor_msgs.msg import JointState
from spm_haptic_master.ros.qos import SAMPLES

# Time from one sample to the next (s).
PERIOD = 0.01


class SlidingHand:
    """
    Publishes `insertion/measured_js` in a thread of its own, from `begin` on.

    The hand waits while `may_slide` returns False: a surgeon who sees that the slave holds does
    not push on.
    """

    def __init__(self, node: Node, may_slide: Callable[[], bool]) -> None:
        self._node, self._may_slide = node, may_slide
        self._out = node.create_publisher(JointState, 'insertion/measured_js', SAMPLES)
        self._insertion = 0.0  # m
        # Insertion that the hand goes to, m, and how fast, m/s.
        self.goal, self._speed = 0.0, 0.0
        self._is_lost = False
        # Times of publication, ns, and insertions, m.
        self.insertions: list[tuple[int, float]] = []
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def is_there(self) -> bool:
        """Whether the handle is where the hand was to slide it."""
        return self._insertion == self.goal

    def begin(self) -> None:
        """Publish from now on."""
        self._thread = threading.Thread(target=self._run, name='sliding hand')
        self._thread.start()

    def slide_to(self, goal: float, speed: float) -> None:
        """Begin to slide to an insertion, m, at a speed, m/s."""
        self.goal, self._speed = goal, speed

    def lose(self, is_lost: bool) -> None:
        """Lose the encoder of the insertion, or have it back."""
        self._is_lost = is_lost

    def close(self) -> None:
        """End the thread."""
        self._end.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while not self._end.wait(PERIOD):
            if self._may_slide():
                step = self._speed * PERIOD
                ahead = self.goal - self._insertion
                self._insertion = (
                    self.goal
                    if abs(ahead) <= step
                    else self._insertion + (step if ahead > 0.0 else -step)
                )
            if not self._is_lost:
                self._publish()

    def _publish(self) -> None:
        self.insertions.append((time.time_ns(), self._insertion))
        message = JointState(name=['insertion'], position=[self._insertion])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._out.publish(message)
