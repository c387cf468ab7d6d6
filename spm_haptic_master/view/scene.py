# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device in 3D, as nodes of viser's scene, and what is drawn over it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import hypot, isfinite, tan

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.description import solids
from spm_haptic_master.description.colours import ALL_ENCODERS, COMMANDED, css, RENDERED
from spm_haptic_master.kinematics import Geometry, mechanism_angles, workspace_pose
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.mounting import IDENTITY
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.view import surfaces
from spm_haptic_master.view.dome import Dome
from spm_haptic_master.view.ghost import flag, Ghost
from spm_haptic_master.view.names import SENSOR_NAMES
from spm_haptic_master.view.status import SensorState
from spm_haptic_master.view.surfaces import GREY, rgb, wxyz
from viser import BatchedMeshHandle, LabelHandle, SceneApi

# Units of the scene for a metre: the proximal links are 1 unit from O.
SCALE = 1.0 / solids.SIZE
# Distance of two arms from each other (units of the scene): their bases are 2 wide.
ARM_DISTANCE = 2.6
# Axes of the platform's frame, as `cylinder` has them, and the colours of x, y, z.
AXIS = solids.Cylinder(
    radius=0.012,
    low=0.0,
    high=0.42,
)
AXIS_COLOURS = ['#cc0000', '#00cc00', '#0000cc']
# Cone of the protection level: corners, opacity; magnification, widest half angle (rad).
LEVEL_CORNERS = 36
LEVEL_OPACITY = 0.2
MAGNIFICATION = 10.0
WIDEST = 0.35
LEVEL_HEIGHT = 1.78
# Colours of the torques commanded and rendered; length of an arrow for 1 N m (units of the scene),
# and least torque with an arrow (N m).
TORQUES = {'commanded': COMMANDED.light, 'rendered': RENDERED.light}
TORQUE_LENGTH = 3.0
LEAST_TORQUE = 0.005
# Floor: colour, height, and radius (units of the scene), corners.
FLOOR = '#9aa3ad'
FLOOR_HEIGHT = -0.06
FLOOR_RADIUS = 1.05
FLOOR_CORNERS = 48
FLOOR_OPACITY = 0.25
# Where the name of the device is on the floor (units of the scene).
NAME_AT = 0.0, -1.3, 0.0
# Distances of the names from O: encoders on motors and on third joints, legs (where each begins),
# handle (units of the scene).
MOTOR_AT = 1.49
THIRD_AT = 1.02
LEG_AT = 1.0
HANDLE_AT = 1.7
# States of an encoder whose sign is not at its name.
UNMARKED = SensorState.HEALTHY, SensorState.UNKNOWN


class Scene:
    """
    One device in the scene, with its name if it has one.

    Parameters
    ----------
    scene : SceneApi
        The scene of the page.
    name : str
        Name of the device; empty without a namespace.
    geometry : Geometry
        The mechanism.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.
    table : tuple of 4 float
        Quaternion x, y, z, w of R_table_base.
    sensors : int
        Number of encoders, 4 to 6.

    Raises
    ------
    SpmError
        The mechanism cannot be assembled at the workspace's centre.

    Attributes
    ----------
    dome : Dome
        Map and trace over the device.
    ghost : Ghost
        Platform as three encoders alone report it.
    level : BatchedMeshHandle
        Cone of the protection level.
    torques : list of BatchedMeshHandle
        Arrows of the torques commanded and rendered.

    """

    def __init__(
        self,
        scene: SceneApi,
        name: str,
        geometry: Geometry,
        working_mode: WorkingMode,
        table: Quaternion[float],
        sensors: int,
    ) -> None:
        self._scene = scene
        self._geometry = geometry
        self._thirds = geometry.platform_axes[: sensors - len(solids.LEGS)]
        self._shapes = solids.solids(geometry)
        self._add_frames(f'arm_{name.replace("/", "_")}' if name else 'arm', table)
        # Parts that turn grey, with their own colours.
        self._coloured: list[tuple[BatchedMeshHandle, NDArray[np.uint8]]] = []
        self._add_links()
        self._add_platform()
        self._add_encoders()
        self.dome = Dome(
            scene=scene,
            root=self._fixed_rest.name,
            geometry=geometry,
            working_mode=working_mode,
        )
        self.ghost = Ghost(
            scene=scene,
            root=self._turned_rest.name,
            platform=self._shapes['platform'],
        )
        self._add_level()
        self.torques = [
            surfaces.add(
                scene,
                f'{self._turned.name}/torque_{kind}',
                surfaces.ARROW,
                rgb([colour]),
                visible=False,
            )
            for kind, colour in TORQUES.items()
        ]
        self._add_floor(name)
        self._sensor_labels = self._add_labels()
        # A mechanism that cannot be assembled at the workspace's centre is refused.
        centre = workspace_pose(0.0, 0.0, 0.0)
        self.place(mechanism_angles(tuple(centre.ravel().tolist()), geometry, working_mode))
        self.set_alive(False)

    def _add_frames(
        self,
        root: str,
        table: Quaternion[float],
    ) -> None:
        """Add the frames of the base and of the platform, and of what is beside the device."""
        scene = self._scene
        x, y, z, w = table
        # Without a mounting the device is upright: the axis of its workspace is vertical.
        upright = wxyz(workspace_pose(0.0, 0.0, 0.0).T)
        self._fixed = scene.add_frame(
            f'/{root}',
            show_axes=False,
            wxyz=upright if table == IDENTITY else np.array([w, x, y, z]),
        )
        self._turned = scene.add_frame(f'/{root}/platform', show_axes=False)
        self._floor = scene.add_frame(f'/floor_{root}', show_axes=False)
        self._fixed_rest, self._turned_rest = (
            scene.add_frame(f'{frame.name}/rest', show_axes=False, visible=False)
            for frame in (self._fixed, self._turned)
        )

    def _add_coloured(
        self,
        path: str,
        solid: solids.Solid,
        colours: Sequence[str],
        axes: Sequence[object] | NDArray[np.float64] | None = None,
    ) -> BatchedMeshHandle:
        """Add a part that turns grey with the device."""
        handle = surfaces.add(
            self._scene,
            path,
            solid,
            rgb(colours),
            axes,
            scale=SCALE,
        )
        self._coloured.append((handle, handle.batched_colors.copy()))
        return handle

    def _add_links(self) -> None:
        """Add base and links; links of one shape are turned by one message."""
        fixed = self._fixed.name
        self._add_coloured(f'{fixed}/base', self._shapes['base'], [css('base')])
        # Rows of the links in `link_turns`, and their handle.
        self._batches: list[tuple[list[int], BatchedMeshHandle]] = []
        geometry = self._geometry
        for first, kind, spans in (
            (0, 'proximal', geometry.alphas),
            (len(solids.LEGS), 'distal', geometry.betas),
        ):
            for span in dict.fromkeys(spans):
                legs = [leg for leg, other in enumerate(spans) if other == span]
                link = f'{kind}_{solids.LEGS[legs[0]]}'
                colours = [css(f'leg_{solids.LEGS[leg]}') for leg in legs]
                handle = self._add_coloured(f'{fixed}/{link}', self._shapes[link], colours)
                self._batches.append(([first + leg for leg in legs], handle))

    def _add_platform(self) -> None:
        """Add the platform with its handle and flag, and its axes."""
        turned = self._turned.name
        platform = solids.together(self._shapes['platform'], flag())
        self._add_coloured(f'{turned}/solid', platform, [css('platform')])
        self._add_coloured(
            path=f'{turned}/axes',
            solid=solids.cylinder(AXIS),
            colours=AXIS_COLOURS,
            axes=np.eye(3),
        )

    def _add_encoders(self) -> None:
        """Add the encoders, in the colours of their states."""
        add = partial(surfaces.add, self._scene, scale=SCALE)
        self._motors = add(
            f'{self._fixed.name}/motors',
            solids.cylinder(solids.MOTOR_ENCODER),
            rgb([GREY] * len(solids.LEGS)),
            self._geometry.base_axes,
        )
        self._others = add(
            f'{self._turned.name}/encoder',
            solids.cylinder(solids.THIRD_ENCODER),
            rgb([GREY] * len(self._thirds)),
            self._thirds,
        )

    def _add_level(self) -> None:
        """Add the cone that is scaled to the protection level."""
        self.level = surfaces.add(
            self._scene,
            f'{self._turned_rest.name}/level',
            surfaces.two_sided(surfaces.fan(LEVEL_HEIGHT, LEVEL_HEIGHT, LEVEL_CORNERS)),
            rgb([ALL_ENCODERS.light]),
            opacity=LEVEL_OPACITY,
            visible=False,
        )

    def _add_floor(self, name: str) -> None:
        """Add the floor, which is in the scene's frame whatever the mounting is, and the name."""
        surfaces.add(
            self._scene,
            f'{self._floor.name}/disc',
            surfaces.fan(FLOOR_RADIUS, 0.0, FLOOR_CORNERS),
            rgb([FLOOR]),
            places=np.array([[0.0, 0.0, FLOOR_HEIGHT]]),
            opacity=FLOOR_OPACITY,
        )
        if name:
            self._scene.add_label(
                f'{self._floor.name}/name',
                name,
                position=np.array(NAME_AT),
                anchor='center-center',
                font_screen_scale=1.6,
            )

    def _add_labels(self) -> list[LabelHandle]:
        """Add the names of encoders, legs, handle and O; return those of the encoders."""
        axes = np.array(self._geometry.base_axes)
        fixed = self._fixed_rest.name
        turned = self._turned_rest.name
        for leg, axis in zip(solids.LEGS, axes, strict=True):
            self._add_label(fixed, leg.upper(), LEG_AT * axis)
        self._add_label(fixed, 'O', np.zeros(3))
        self._add_label(turned, 'handle', np.array([0.0, 0.0, HANDLE_AT]))
        motors = [
            self._add_label(fixed, name, MOTOR_AT * axis)
            for name, axis in zip(SENSOR_NAMES, axes, strict=False)
        ]
        others = [
            self._add_label(turned, name, THIRD_AT * np.array(axis))
            for name, axis in zip(SENSOR_NAMES[len(motors) :], self._thirds, strict=False)
        ]
        return motors + others

    def _add_label(
        self,
        parent: str,
        text: str,
        position: NDArray[np.float64],
    ) -> LabelHandle:
        """Add a name at a place of a frame (units of the scene)."""
        return self._scene.add_label(
            f'{parent}/label_{text}',
            text,
            position=position,
            anchor='center-center',
            font_screen_scale=1.0,
        )

    def stand(self, rank: int) -> None:
        """
        Let the device stand at a place of the row, from 0.

        Parameters
        ----------
        rank : int
            Place; the devices stand side by side along x of the scene.

        """
        place = np.array([ARM_DISTANCE * rank, 0.0, 0.0])
        self._fixed.position = place
        self._floor.position = place

    def place(self, angles: Sequence[float]) -> None:
        """
        Turn the links to the angles of `joint_states`, rad.

        Parameters
        ----------
        angles : sequence of 9 float
            Angles in the order of MECHANISM_JOINT_NAMES.

        """
        rows = np.array(solids.link_turns(self._geometry, angles))[:, [3, 0, 1, 2]]
        for links, batch in self._batches:
            batch.batched_wxyzs = rows[links]
        self._turned.wxyz = rows[-1]

    def show_sensors(self, states: Sequence[SensorState]) -> None:
        """
        Give each encoder the colour of its state, and its name the sign.

        Parameters
        ----------
        states : sequence of SensorState
            States in the order of a sample; a healthy or unknown one has no sign at its name.

        """
        colours = rgb([state.colour for state in states])
        self._motors.batched_colors = colours[: len(solids.LEGS)]
        self._others.batched_colors = colours[len(solids.LEGS) :]
        for label, name, state in zip(
            self._sensor_labels,
            SENSOR_NAMES,
            states,
            strict=False,
        ):
            label.text = name if state in UNMARKED else f'{name} {state.sign}'

    def show_rest(self) -> None:
        """Show what is beside the device: dome, names, cone, and what three encoders report."""
        self._fixed_rest.visible = True
        self._turned_rest.visible = True

    def show_level(self, level: float) -> None:
        """
        Show the cone of the protection level, rad, magnified; nan: none.

        Parameters
        ----------
        level : float
            Protection level. The half angle of the cone is MAGNIFICATION times as large, at most
            WIDEST.

        """
        self.level.visible = isfinite(level)
        if isfinite(level):
            width = tan(min(MAGNIFICATION * level, WIDEST))
            self.level.scale = (width, width, 1.0)

    def show_torques(self, torques: Sequence[Sequence[float]]) -> None:
        """
        Show the torques commanded and rendered, N m, in the platform's frame.

        Parameters
        ----------
        torques : sequence of two sequences of 3 float
            x, y, z of each. A torque below LEAST_TORQUE, or one that is not finite, has no arrow.

        """
        for arrow, torque in zip(self.torques, torques, strict=True):
            size = hypot(*torque)
            is_shown = isfinite(size) and size >= LEAST_TORQUE
            arrow.visible = is_shown
            if is_shown:
                arrow.wxyz = wxyz(solids.onto(np.asarray(torque) / size))
                arrow.scale = (1.0, 1.0, TORQUE_LENGTH * size)

    def set_alive(self, alive: bool) -> None:
        """
        Give the device its colours, or turn it grey: it does not show the present pose.

        Parameters
        ----------
        alive : bool
            Whether the device shows the present pose; if not, cone and ghost are hidden as well.

        """
        for handle, colours in self._coloured:
            if alive:
                handle.batched_colors = colours
            else:
                handle.batched_colors = rgb([GREY] * len(colours))
        if not alive:
            self.level.visible = False
            self.ghost.show(None)

    def remove(self) -> None:
        """Take the device out of the scene."""
        self._fixed.remove()
        self._floor.remove()
