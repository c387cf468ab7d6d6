# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is drawn over a device: three encoders alone, torques, names, the floor under it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from spm_haptic_master.description.links import LEGS, onto, SIZE
from spm_haptic_master.description.solids import Solid
from spm_haptic_master.kinematics import Geometry, quaternion_from_matrix
from spm_haptic_master.kinematics.joints import SHORT_NAMES
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.view import surfaces
from viser import ViserServer

# Colours of what three encoders alone report, of the floor, and of the torques commanded and
# rendered.
GHOST, FLOOR, TORQUES = (176, 55, 155), (238, 240, 243), ((90, 90, 90), (20, 120, 220))
# How much larger than the platform that of three encoders alone is drawn (unit 1): where both are
# the same, one surface is in front.
GHOST_SCALE, GHOST_OPACITY = 1.012, 0.55
# Floor: height, radius and corners (units of the scene).
FLOOR_HEIGHT, FLOOR_RADIUS, FLOOR_CORNERS = -0.06, 1.05, 48
# Distances of the names from O: encoders on motors and on third joints, legs, handle (units of the
# scene); and their size (unit 1).
AT_1, AT_3, OF_LEG, OF_HANDLE, LABEL_SIZE = 1.49, 1.02, 1.66, 1.7, 1.0
# Length of an arrow for 1 N m (units of the scene), and least torque with an arrow (N m).
TORQUE_LENGTH, LEAST_TORQUE = 3.0, 0.005


class Overlay:
    """
    What is drawn over one device; but for the floor hidden at first.

    The device's root in the scene has a name and an x; below it is the platform, a solid.
    `thirds` is the number of encoders on third joints: th3A, th3B, th3C.
    """

    def __init__(self, server: ViserServer, name: str, x: float, geometry: Geometry,
                 thirds: int, solid: Solid) -> None:
        scene, platform = server.scene, f'{name}/platform'
        self.ghost = surfaces.add(scene, f'{platform}/ghost', solid, [GHOST],
                                  scale=GHOST_SCALE / SIZE, opacity=GHOST_OPACITY, visible=False)
        self.torques = [
            surfaces.add(scene, f'{platform}/torque_{kind}', surfaces.ARROW, [colour],
                         visible=False)
            for kind, colour in zip(('commanded', 'rendered'), TORQUES, strict=True)]
        # It is in the scene's frame, whatever the mounting is.
        self._floor = surfaces.add(
            scene, f'/floor{name}', surfaces.polygon(FLOOR_RADIUS, FLOOR_CORNERS), [FLOOR],
            places=np.array([[x, 0.0, FLOOR_HEIGHT]]))
        first = np.array(geometry.base_axes)
        third = np.array(geometry.platform_axes)[:thirds]
        places = [
            *((name, f'th{SHORT_NAMES[k]}', AT_1 * axis) for k, axis in enumerate(first)),
            *((name, LEGS[k].upper(), OF_LEG * axis) for k, axis in enumerate(first)),
            *((platform, f'th{SHORT_NAMES[3 + k]}', AT_3 * axis) for k, axis in enumerate(third)),
            (platform, 'handle', np.array([0.0, 0.0, OF_HANDLE])), (name, 'O', np.zeros(3))]
        self.labels = [
            scene.add_label(f'{parent}/label_{text}', text, position=place, anchor='center-center',
                            font_screen_scale=LABEL_SIZE, visible=False)
            for parent, text, place in places]

    def show_ghost(self, turn: Quaternion[float] | None) -> None:
        """Show what three encoders alone report, turned from the platform; None: nothing."""
        self.ghost.visible = turn is not None
        if turn is not None:
            x, y, z, w = turn
            self.ghost.wxyz = w, x, y, z

    def show_torques(self, torques: Sequence[Sequence[float] | None]) -> None:
        """Show the torques commanded and rendered, N m, in the platform's frame; None: none."""
        for arrow, torque in zip(self.torques, torques, strict=True):
            size = 0.0 if torque is None else float(np.linalg.norm(torque))
            arrow.visible = shown = size >= LEAST_TORQUE
            if shown:
                x, y, z, w = quaternion_from_matrix(onto(np.asarray(torque) / size)).tolist()
                arrow.wxyz, arrow.scale = (w, x, y, z), (1.0, 1.0, TORQUE_LENGTH * size)

    def remove(self) -> None:
        """Take from the scene what is not below the device's root."""
        self._floor.remove()
