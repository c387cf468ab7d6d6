# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a slave is commanded: a pose of its tip, and the motion that leads there."""

from __future__ import annotations

from typing import NamedTuple

from spm_haptic_master.kinematics.vectors import added, cross
from spm_haptic_master.teleoperation.vectors import FloatQuaternion, FloatVector, ZERO


class Pose(NamedTuple):
    """Pose of the tip of the slave in its base frame."""

    rotation: FloatQuaternion  # unit quaternion x, y, z, w
    position: FloatVector = ZERO  # m


class Motion(NamedTuple):
    """Velocity of a commanded pose in the slave's base frame."""

    angular: FloatVector = ZERO  # rad/s
    # From the trocar to the tip, m, and velocity of the tip along the shaft, m/s; zero without a
    # trocar: the tip keeps its position.
    lever: FloatVector = ZERO
    sliding: FloatVector = ZERO

    @property
    def linear(self) -> FloatVector:
        """Velocity of the tip, m/s: v = omega x (p - p_t) + L' R u."""
        return added(cross(self.angular, self.lever), self.sliding)


class Command(NamedTuple):
    """The command that follows one orientation of the master."""

    pose: Pose
    motion: Motion
