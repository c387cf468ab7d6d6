# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The frames of the mounting: the reference of the outputs, and static transforms for tf."""

from __future__ import annotations

from geometry_msgs.msg import Quaternion, TransformStamped
from rclpy.node import Node
from spm_haptic_master.kinematics.mounting import IDENTITY
from spm_haptic_master.parameters.fkm import check_frames
from spm_haptic_master.parameters.geometry import mounting_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.qos import STATE

# Topic of static transforms, of all nodes: latched.
STATIC_TRANSFORMS = '/tf_static'


def static_transforms(values: Values) -> list[TransformStamped]:
    """
    Return the constant rotations of the mounting, from parent to child frame; without one none.

    The values are those of `FKM_SETTINGS`; SettingError if two frames have the same name.
    """
    mounting = mounting_from(values)
    if mounting is None:
        return []
    check_frames(values)
    table, platform, handle = (
        values[f'mounting.{part}_frame_id'] for part in ('table', 'platform', 'handle'))
    found = []
    for parent, child, quaternion in ((table, values['frame_id'], mounting.base),
                                      (platform, handle, mounting.handle)):
        if quaternion != IDENTITY:
            transform = TransformStamped(child_frame_id=child)
            transform.header.frame_id = parent
            x, y, z, w = quaternion
            transform.transform.rotation = Quaternion(x=x, y=y, z=z, w=w)
            found.append(transform)
    return found


class MountingFrames:
    """Frames of a node's outputs; their static transforms, where there is a mounting."""

    def __init__(self, node: Node, values: Values) -> None:
        transforms = static_transforms(values)
        parents = {each.child_frame_id: each.header.frame_id for each in transforms}
        # Frame of the outputs: the table's where the base is mounted on it, or else the base's.
        self.reference = str(parents.get(values['frame_id'], values['frame_id']))
        # Frames of the mounting in words, for /diagnostics; empty without a mounting.
        self.text = ', '.join(f'{child} on {parent}' for child, parent in parents.items())
        if not transforms:
            return
        try:
            # A message of ROS's own package, which the client library alone does not bring.
            from tf2_msgs.msg import TFMessage
        except ImportError:
            self.text += f' (not on {STATIC_TRANSFORMS}: no tf2_msgs)'
            return
        for each in transforms:
            each.header.stamp = node.get_clock().now().to_msg()
        self._publisher = node.create_publisher(TFMessage, STATIC_TRANSFORMS, STATE)
        self._publisher.publish(TFMessage(transforms=transforms))
