# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What others command of the force feedback: wrenches, modes, and whether it is engaged."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isfinite, nan
import threading
import time
from typing import NamedTuple

from geometry_msgs.msg import Quaternion as QuaternionMessage
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from spm_haptic_master.force import Wrench
from spm_haptic_master.kinematics.mounting import IDENTITY, Mounting
from spm_haptic_master.kinematics.number_backends import Quaternion, Rotation
from spm_haptic_master.kinematics.rotations import conjugate, rotation_from_quaternion
from spm_haptic_master.kinematics.vectors import times
from spm_haptic_master.parameters.fkm import BY_TELEOP
from spm_haptic_master.parameters.geometry import mounting_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.diagnostic_status import RIVALS_PERIOD
from spm_haptic_master.ros.duplicate_publishers import publishers
from spm_haptic_master.ros.inputs import Inputs
from spm_haptic_master.ros.qos import EVENTS, STATE, WRENCHES
from spm_haptic_master.teleoperation.command_limits import unit_quaternion
from spm_haptic_master.teleoperation.conditions import NO_PRESENCE
from spm_haptic_master.teleoperation.engaging import Phase
from spm_haptic_master.timing import SECOND
from std_msgs.msg import Bool, Empty, Float64, String

# Topics of wrenches.
WRENCH_TOPICS = ('servo_cf', 'spatial/servo_cf', 'body/servo_cf')
# Time after which a `teleop_state` is nobody's (s): it is repeated every 0.2 s.
TELEOP_TIMEOUT = 0.6
# Its words where a hand is missing.
ABSENT = f'{Phase.DISENGAGED.value}: {NO_PRESENCE}'


class WrenchFrame(NamedTuple):
    """A frame of torques on the handle."""

    name: str  # frame_id
    in_handle: bool  # turns with the platform; else in the base frame
    rotation: Rotation[float]  # R_platform_frame or R_base_frame


class WrenchFrames:
    """
    The frames of a device; `reference` is that of `orientation`.

    It is the table's where the base is mounted on it, or else the base's.
    """

    def __init__(self, values: Values, reference: str) -> None:
        mounting = mounting_from(values) or Mounting()
        base, platform, handle = (
            values[name]
            for name in ('frame_id', 'mounting.platform_frame_id', 'mounting.handle_frame_id')
        )
        same = rotation_from_quaternion(*IDENTITY)
        is_mounted = tuple(map(abs, mounting.handle)) != IDENTITY
        # Components in the table's frame to those in the base's: R_table_base^T.
        self.spatial = WrenchFrame(
            reference, False, rotation_from_quaternion(*conjugate(mounting.base))
        )
        self.body = WrenchFrame(
            handle if is_mounted else platform, True, rotation_from_quaternion(*mounting.handle)
        )
        # CRTK clients leave the frame of a header empty: it is that of `orientation`.
        self.by_name = {
            base: WrenchFrame(base, False, same),
            platform: WrenchFrame(platform, True, same),
            '': self.spatial,
            reference: self.spatial,
            handle: self.body._replace(name=handle),
        }


class ForceInputs:
    """
    Subscriptions of the force feedback, and their latest content.

    `now` returns the time on the clock of the samples, ns, `orientation` the latest
    R_base_platform, or None. `lock` guards what samples take: it is held by the caller of `take`.
    """

    def __init__(
        self,
        node: Node,
        values: Values,
        frames: WrenchFrames,
        now: Callable[[], int],
        orientation: Callable[[], Quaternion[float] | None],
        lock: threading.Lock,
    ) -> None:
        self._node, self._frames, self._now, self._lock = node, frames, now, lock
        self._mounting = mounting_from(values) or Mounting()
        self._longest = values['force.wrench_timeout']
        self._timeout = round(self._longest * SECOND)
        # When this process last polled, s, monotonic, and whether that was late.
        self._polled_at, self._was_late = 0.0, True
        self._wrench: Wrench | None = None
        # One that is not finite, until a sample has taken it.
        self._faulty: Wrench | None = None
        self._scale, self._is_absolute, self._warned = 1.0, False, False
        # State of the tele-operation, disengaged where its topic is silent; whether no hand is on
        # the handle; the locked R_base_platform; whether the weight is compensated; nodes that
        # send wrenches, or publishers on one topic if these are more.
        self.phase, self.is_absent, self._phase_at = Phase.DISENGAGED, False, 0.0
        self.target: Quaternion[float] | None = None
        self.weightless = True
        self.sources, self._count_at = 0, 0.0
        self._unknown = self._unheard = self._several = ''
        # Wrenches that were too old, and in an unknown frame.
        self.stale = self.refused = 0
        self._topics = tuple(map(node.resolve_topic_name, WRENCH_TOPICS))
        self._inputs = Inputs(node)
        wrench = partial(self._inputs.subscribe, WrenchStamped, qos=WRENCHES)
        wrench(topic='servo_cf', callback=self._on_any)
        wrench(
            topic='spatial/servo_cf',
            callback=lambda message: self._take_wrench(message, frames.spatial),
        )
        wrench(
            topic='body/servo_cf',
            callback=lambda message: self._take_wrench(
                message, frames.spatial if self._is_absolute else frames.body
            ),
        )
        event = partial(self._inputs.subscribe, qos=EVENTS)
        event(
            Bool,
            'body/set_cf_orientation_absolute',
            lambda message: setattr(self, '_is_absolute', message.data),
        )
        event(
            Bool,
            'use_gravity_compensation',
            lambda message: setattr(self, 'weightless', message.data),
        )
        event(Float64, 'force_scale', self._on_scale)
        event(QuaternionMessage, 'lock_orientation', self._on_lock)
        event(Empty, 'unlock_orientation', lambda _: setattr(self, 'target', None))
        event(Empty, 'hold', lambda _: setattr(self, 'target', orientation()))
        event(Empty, 'free', self._on_free)
        if values['force.engaged_by'] == BY_TELEOP:
            self._inputs.subscribe(String, 'teleop_state', self._on_teleop, STATE)

    def take(self) -> Wrench | None:
        """Return the latest wrench, for a sample; the caller holds the lock."""
        if self._faulty is not None:
            self._wrench, self._faulty = self._faulty, None
        return self._wrench

    def age(self) -> float | None:
        """Return the age of the latest wrench, s; None before the first."""
        wrench = self._wrench
        return None if wrench is None else (self._now() - wrench.received) / SECOND

    @property
    def caution(self) -> str:
        """Return which input is not heard, not understood or not alone; empty if none."""
        return self._several or self._unheard or self._unknown

    def poll(self) -> None:
        """Notice who publishes, and what does not come any more: call it all the time."""
        now = time.monotonic()
        self._was_late = now - self._polled_at > self._longest
        self._polled_at = now
        if now - self._phase_at > TELEOP_TIMEOUT:
            self.phase, self.is_absent = Phase.DISENGAGED, False
        if now < self._count_at:
            return
        self._count_at = now + RIVALS_PERIOD
        self._unheard = self._inputs.unheard()
        # The nodes that publish wrenches: one may do so on all topics, as in CRTK.
        counts = [self._node.count_publishers(topic) for topic in self._topics]
        self.sources, self._several = sum(counts), ''
        if self.sources > 1:
            names = [publishers(self._node, topic) for topic in self._topics]
            found = sorted({name for each in names for name in each})
            self.sources = max(len(found), *map(len, names))
            if self.sources > 1:
                self._several = f'wrenches from {", ".join(found)}; expected one node'

    # Wrenches -----------------------------------------------------------------------------------

    def _on_any(self, message: WrenchStamped) -> None:
        name = message.header.frame_id
        frame = self._frames.by_name.get(name)
        if frame is None:
            self.refused += 1
            if not self._unknown:
                self._unknown = (
                    f'wrench on {self._topics[0]} in frame {name!r}; expected '
                    f'{", ".join(sorted(filter(None, self._frames.by_name)))} or none'
                )
                node_log.error(self._node, self._unknown)
            return
        self._take_wrench(message, frame)

    def _take_wrench(self, message: WrenchStamped, frame: WrenchFrame) -> None:
        now, stamp = self._now(), message.header.stamp
        stamped = stamp.sec * SECOND + stamp.nanosec
        # Clients of CRTK leave the header empty. After a pause of this process a wrench may have
        # waited as long.
        if (stamped and not -self._timeout <= now - stamped <= self._timeout) or (
            self._was_late or time.monotonic() - self._polled_at > self._longest
        ):
            self.stale += 1
            return
        self._unknown = ''
        force, torque = message.wrench.force, message.wrench.torque
        scale = self._scale
        found = times(frame.rotation, (scale * torque.x, scale * torque.y, scale * torque.z))
        beside = force.x, force.y, force.z
        is_finite = isfinite(sum(found) + sum(beside))
        if any(beside) and not self._warned:
            self._warned = True
            node_log.warning(
                self._node,
                'the force of a wrench is ignored: this device renders '
                'torque about its centre alone',
            )
        with self._lock:
            if self._wrench is not None and now == self._wrench.received:
                now += 1  # each has its own time of arrival
            if is_finite:
                self._wrench = Wrench(now, found, frame.in_handle)
            else:
                self._faulty = Wrench(now, (nan,) * 3, frame.in_handle)

    # Modes --------------------------------------------------------------------------------------

    def _on_scale(self, message: Float64) -> None:
        if not 0.0 <= message.data <= 1.0:
            node_log.warning(
                self._node, f'force_scale is {message.data:g}; expected a number from 0 to 1'
            )
            return
        self._scale = message.data

    def _on_lock(self, message: QuaternionMessage) -> None:
        target = unit_quaternion((message.x, message.y, message.z, message.w))
        if target is None:
            node_log.warning(self._node, 'lock_orientation is not a unit quaternion')
            return
        self.target = self._mounting.unmounted(target)

    def _on_free(self, _: Empty) -> None:
        self.target = None
        with self._lock:
            self._wrench = None

    def _on_teleop(self, message: String) -> None:
        word = message.data.partition(':')[0]
        self._phase_at, self.is_absent = time.monotonic(), message.data == ABSENT
        self.phase = next((phase for phase in Phase if phase.value == word), Phase.DISENGAGED)
