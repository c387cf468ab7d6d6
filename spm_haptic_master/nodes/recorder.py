# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that writes orientations and joint angles to CSV files, for use without rosbag2."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

from geometry_msgs.msg import QuaternionStamped
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.nodes import runner
from spm_haptic_master.nodes.parameters import declare, RECORDER_SETTINGS
from spm_haptic_master.nodes.qos import SAMPLES
from std_msgs.msg import Header


class Recorder(Node):
    """
    Writes the files that `validate` reads: stamps in s, quaternions x, y, z, w, angles in rad.

    A file is created with its first message; an earlier recording is never overwritten.

    Parameters
    ----------
    done : Future
        Completed with an InputError when the files cannot be written.

    Raises
    ------
    InputError
        If a recording already exists.

    """

    def __init__(self, done: Future) -> None:
        super().__init__('recorder')
        self._done = done
        directory = Path(declare(self, RECORDER_SETTINGS)['directory'])
        self._orientations = _Table(directory / 'orientation.csv', ('qx', 'qy', 'qz', 'qw'))
        self._joints = _Table(directory / 'measured_js.csv', JOINT_NAMES)
        self.create_subscription(QuaternionStamped, 'orientation', self._on_orientation, SAMPLES)
        self.create_subscription(JointState, 'measured_js', self._on_joints, SAMPLES)

    def destroy_node(self) -> None:
        """
        Close the files and destroy the node.

        Raises
        ------
        InputError
            If the end of a file cannot be written.

        """
        with ExitStack() as stack:
            stack.callback(super().destroy_node)
            stack.callback(self._joints.close)
            stack.callback(self._orientations.close)

    def _on_orientation(self, message: QuaternionStamped) -> None:
        q = message.quaternion
        self._write(self._orientations, message, (q.x, q.y, q.z, q.w))

    def _on_joints(self, message: JointState) -> None:
        angles = dict(zip(message.name, message.position, strict=False))
        if angles.keys() >= set(JOINT_NAMES):
            self._write(self._joints, message, [angles[name] for name in JOINT_NAMES])

    def _write(self, table: _Table, message: QuaternionStamped | JointState,
               values: Sequence[float]) -> None:
        if self._done.done():
            return
        try:
            table.write(message.header, values)
        except InputError as error:
            self._done.set_result(error)


class _Table:
    """A CSV file of stamps and values, created with its first row."""

    def __init__(self, path: Path, columns: tuple[str, ...]) -> None:
        if path.exists():
            raise InputError(f'{path}: already exists; choose another directory')
        self._path = path
        self._columns = columns
        self._file: TextIO | None = None

    def write(self, header: Header, values: Sequence[float]) -> None:
        """Append a row: the stamp in s, and the values."""
        stamp = header.stamp
        try:
            if self._file is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._file = open(self._path, 'x', encoding='utf-8')
                self._file.write(','.join(('time', *self._columns)) + '\n')
            self._file.write(f'{stamp.sec}.{stamp.nanosec:09d},'
                             + ','.join(f'{value:.9f}' for value in values) + '\n')
        except OSError as error:
            raise self._unwritable(error) from error

    def close(self) -> None:
        """Close the file, if it was created; InputError if its end cannot be written."""
        try:
            if self._file is not None:
                self._file.close()
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> InputError:
        return InputError(f'{self._path}: cannot be written: {error}')


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('recorder', lambda done, add: add(Recorder(done)), args)
