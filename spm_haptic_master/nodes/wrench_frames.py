# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The frames in which a torque on the handle may be commanded."""

from __future__ import annotations

from typing import NamedTuple

from spm_haptic_master.kinematics.mounting import IDENTITY, Mounting
from spm_haptic_master.kinematics.number_backends import Rotation
from spm_haptic_master.kinematics.rotations import conjugate, rotation_from_quaternion
from spm_haptic_master.parameters.geometry import mounting_from
from spm_haptic_master.parameters.setting import Values


class WrenchFrame(NamedTuple):
    """A frame of torques on the handle."""

    name: str  # frame_id
    in_handle: bool  # turns with the platform; else in the base frame
    rotation: Rotation[float]  # R_platform_frame or R_base_frame


class WrenchFrames:
    """
    The frames of a device.

    Parameters
    ----------
    values : Values
        Settings of `fkm`.
    reference : str
        Frame of `orientation`: the table's where the base is mounted on it, or else the base's.

    Attributes
    ----------
    spatial, body : WrenchFrame
        Of the topics `spatial/` and `body/`.
    by_name : dict of str to WrenchFrame
        Of the `frame_id` of a header.

    """

    def __init__(self, values: Values, reference: str) -> None:
        mounting = mounting_from(values) or Mounting()
        base = values['frame_id']
        platform = values['mounting.platform_frame_id']
        handle = values['mounting.handle_frame_id']
        same = rotation_from_quaternion(*IDENTITY)
        is_mounted = tuple(map(abs, mounting.handle)) != IDENTITY
        # Components in the table's frame to those in the base's: R_table_base^T.
        self.spatial = WrenchFrame(
            name=reference,
            in_handle=False,
            rotation=rotation_from_quaternion(*conjugate(mounting.base)),
        )
        self.body = WrenchFrame(
            name=handle if is_mounted else platform,
            in_handle=True,
            rotation=rotation_from_quaternion(*mounting.handle),
        )
        # CRTK clients leave the frame of a header empty: it is that of `orientation`.
        self.by_name = {
            base: WrenchFrame(name=base, in_handle=False, rotation=same),
            platform: WrenchFrame(name=platform, in_handle=True, rotation=same),
            '': self.spatial,
            reference: self.spatial,
            handle: self.body._replace(name=handle),
        }
