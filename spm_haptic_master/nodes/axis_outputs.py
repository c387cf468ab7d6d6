# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The topics and the entries on /diagnostics of insertion and gripper, for encoder_driver."""

from __future__ import annotations

from collections.abc import Sequence
import time

from rclpy.node import Node
from sensor_msgs.msg import JointState
from spm_haptic_master.encoders.single_axis import AxisReading, SingleAxis
from spm_haptic_master.parameters.axes import GRIPPER
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, StatusPublisher
from spm_haptic_master.ros.qos import SAMPLES
from spm_haptic_master.timing import SECOND

# Message of a reading that comes.
PUBLISHING = 'publishing'
# Time after the start in which a reading that is missing is not an error yet (s).
START_GRACE = 0.5


class AxisOutputs:
    """
    Publishes the readings of the axes: each one, and those of the gripper at `crtk_rate`.

    Without a reading nothing is published; `report` says why on /diagnostics.

    Parameters
    ----------
    node : Node
        Node that publishes.
    axes : sequence of SingleAxis
        Axes that have an encoder; empty: none.
    source_text : str
        The source with its bus or file.
    crtk_rate : float
        Highest rate of the gripper's messages, Hz; 0: each reading.

    """

    def __init__(
        self,
        node: Node,
        axes: Sequence[SingleAxis],
        source_text: str,
        crtk_rate: float,
    ) -> None:
        self._axes = axes
        self._outs = {}
        self._messages = {}
        self._statuses = {}
        for axis in axes:
            topic = f'{axis.name}/measured_js'
            self._outs[axis.name] = node.create_publisher(JointState, topic, SAMPLES)
            self._messages[axis.name] = JointState(name=[axis.name])
            self._statuses[axis.name] = StatusPublisher(
                node=node,
                aspect=axis.name,
                hardware_id=source_text,
            )
        # Time between two messages of the gripper, and stamp of its latest, ns.
        self._gripper_period = 0
        if crtk_rate:
            self._gripper_period = round(SECOND / crtk_rate)
        self._gripper_at = 0
        self._began = time.monotonic()

    def publish(self, readings: Sequence[AxisReading]) -> None:
        """
        Publish readings, in their order.

        Parameters
        ----------
        readings : sequence of AxisReading
            Readings since the last call: name, stamp (ns) and position (insertion m, gripper rad).

        """
        for reading in readings:
            if reading.name == GRIPPER:
                # The clock may have been set back.
                if 0 <= reading.stamp - self._gripper_at < self._gripper_period:
                    continue
                self._gripper_at = reading.stamp
            message = self._messages[reading.name]
            stamp = message.header.stamp
            stamp.sec, stamp.nanosec = divmod(reading.stamp, SECOND)
            message.position = [reading.position]
            self._outs[reading.name].publish(message)

    def report(self, now: float) -> None:
        """
        Publish on /diagnostics whether each axis has a reading `now`, s, and if not, why.

        Parameters
        ----------
        now : float
            Present time on the clock of the axes.

        """
        starting = time.monotonic() - self._began < START_GRACE
        for axis in self._axes:
            fault = None
            if not starting or axis.latest is not None:
                fault = axis.fault(now)
            level = OK
            text = PUBLISHING
            if fault is not None:
                level = ERROR
                text = fault
            status = self._statuses[axis.name]
            if status.is_due(level, text):
                status.publish(level, text, _figures(axis, now))


def _figures(axis: SingleAxis, now: float) -> dict[str, object]:
    """Return the values of an axis's entry on /diagnostics at a time, s."""
    figures: dict[str, object] = {
        'position': 'none yet',
        'age (ms)': 'never read',
        'frame rate (Hz)': axis.encoder.frames.rate(),
    }
    if axis.latest is not None:
        read_at, position = axis.latest
        figures['position'] = position
        figures['age (ms)'] = 1e3 * (now - read_at)
    for reason, count in axis.encoder.rejects.items():
        figures[f'rejected: {reason}'] = count
    return figures
