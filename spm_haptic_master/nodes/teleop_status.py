# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `teleop` reports: `teleop_state`, its changes in the log, an entry on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
import time

from rclpy.node import Node
from spm_haptic_master.nodes.slave_torque import SlaveTorque
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.diagnostic_status import OK, StatusPublisher, WARN
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.teleoperation.engaging import Phase, Teleoperation
from spm_haptic_master.teleoperation.remote_centre import MILLIMETRES
from spm_haptic_master.timing import LatencyMeter, RateMeter
from std_msgs.msg import String

# Time between two messages of an unchanged `teleop_state` (s): one older than three of them is
# no longer valid.
STATE_PERIOD = 0.2


class TeleopStatus:
    """
    Publishes the state of a tele-operation.

    Parameters
    ----------
    node
        Node that publishes.
    machine
        The tele-operation; its lock is held by the caller of every method.
    torque
        The slave's torque for the hand; None where the hand feels nothing.

    Attributes
    ----------
    stale_orientations : int
        Orientations that were too old, or from the future; the caller counts them.

    """

    def __init__(
        self,
        node: Node,
        machine: Teleoperation,
        torque: SlaveTorque | None,
    ) -> None:
        self._node = node
        self._machine = machine
        self._torque = torque
        self._out = node.create_publisher(String, 'teleop_state', STATE)
        self._state = ''
        self._published_at = 0.0
        self._phase = Phase.DISENGAGED
        self._latency = LatencyMeter()
        self._commands = RateMeter()
        self.stale_orientations = 0
        self._status = StatusPublisher(
            node=node,
            aspect='teleop',
            hardware_id='slave',
            logs=False,
        )

    def count_command(self, stamp: int) -> None:
        """Count a command for the orientation of a stamp, ns, which has just gone out."""
        self._commands.count += 1
        self._latency.add(time.time_ns() - stamp)

    def publish_phase(self) -> None:
        """Publish the state if the machine has engaged or disengaged."""
        if self._machine.phase is not self._phase:
            self.publish_state()

    def publish_state(self) -> None:
        """Publish the state where it has changed; log a change of the phase."""
        if self._machine.state != self._state:
            self._publish(self._machine.state)

    def repeat(self) -> None:
        """Publish the state where it has changed, or again; and the entry when it is due."""
        if time.monotonic() - self._published_at >= STATE_PERIOD:
            self._publish(self._machine.state)
        else:
            self.publish_state()
        level = OK
        if self._machine.is_blocked:
            level = WARN
        if self._status.is_due(level, self._state):
            self._status.publish(level, self._state, self._figures())

    def _publish(self, state: str) -> None:
        """Publish the state, and log whether the slave has begun or ceased to follow."""
        self._state = state
        self._published_at = time.monotonic()
        self._out.publish(String(data=state))
        before = self._phase
        self._phase = self._machine.phase
        if before is self._phase:
            return
        if self._phase is Phase.DISENGAGED:
            node_log.warning(self._node, f'disengaged: {self._machine.last_disengage_reason}')
        else:
            node_log.info(self._node, state)

    def _figures(self) -> Mapping[str, object]:
        """
        Return keys and values of the entry.

        Returns
        -------
        dict
            Values by key, with their units in the keys.

        """
        machine = self._machine
        offset = machine.offset
        depth = machine.depth
        p50: object = 'none'
        p99: object = 'none'
        percentiles = self._latency.percentiles(0.5, 0.99)
        if percentiles is not None:
            p50, p99 = percentiles
        figures: dict[str, object] = {
            'command rate (Hz)': self._commands.rate(),
            'latency p50 (us)': p50,
            'latency p99 (us)': p99,
            'engaged or clutched off (times)': machine.starts,
            'disengaged last by': machine.last_disengage_reason or 'nothing',
            'angle from master to slave (deg)': 'none' if offset is None else degrees(offset),
            'stale orientations': self.stale_orientations,
        }
        if depth is not None:
            figures['depth of the tip below the trocar (mm)'] = MILLIMETRES * depth
        if self._torque is not None:
            figures['torques to the hand'] = self._torque.count
            figures['torques in another frame'] = self._torque.refused
            figures['torques that are invalid'] = self._torque.invalid
        return figures
