# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that writes orientations and joint angles to files, for use without rosbag2."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from geometry_msgs.msg import QuaternionStamped
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.encoders import recording_files as files
from spm_haptic_master.encoders.recording_files import QUATERNION_COLUMNS, Table
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.nodes.simulation_control import ORIENTATION_TOPIC, RIG_TOPIC
from spm_haptic_master.parameters.nodes import RECORDER_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros import node_log, runner
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.timing import SECOND
from std_msgs.msg import String


class Recorder(ParameterNode):
    """
    Writes the files that `validate` reads: stamps in s, quaternions x, y, z, w, angles in rad.

    Of a simulated source also the truth: the orientation at each sample, and the rig. A file is
    created with its first message; an earlier recording is never overwritten.

    `done` is completed with an InputError when the files cannot be written; a recording that
    already exists raises it.
    """

    def __init__(self, parameters: Parameters, done: Future) -> None:
        super().__init__('recorder', parameters)
        self._done = done
        self._directory = directory = Path(self.declare(RECORDER_SETTINGS)['directory'])
        self._orientations = Table(directory / files.ORIENTATION_NAME, QUATERNION_COLUMNS)
        # With the joints of the first message.
        self._names: tuple[str, ...] = JOINT_NAMES
        self._joints = Table(directory / files.JOINTS_NAME, self._names)
        self._has_joints = False
        # Messages on measured_js that lack one of them.
        self._incomplete = 0
        # `sim_bus` may write the truth into the same directory.
        self._truths: Table | None = None
        self._rig: str | None = None
        self.create_subscription(QuaternionStamped, 'orientation', self._on_orientation, SAMPLES)
        self.create_subscription(JointState, 'measured_js', self._on_joints, SAMPLES)
        self.create_subscription(QuaternionStamped, ORIENTATION_TOPIC, self._on_truth, SAMPLES)
        self.create_subscription(String, RIG_TOPIC, self._on_rig, STATE)

    def start(self) -> None:
        """Log where the files will be."""
        node_log.info(self, f'writes into {self._directory.absolute()}, until Ctrl-C')

    def destroy_node(self) -> None:
        """Close the files (InputError if that fails), log their sizes, and destroy the node."""
        tables = [table for table in (self._orientations, self._joints, self._truths)
                  if table is not None]
        with ExitStack() as stack:
            stack.callback(super().destroy_node)
            for table in reversed(tables):
                stack.callback(self._close, table)
            if self._incomplete:
                node_log.warning(self, f'{self._incomplete} messages on measured_js without one '
                                 f'of {", ".join(self._names)}: not written')
            if not self._done.done() and not any(table.rows for table in tables):
                node_log.warning(self, 'nothing was written: no message came on orientation or '
                                 'measured_js')

    def _close(self, table: Table) -> None:
        """Close a table and log rows, seconds and bytes, unless the recording has failed."""
        table.close()
        if table.rows and not self._done.done():
            begin, end = table.span
            node_log.info(self, f'{table.path}: {table.rows} rows, {(end - begin) / SECOND:.1f} '
                          f's, {table.path.stat().st_size} bytes')

    def _on_orientation(self, message: QuaternionStamped) -> None:
        self._write_orientation(self._orientations, message)

    def _on_truth(self, message: QuaternionStamped) -> None:
        if self._truths is None:
            try:
                self._truths = Table(self._directory / files.GROUND_TRUTH_NAME, QUATERNION_COLUMNS)
            except InputError as error:
                self._fail(error)
                return
        self._write_orientation(self._truths, message)

    def _write_orientation(self, table: Table, message: QuaternionStamped) -> None:
        q = message.quaternion
        self._write(table, message, (q.x, q.y, q.z, q.w))

    def _on_joints(self, message: JointState) -> None:
        angles = dict(zip(message.name, message.position, strict=False))
        if not angles.keys() >= set(self._names):
            self._incomplete += 1
            return
        if not self._has_joints:
            self._has_joints = True
            self._begin_joints(tuple(name for name in ALL_JOINT_NAMES if name in angles))
        self._write(self._joints, message, [angles[name] for name in self._names])

    def _begin_joints(self, names: tuple[str, ...]) -> None:
        """Have a column for each sensor that there is."""
        self._names = names
        try:
            self._joints = Table(self._directory / files.JOINTS_NAME, names)
        except InputError as error:
            self._fail(error)

    def _on_rig(self, message: String) -> None:
        """Write the simulated rig; a driver that starts again has to have the same."""
        if message.data == self._rig:
            return
        try:
            if self._rig is not None:
                raise InputError('another simulated rig than at the start; expected one rig in a '
                                 'recording')
            self._rig = message.data
            files.write_new(self._directory / files.RIG_NAME, message.data)
        except InputError as error:
            self._fail(error)

    def _write(self, table: Table, message: QuaternionStamped | JointState,
               values: Sequence[float]) -> None:
        if self._done.done():
            return
        stamp = message.header.stamp
        try:
            table.write(stamp.sec * SECOND + stamp.nanosec, values)
        except InputError as error:
            self._fail(error)

    def _fail(self, error: InputError) -> None:
        """End the process with an error; the first one counts."""
        if not self._done.done():
            self._done.set_result(error)


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('recorder', lambda done, add: add(Recorder, done), args)
