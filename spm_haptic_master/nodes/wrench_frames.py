# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The frames in which a torque on the handle may be given, and is published."""

from __future__ import annotations

from typing import NamedTuple

from spm_haptic_master.force.statics import rotated
from spm_haptic_master.kinematics.mounting import IDENTITY, Mounting
from spm_haptic_master.kinematics.number_backends import Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import conjugate, rotation_from_quaternion
from spm_haptic_master.parameters.geometry import mounting_from
from spm_haptic_master.parameters.setting import Values


def unrotated(matrix: Rotation[float], vector: Vector[float]) -> Vector[float]:
    """Return a vector, turned by the inverse of a rotation that is given row by row."""
    a, b, c, d, e, f, g, h, i = matrix
    return rotated((a, d, g, b, e, h, c, f, i), vector)


class WrenchFrame(NamedTuple):
    """A frame, and how it stands in one of the mechanism's."""

    name: str  # frame_id
    in_handle: bool  # turns with the platform; else in the base frame
    rotation: Rotation[float] | None = None  # to platform or base; None: the same

    def inwards(self, torque: Vector[float]) -> Vector[float]:
        """Return a torque of this frame in the platform or base frame."""
        return torque if self.rotation is None else rotated(self.rotation, torque)

    def outwards(self, torque: Vector[float]) -> Vector[float]:
        """Return a torque of the platform or base frame in this frame."""
        return torque if self.rotation is None else unrotated(self.rotation, torque)


class WrenchFrames:
    """
    The frames of a device; `reference` is that of `orientation`.

    It is the table's where the base is mounted on it, or else the base's.
    """

    def __init__(self, values: Values, reference: str) -> None:
        mounting = mounting_from(values) or Mounting()
        base, platform, handle = (values[name] for name in (
            'frame_id', 'mounting.platform_frame_id', 'mounting.handle_frame_id'))
        # Components in the table's frame to those in the base's: R_table_base^T.
        self.spatial = WrenchFrame(reference, False, _matrix(conjugate(mounting.base)))
        turned = _matrix(mounting.handle)
        self.body = WrenchFrame(platform if turned is None else handle, True, turned)
        # CRTK clients leave the frame of a header empty: it is that of `orientation`.
        self._by_name = {base: WrenchFrame(base, False), platform: WrenchFrame(platform, True),
                         '': self.spatial, reference: self.spatial,
                         handle: self.body._replace(name=handle)}

    @property
    def names(self) -> tuple[str, ...]:
        """Return the frames that a header may have."""
        return tuple(sorted(filter(None, self._by_name)))

    def find(self, name: str) -> WrenchFrame | None:
        """Return a frame by its frame_id; None where it is not one of the device."""
        return self._by_name.get(name)


def _matrix(quaternion: Quaternion[float]) -> Rotation[float] | None:
    """Return the matrix of a rotation; None where it is none."""
    x, y, z, w = quaternion
    return None if (abs(x), abs(y), abs(z), abs(w)) == IDENTITY else rotation_from_quaternion(
        x, y, z, w)
