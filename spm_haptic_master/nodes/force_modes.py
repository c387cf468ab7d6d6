# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Modes that a client sets, for as long as it is there: scale, weight, frame, lock."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Generic, TypeVar

from geometry_msgs.msg import PoseStamped
from geometry_msgs.msg import Quaternion as QuaternionMessage
from rclpy.node import Node
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.parameters.geometry import mounting_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.inputs import Inputs
from spm_haptic_master.ros.qos import EVENTS
from spm_haptic_master.teleoperation.vectors import unit_quaternion
from std_msgs.msg import Bool, Empty, Float64

Value = TypeVar('Value')


class Mode(Generic[Value]):
    """
    A value that a client sets on some topic, and that ends with its publisher.

    Attributes
    ----------
    value
        The one set last, or the default.

    Parameters
    ----------
    node : Node
        Node that knows the publishers.
    default
        Value without a client.

    """

    def __init__(self, node: Node, default: Value) -> None:
        self._node = node
        self._default = default
        self.value = default
        # Topic on which it was set, and the endpoints that published there then.
        self._topic = ''
        self._owners: frozenset[bytes] = frozenset()

    def set(self, topic: str, value: Value) -> None:
        """
        Set the value that came on a topic.

        Parameters
        ----------
        topic : str
            Topic on which the value came: the mode lives as long as one of its present publishers.
        value
            The value.

        """
        self.value = value
        self._topic = self._node.resolve_topic_name(topic)
        self._owners = self._publishers()

    def end(self) -> None:
        """Return to the default."""
        self.value = self._default

    def end_without_publisher(self) -> None:
        """Return to the default if nobody is left that may have set the value."""
        if self.value == self._default:
            return
        if self._owners & self._publishers():
            return
        self.end()
        node_log.warning(self._node, f'{self._topic} has lost its publisher: its mode ends')

    def _publishers(self) -> frozenset[bytes]:
        """Return the identifiers of the endpoints that publish on the topic."""
        found = self._node.get_publishers_info_by_topic(self._topic)
        return frozenset(bytes(each.endpoint_gid) for each in found)


class ClientModes:
    """
    The modes of the force feedback, and their topics.

    Each lives as long as its publisher, or until force is off.

    Parameters
    ----------
    node : Node
        Of the subscriptions.
    values : Values
        Settings of `fkm`.
    inputs : Inputs
        Makes the subscriptions.
    orientation : callable
        Returns the latest R_base_platform, or None.
    drop_wrench : callable
        Forgets the latest wrench.

    Attributes
    ----------
    scale : Mode of float
        Share of the wrench, 0 to 1.
    is_weight_compensated : Mode of bool
        Whether the weight of handle and links is compensated.
    is_body_absolute : Mode of bool
        Whether a wrench on `body/servo_cf` is in the frame of `orientation`.
    lock : Mode of quaternion or None
        Locked R_base_platform.

    """

    def __init__(
        self,
        node: Node,
        values: Values,
        inputs: Inputs,
        orientation: Callable[[], Quaternion[float] | None],
        drop_wrench: Callable[[], None],
    ) -> None:
        self._node = node
        self._mounting = mounting_from(values) or Mounting()
        self._orientation = orientation
        self._drop_wrench = drop_wrench
        self.scale: Mode[float] = Mode(node, 1.0)
        self.is_weight_compensated: Mode[bool] = Mode(node, True)
        self.is_body_absolute: Mode[bool] = Mode(node, False)
        self.lock: Mode[Quaternion[float] | None] = Mode(node, None)
        self._all: tuple[Mode[Any], ...] = (
            self.scale,
            self.is_weight_compensated,
            self.is_body_absolute,
            self.lock,
        )
        subscribe = partial(inputs.subscribe, qos=EVENTS)
        subscribe(Float64, 'force_scale', self._on_scale)
        subscribe(Bool, 'use_gravity_compensation', self._on_weight)
        subscribe(Bool, 'body/set_cf_orientation_absolute', self._on_absolute)
        subscribe(QuaternionMessage, 'lock_orientation', self._on_lock)
        subscribe(Empty, 'hold', self._on_hold)
        subscribe(Empty, 'unlock_orientation', self._on_unlock)
        subscribe(Empty, 'free', self._on_free)
        # As on dVRK's masters: another control mode ends the lock. Nothing else follows from it.
        subscribe(PoseStamped, 'move_cp', self._on_unlock)

    def poll(self) -> None:
        """End the modes whose publishers are gone."""
        for mode in self._all:
            mode.end_without_publisher()

    def end(self) -> None:
        """End all modes."""
        for mode in self._all:
            mode.end()

    def figures(self) -> dict[str, object]:
        """Return key and value of each mode, as on /diagnostics."""
        return {
            'force scale': self.scale.value,
            'weight compensated': _word(self.is_weight_compensated.value),
            'body/servo_cf in the frame of orientation': _word(self.is_body_absolute.value),
            'orientation locked': _word(self.lock.value is not None),
        }

    def _on_scale(self, message: Float64) -> None:
        """Set the scale of the wrenches; refuse one that is not within 0 .. 1."""
        if not 0.0 <= message.data <= 1.0:
            node_log.warning(
                self._node, f'force_scale is {message.data:g}; expected a number from 0 to 1'
            )
            return
        self.scale.set('force_scale', message.data)

    def _on_weight(self, message: Bool) -> None:
        """Set whether the weight is compensated."""
        self.is_weight_compensated.set('use_gravity_compensation', message.data)

    def _on_absolute(self, message: Bool) -> None:
        """Set whether wrenches on `body/servo_cf` are in the frame of `orientation`."""
        self.is_body_absolute.set('body/set_cf_orientation_absolute', message.data)

    def _on_lock(self, message: QuaternionMessage) -> None:
        """
        Lock the orientation at the target of a message.

        The target is as mounted, as on `orientation`; it is refused unless it is a unit
        quaternion.
        """
        target = unit_quaternion((message.x, message.y, message.z, message.w))
        if target is None:
            node_log.warning(self._node, 'lock_orientation is not a unit quaternion')
            return
        self.lock.set('lock_orientation', self._mounting.unmounted(target))

    def _on_hold(self, _: Empty) -> None:
        """Lock the orientation where it is; refuse it without an orientation."""
        orientation = self._orientation()
        if orientation is None:
            node_log.warning(self._node, 'hold is refused: there is no orientation to hold')
            return
        self.lock.set('hold', orientation)

    def _on_unlock(self, _: object) -> None:
        """End the lock."""
        self.lock.end()

    def _on_free(self, _: Empty) -> None:
        """End the lock, and drop the latest wrench."""
        self.lock.end()
        self._drop_wrench()


def _word(is_so: bool) -> str:
    """Return yes or no."""
    return 'yes' if is_so else 'no'
