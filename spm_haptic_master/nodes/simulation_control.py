# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Topics of a simulated device: its truth, and requests to move it and to let its encoders fail.

`simulation/steer` (Float64MultiArray) has tilt, azimuth and phi of a pose, rad, as in
`workspace_pose`; without numbers the trajectory continues. `simulation/fault` (String) sets the
faults, such as 'stuck:joint_1a, offset:joint_3a=5'; an empty text ends them. `simulation/faults`
(String, latched) has those that are present. `ground_truth/orientation` has the true orientation
of each sample, and `ground_truth/rig` (latched) the rig, for recordings.
"""

from __future__ import annotations

from geometry_msgs.msg import QuaternionStamped
from rclpy.node import Node
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.cdr import OrientationWriter
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.rig import rig_text
from spm_haptic_master.simulation.sim_source import SimSource
from std_msgs.msg import Float64MultiArray, String

# Topics of the pose, of the faults wanted, and of those present.
STEER_TOPIC = 'simulation/steer'
FAULT_TOPIC = 'simulation/fault'
FAULTS_TOPIC = 'simulation/faults'
# Topics of the true orientation and of the rig.
ORIENTATION_TOPIC = 'ground_truth/orientation'
RIG_TOPIC = 'ground_truth/rig'
# frame_id of the true orientation: the base frame of the simulated rig.
FRAME = 'rig_base'
# Depth of the subscriptions: the latest request counts.
DEPTH = 1


class SimulationControl:
    """
    Publishes what a simulated source knows; passes requests to it, and logs wrong ones.

    Parameters
    ----------
    node : Node
        Node of the topics.
    source : SimSource
        The simulated source.

    """

    def __init__(self, node: Node, source: SimSource) -> None:
        self._node = node
        self._source = source
        self._writer = OrientationWriter(FRAME)
        self._orientation = node.create_publisher(QuaternionStamped, ORIENTATION_TOPIC, SAMPLES)
        self._rig = node.create_publisher(String, RIG_TOPIC, STATE)
        self._rig.publish(String(data=rig_text(source.rig)))
        self._faults = node.create_publisher(String, FAULTS_TOPIC, STATE)
        self._faults.publish(String())
        node.create_subscription(Float64MultiArray, STEER_TOPIC, self._steer, DEPTH)
        node.create_subscription(String, FAULT_TOPIC, self._set_faults, DEPTH)

    def publish_truth(self, stamp: int) -> None:
        """
        Publish the true orientation of the last sample, stamped in ns, if anybody listens.

        Parameters
        ----------
        stamp : int
            Stamp of the sample.

        """
        if self._orientation.get_subscription_count():
            truth = self._source.orientation()
            self._orientation.publish(self._writer.write(stamp, truth))

    def _steer(self, message: Float64MultiArray) -> None:
        """
        Move the device to a pose, or let its trajectory continue; log a wrong request.

        Parameters
        ----------
        message : Float64MultiArray
            Tilt, azimuth and phi, rad, or no numbers.

        """
        pose = list(message.data)
        try:
            if not pose:
                self._source.steering.release()
            elif len(pose) == 3:
                self._source.steering.steer(*pose)
            else:
                raise InputError(f'{len(pose)} numbers; expected tilt, azimuth and phi (rad)')
        except InputError as error:
            node_log.warning(self._node, f'{STEER_TOPIC}: {error}')

    def _set_faults(self, message: String) -> None:
        """
        Replace the faults of the encoders; log a wrong request.

        Parameters
        ----------
        message : String
            Faults separated by commas; empty: none.

        """
        sensors = len(self._source.rig.sensors)
        faults = []
        try:
            for part in message.data.split(','):
                text = part.strip()
                if text:
                    faults.append(parse_switched(text, sensors))
        except InputError as error:
            node_log.warning(self._node, f'{FAULT_TOPIC}: {error}')
            return
        self._source.faults = tuple(faults)
        texts = [fault.text for fault in faults]
        self._faults.publish(String(data=', '.join(texts)))
