"""The node that writes orientations and joint angles into CSV files, where there is no rosbag2."""

from __future__ import annotations

from pathlib import Path

from geometry_msgs.msg import QuaternionStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

from spm_haptic_master.encoders.sample import JOINT_NAMES
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes import process
from spm_haptic_master.nodes.parameters import declare, RECORDER_SETTINGS
from spm_haptic_master.nodes.qos import SAMPLES


class Recorder(Node):
    """
    Writes what `validate` reads: header stamps in s; quaternions x, y, z, w; joint angles in rad.

    Raises
    ------
    InputError
        The files cannot be written.

    """

    def __init__(self):
        super().__init__('recorder')
        directory = Path(declare(self, RECORDER_SETTINGS)['directory'])
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._orientations = open(directory / 'orientation.csv', 'w', encoding='utf-8')
            self._joints = open(directory / 'measured_js.csv', 'w', encoding='utf-8')
        except OSError as error:
            raise InputError(f'{directory}: cannot be written: {error}') from error
        self._orientations.write('time,qx,qy,qz,qw\n')
        self._joints.write(','.join(('time', *JOINT_NAMES)) + '\n')
        self.create_subscription(QuaternionStamped, 'orientation', self._on_orientation, SAMPLES)
        self.create_subscription(JointState, 'measured_js', self._on_joints, SAMPLES)

    def destroy_node(self):
        """Complete the files and go."""
        self._orientations.close()
        self._joints.close()
        super().destroy_node()

    def _on_orientation(self, message: QuaternionStamped) -> None:
        q = message.quaternion
        _write(self._orientations, message, (q.x, q.y, q.z, q.w))

    def _on_joints(self, message: JointState) -> None:
        angles = dict(zip(message.name, message.position))
        if angles.keys() >= set(JOINT_NAMES):
            _write(self._joints, message, [angles[name] for name in JOINT_NAMES])


def _write(file, message, values) -> None:
    stamp = message.header.stamp
    file.write(f'{stamp.sec}.{stamp.nanosec:09d},'
               + ','.join(f'{value:.9f}' for value in values) + '\n')


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return process.run('recorder', lambda _, add: add(Recorder()), args)
