# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Topics by which a simulated device is moved and its encoders fail; no other source has them.

`simulation/steer` (Float64MultiArray) has tilt, azimuth and phi of a pose, rad, as in
`workspace_pose`; without numbers the motion goes on by itself. `simulation/fault` (String) has the
faults that are present from then on, such as 'stuck:joint_1a, offset:joint_3a=5'; an empty text
ends them. `simulation/faults` (String, latched) has those that are present.
"""

from __future__ import annotations

from rclpy.node import Node
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.sim_source import SimSource
from std_msgs.msg import Float64MultiArray, String

# Topics of the pose, of the faults wanted, and of those present.
STEER_TOPIC, FAULT_TOPIC, FAULTS_TOPIC = \
    'simulation/steer', 'simulation/fault', 'simulation/faults'
# Depth of the subscriptions: the latest request counts.
DEPTH = 1


class SimulationControl:
    """
    Passes requests to a simulated source; a wrong one is logged and changes nothing.

    Parameters
    ----------
    node : Node
        Node of the source.
    source : SimSource
        The source.

    """

    def __init__(self, node: Node, source: SimSource) -> None:
        self._node, self._source = node, source
        self._faults = node.create_publisher(String, FAULTS_TOPIC, STATE)
        self._faults.publish(String())
        node.create_subscription(Float64MultiArray, STEER_TOPIC, self._steer, DEPTH)
        node.create_subscription(String, FAULT_TOPIC, self._set_faults, DEPTH)

    def _steer(self, message: Float64MultiArray) -> None:
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
        texts = [text for part in message.data.split(',') if (text := part.strip())]
        try:
            faults = tuple(parse_switched(text, len(self._source.rig.sensors))
                           for text in texts)
        except InputError as error:
            node_log.warning(self._node, f'{FAULT_TOPIC}: {error}')
            return
        self._source.faults = faults
        self._faults.publish(String(data=', '.join(fault.text for fault in faults)))
