# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that writes orientations and joint angles to files, for use without rosbag2."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from geometry_msgs.msg import QuaternionStamped
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.encoders import recording_files as files
from spm_haptic_master.encoders.recording_files import QUATERNION_COLUMNS, Table
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.nodes.simulation_control import ORIENTATION_TOPIC, RIG_TOPIC
from spm_haptic_master.parameters.axes import AXES
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

    Of a simulated source also the true orientations and the rig. A file is created with its first
    message.

    Parameters
    ----------
    parameters : Parameters
        Files and arguments of the process.
    done : Future
        Is completed with the InputError of a file that cannot be written.

    Raises
    ------
    InputError
        There is already a recording in the directory.

    """

    def __init__(self, parameters: Parameters, done: Future) -> None:
        super().__init__('recorder', parameters)
        self._done = done
        self._directory = Path(self.declare(RECORDER_SETTINGS)['directory'])
        # By their names, in the order of the report. That of the truth is made at its first
        # message: `sim_bus` may write it into the same directory.
        self._tables: dict[str, Table] = {}
        self._add_table(files.ORIENTATION_NAME, QUATERNION_COLUMNS)
        self._add_table(files.JOINTS_NAME, JOINT_NAMES)
        # Joints of the first message on measured_js, and messages that lack one of them.
        self._names: tuple[str, ...] = ()
        self._incomplete = 0
        self._rig: str | None = None
        self._record(QuaternionStamped, 'orientation', self._take_orientation, SAMPLES)
        self._record(JointState, 'measured_js', self._take_joints, SAMPLES)
        for axis in AXES:
            take_axis = partial(self._take_axis, axis)
            self._record(JointState, f'{axis}/measured_js', take_axis, SAMPLES)
        self._record(QuaternionStamped, ORIENTATION_TOPIC, self._take_truth, SAMPLES)
        self._record(String, RIG_TOPIC, self._take_rig, STATE)

    def _add_table(self, name: str, columns: Sequence[str]) -> None:
        """Add the table of a file, which its first row makes."""
        self._tables[name] = Table(self._directory / name, columns)

    def _record(
        self,
        kind: Any,
        topic: str,
        take: Callable[[Any], None],
        qos: Any,
    ) -> None:
        """Subscribe to a topic whose messages are written."""
        self.create_subscription(kind, topic, self._guarded(take), qos)

    def _guarded(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """
        Return a callback that ends the process with the first InputError.

        Parameters
        ----------
        take : callable
            Takes a message; may raise InputError.

        Returns
        -------
        callable
            It ignores all messages after the error.

        """

        def callback(message: Any) -> None:
            if self._done.done():
                return
            try:
                take(message)
            except InputError as error:
                self._done.set_result(error)

        return callback

    def start(self) -> None:
        """Log where the files will be."""
        node_log.info(self, f'writes into {self._directory.absolute()}, until Ctrl-C')

    def destroy_node(self) -> None:
        """
        Close the files, log their sizes, and destroy the node.

        Raises
        ------
        InputError
            The end of a file cannot be written; the node is destroyed nevertheless.

        """
        with ExitStack() as stack:
            stack.callback(super().destroy_node)
            for table in reversed(self._tables.values()):
                stack.callback(self._close, table)
            if self._incomplete:
                names = ', '.join(self._names or JOINT_NAMES)
                node_log.warning(
                    self,
                    f'{self._incomplete} messages on measured_js without one of {names}: '
                    'not written',
                )
            has_rows = any(table.rows for table in self._tables.values())
            if not has_rows and not self._done.done():
                node_log.warning(
                    self, 'nothing was written: no message came on orientation or measured_js'
                )

    def _close(self, table: Table) -> None:
        """Close a table and log rows, seconds and bytes, unless the recording has failed."""
        table.close()
        if table.rows and not self._done.done():
            begin, end = table.span
            seconds = (end - begin) / SECOND
            size = table.path.stat().st_size
            node_log.info(self, f'{table.path}: {table.rows} rows, {seconds:.1f} s, {size} bytes')

    def _take_orientation(
        self,
        message: QuaternionStamped,
        name: str = files.ORIENTATION_NAME,
    ) -> None:
        """Write an orientation into the table of a name."""
        q = message.quaternion
        self._write(name, message, (q.x, q.y, q.z, q.w))

    def _take_truth(self, message: QuaternionStamped) -> None:
        """Write a true orientation of a simulated source."""
        name = files.GROUND_TRUTH_NAME
        if name not in self._tables:
            self._add_table(name, QUATERNION_COLUMNS)
        self._take_orientation(message, name)

    def _take_joints(self, message: JointState) -> None:
        """
        Write the angles of a sample; the first one decides which joints the table has.

        A message that lacks one of the table's joints is counted, not written.
        """
        angles = dict(zip(message.name, message.position, strict=False))
        names = self._names or JOINT_NAMES
        if not angles.keys() >= set(names):
            self._incomplete += 1
            return
        if not self._names:
            names = tuple(name for name in ALL_JOINT_NAMES if name in angles)
            self._names = names
            self._add_table(files.JOINTS_NAME, names)
        row = [angles[name] for name in names]
        self._write(files.JOINTS_NAME, message, row)

    def _take_axis(self, axis: str, message: JointState) -> None:
        """Write the insertion, m, or the gripper, rad, into a file of its own."""
        if list(message.name) != [axis] or len(message.position) != 1:
            return
        name = f'{axis}.csv'
        if name not in self._tables:
            self._add_table(name, (axis,))
        self._write(name, message, message.position)

    def _take_rig(self, message: String) -> None:
        """Write the simulated rig; InputError for another one in the same recording."""
        if self._rig is None:
            self._rig = message.data
            files.write_new(self._directory / files.RIG_NAME, message.data)
        elif self._rig != message.data:
            raise InputError(
                'another simulated rig than at the start; expected one rig in a recording'
            )

    def _write(
        self,
        name: str,
        message: QuaternionStamped | JointState,
        values: Sequence[float],
    ) -> None:
        """
        Write a row: the stamp of the message, and values.

        Parameters
        ----------
        name : str
            Name of the file.
        message : QuaternionStamped or JointState
            Message whose header has the stamp.
        values : sequence of float
            Values of the row behind the stamp.

        """
        stamp = message.header.stamp
        self._tables[name].write(stamp.sec * SECOND + stamp.nanosec, values)


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('recorder', lambda done, add: add(Recorder, done), args)
