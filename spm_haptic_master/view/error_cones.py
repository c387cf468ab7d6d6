# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How far the handle's axis may be off: half angles of cones about it."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, sqrt
from typing import NamedTuple

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.kinematics.number_backends import Rotation
from spm_haptic_master.kinematics.rotations import multiply_quaternions, rotation_from_quaternion
from spm_haptic_master.view.sampled_topic import SampledTopic

# Standard deviations that the inner cone spans.
DEVIATIONS = 3.0


class Ellipse(NamedTuple):
    """
    Cone of the covariance, elliptic.

    Attributes
    ----------
    major, minor : float
        Half angles, rad.
    turn : float
        Angle about the platform's z from its x to the larger one, rad.

    """

    major: float
    minor: float
    turn: float


def axis_ellipse(covariance: Rotation[float], rotation: Rotation[float]) -> Ellipse:
    """
    Return the cone in which the platform's axis is, of a covariance of the orientation.

    Parameters
    ----------
    covariance : tuple of nine float
        Of the rotation error about the fixed axes, rad^2, row by row.
    rotation : tuple of nine float
        The orientation in the same frame, row by row.

    """
    # Rows of the platform's x and y in the fixed frame.
    x, y = rotation[0::3], rotation[1::3]

    def between(one: tuple[float, ...], other: tuple[float, ...]) -> float:
        return sum(one[i] * covariance[3 * i + j] * other[j] for i in range(3) for j in range(3))

    # A turn about x moves the axis along -y, and one about y along x.
    along_x, along_y, mixed = between(y, y), between(x, x), -between(x, y)
    middle, half = 0.5 * (along_x + along_y), 0.5 * (along_x - along_y)
    spread = sqrt(half * half + mixed * mixed)
    return Ellipse(DEVIATIONS * sqrt(max(0.0, middle + spread)),
                   DEVIATIONS * sqrt(max(0.0, middle - spread)), 0.5 * atan2(mixed, half))


class CovarianceCone:
    """
    The cone of the newest covariance, which fkm computes for subscribers alone.

    Parameters
    ----------
    taker : Node
        Node of no executor.
    topic : str
        Name of the topic.

    """

    def __init__(self, taker: Node, topic: str) -> None:
        self._poses = SampledTopic(taker, PoseWithCovarianceStamped, topic)
        self.ellipse: Ellipse | None = None

    def watch(self, wanted: bool) -> None:
        """Subscribe to the covariance, or end that."""
        if wanted:
            self._poses.subscribe()
        else:
            self._poses.unsubscribe()
            self.ellipse = None

    def take(self, mounting: Mounting) -> Ellipse | None:
        """Return the cone about the platform's axis; None as long as there is none."""
        message = self._poses.take()
        if message is not None:
            q = message.pose.pose.orientation
            # The cone hangs on the platform, not on the handle.
            platform = multiply_quaternions(
                mounting.base, mounting.unmounted((q.x, q.y, q.z, q.w)))
            self.ellipse = axis_ellipse(
                _of_rotation(message.pose.covariance), rotation_from_quaternion(*platform))
        return self.ellipse


def _of_rotation(covariance: Sequence[float]) -> Rotation[float]:
    """Return the lower right block of a 6 x 6 covariance."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = (
        float(covariance[row + column]) for row in (21, 27, 33) for column in range(3))
    return xx, xy, xz, yx, yy, yz, zx, zy, zz
