# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The truth of a simulation as topics, for recordings: orientation and rig."""

from __future__ import annotations

from geometry_msgs.msg import QuaternionStamped
from rclpy.node import Node
from spm_haptic_master.ros.cdr import OrientationWriter
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.simulation.rig_file import rig_text
from spm_haptic_master.simulation.sim_source import SimSource
from std_msgs.msg import String

# Topics of the true orientation and of the rig.
ORIENTATION_TOPIC, RIG_TOPIC = 'ground_truth/orientation', 'ground_truth/rig'
# frame_id of the true orientation: the base frame of the simulated rig.
FRAME = 'rig_base'


class GroundTruth:
    """
    Publishes what a simulated source knows.

    Parameters
    ----------
    node : Node
        Node of the source.
    source : SimSource
        The source.

    """

    def __init__(self, node: Node, source: SimSource) -> None:
        self._source = source
        self._writer = OrientationWriter(FRAME)
        self._orientation = node.create_publisher(QuaternionStamped, ORIENTATION_TOPIC, SAMPLES)
        self._rig = node.create_publisher(String, RIG_TOPIC, STATE)
        self._rig.publish(String(data=rig_text(source.rig)))

    def publish(self, stamp: int) -> None:
        """Publish the true orientation of the last sample, stamped in ns, if anybody listens."""
        if self._orientation.get_subscription_count():
            self._orientation.publish(self._writer.write(stamp, self._source.orientation()))
