# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device in 3D, as nodes of viser's scene, what is drawn over it, and its workspace."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from functools import partial
from math import isfinite, pi, tan

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.description import solids
from spm_haptic_master.description.colours import css
from spm_haptic_master.description.workspace_map import HALF_ANGLE, WorkspaceMap
from spm_haptic_master.kinematics import Geometry, mechanism_angles, workspace_pose
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.joints import SHORT_NAMES
from spm_haptic_master.kinematics.mounting import IDENTITY
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.view import surfaces
from spm_haptic_master.view.surfaces import rgb, wxyz
from viser import BatchedMeshHandle, LineSegmentsHandle, SceneApi

# Units of the scene for a metre: the proximal links are 1 unit from O.
SCALE = 1.0 / solids.SIZE
# Distance of two arms from each other (units of the scene): their bases are 2 wide.
ARM_DISTANCE = 2.6
# Colour of a device that is not shown as it is now, and of encoders without a state.
GREY = '#969696'
# Pointer from the handle along the platform's x, the hand of its self-rotation: radius, length,
# height on the handle (unit SIZE).
POINTER, POINTER_AT = (0.018, 0.0, 0.8), 0.97
# Axes of the platform's frame, as `cylinder` has them, and the colours of x, y, z.
AXIS = 0.012, 0.0, 0.42
AXIS_COLOURS = ['#cc0000', '#00cc00', '#0000cc']
# Cone of the protection level: colour, corners, opacity; magnification, widest half angle (rad).
LEVEL, LEVEL_CORNERS, LEVEL_OPACITY = '#d6601e', 36, 0.22
MAGNIFICATION, WIDEST = 10.0, 0.35
# Ghost of three encoders alone: colour, opacity; size that keeps it in front of the platform.
GHOST, GHOST_OPACITY, GHOST_SCALE = '#b0379b', 0.55, 1.012
# Colours of the torques commanded and rendered; length of an arrow for 1 N m (units of the scene),
# and least torque with an arrow (N m).
TORQUES = {'commanded': '#5a5a5a', 'rendered': '#1478dc'}
TORQUE_LENGTH, LEAST_TORQUE = 3.0, 0.005
# Floor: colour, height, and radius (units of the scene), corners.
FLOOR, FLOOR_HEIGHT, FLOOR_RADIUS, FLOOR_CORNERS = '#eef0f3', -0.06, 1.05, 48
# Distances of the names from O: encoders on motors and on third joints, legs, handle (units of the
# scene).
MOTOR_AT, THIRD_AT, LEG_AT, HANDLE_AT = 1.49, 1.02, 1.66, 1.7
# Radius of the dome about O, outside the handle; radius of its tiles and of the ball at the end of
# the trace (units of the scene); opacity.
RADIUS, TILE_RADIUS, PIN_RADIUS, TILE_OPACITY = 1.78, 0.042, 0.03, 0.75
# Singularities: colour, size (units of the scene), and how much higher than the tiles (unit 1).
SINGULAR, SINGULAR_SIZE, SINGULAR_RATIO = '#460014', 0.022, 1.004
# Lines: colours of trace and rim, width (pixels).
TRACE_COLOUR, LINE_WIDTH = '#141414', 2.0
# Points of the trace, and least distance of two of them (unit of the scene).
TRACE_POINTS, TRACE_STEP = 300, 0.004


class Dome:
    """The dome of a device, below a frame of the scene, `root`."""

    def __init__(
        self, scene: SceneApi, root: str, geometry: Geometry, working_mode: WorkingMode
    ) -> None:
        def line(name: str, segments: NDArray[np.float64], colour: str) -> LineSegmentsHandle:
            # As wide as in the scene, a line is drawn twice, by two programs.
            return scene.add_line_segments(
                f'{root}/{name}',
                segments,
                rgb([colour])[0],
                thickness=LINE_WIDTH,
                thickness_units='screen',
            )

        self._map = WorkspaceMap(geometry, working_mode)
        self._points: deque[NDArray[np.float64]] = deque(maxlen=TRACE_POINTS)
        axes = self._map.axes
        self.tiles = surfaces.add(
            scene,
            f'{root}/map',
            surfaces.two_sided(surfaces.fan(TILE_RADIUS, 0.0, 6)),
            self._map.colours(0.0),
            axes,
            RADIUS * axes,
            opacity=TILE_OPACITY,
        )
        self.singular = scene.add_point_cloud(
            f'{root}/singular',
            np.zeros((1, 3)),
            rgb([SINGULAR])[0],
            point_size=SINGULAR_SIZE,
            point_shape='circle',
            point_shading='flat',
            precision='float32',
            visible=False,
        )
        rim = RADIUS * workspace_pose(HALF_ANGLE, np.linspace(0.0, 2.0 * pi, 97), 0.0)[..., 2]
        line('rim', np.stack([rim[:-1], rim[1:]], axis=1), GREY)
        self.trace = line('trace', np.zeros((1, 2, 3)), TRACE_COLOUR)
        self.pin = surfaces.add(
            scene, f'{root}/pin', surfaces.ball(PIN_RADIUS), rgb([TRACE_COLOUR]), visible=False
        )

    def move(self, axis: Sequence[float]) -> None:
        """Continue the trace of the handle's axis, a unit vector in the base frame."""
        point = RADIUS * np.asarray(axis)
        self.pin.position, self.pin.visible = point, True
        if self._points and np.abs(point - self._points[-1]).max() < TRACE_STEP:
            return
        self._points.append(point)
        points = np.array(self._points)
        segments = np.stack([points[:-1], points[1:]], axis=1)
        segments = segments[np.isfinite(segments).all(axis=(1, 2))]
        if len(segments):
            self.trace.points = segments.astype(np.float32)

    def break_trace(self) -> None:
        """Interrupt the trace: the motion meanwhile is not known."""
        if self._points and np.isfinite(self._points[-1]).all():
            self._points.append(np.full(3, np.nan))

    def paint(self, phi: float) -> None:
        """Paint the map for a self-rotation, rad."""
        self.tiles.batched_colors = self._map.colours(phi)
        points = SINGULAR_RATIO * RADIUS * self._map.singular_axes(phi)
        self.singular.visible = are_there = bool(len(points))
        if are_there:
            self.singular.points = points.astype(np.float32)


class Scene:
    """
    One device, with its number among the devices: the second one is beside the first.

    `table` is the quaternion x, y, z, w of R_table_base, `sensors` the number of encoders.
    """

    def __init__(
        self,
        scene: SceneApi,
        number: int,
        geometry: Geometry,
        working_mode: WorkingMode,
        table: Quaternion[float],
        sensors: int,
    ) -> None:
        centre = workspace_pose(0.0, 0.0, 0.0)
        # A mechanism that cannot be assembled there is refused.
        angles = mechanism_angles(tuple(centre.ravel().tolist()), geometry, working_mode)
        # Without a mounting the device is upright: the axis of its workspace is vertical.
        x, y, z, w = table
        place = np.array([ARM_DISTANCE * number, 0.0, 0.0])
        self._root = scene.add_frame(
            f'/arm{number}',
            show_axes=False,
            position=place,
            wxyz=wxyz(centre.T) if table == IDENTITY else np.array([w, x, y, z]),
        )
        self._frame = scene.add_frame(f'{self._root.name}/platform', show_axes=False)
        # Frames of what is beside the device: `show_rest` shows it.
        self._rest = [
            scene.add_frame(f'{frame.name}/rest', show_axes=False, visible=False)
            for frame in (self._root, self._frame)
        ]
        fixed, turned, fixed_rest, turned_rest = (
            frame.name for frame in (self._root, self._frame, *self._rest)
        )
        add = partial(surfaces.add, scene, scale=SCALE)
        self._geometry, shapes = geometry, solids.solids(geometry)
        base = add(f'{fixed}/base', shapes['base'], rgb([css('base')]))
        # Encoders have the colours of their states: first those on motors, then those on the third
        # joints th3A, th3B, th3C.
        self._motors = add(
            f'{fixed}/motors',
            solids.cylinder(solids.MOTOR_ENCODER),
            rgb([GREY] * len(solids.LEGS)),
            geometry.base_axes,
        )
        thirds = geometry.platform_axes[: sensors - len(solids.LEGS)]
        self._others = add(
            f'{turned}/encoder',
            solids.cylinder(solids.THIRD_ENCODER),
            rgb([GREY] * len(thirds)),
            thirds,
        )
        # Links of one shape, turned by one message: their rows in `link_turns`.
        self._batches: list[tuple[list[int], BatchedMeshHandle]] = []
        for first, kind, spans in (
            (0, 'proximal', geometry.alphas),
            (len(solids.LEGS), 'distal', geometry.betas),
        ):
            for span in dict.fromkeys(spans):
                legs = [k for k, each in enumerate(spans) if each == span]
                link = f'{kind}_{solids.LEGS[legs[0]]}'
                self._batches.append(
                    (
                        [first + k for k in legs],
                        add(
                            f'{fixed}/{link}',
                            shapes[link],
                            rgb([css(f'leg_{solids.LEGS[k]}') for k in legs]),
                        ),
                    )
                )
        pointer = solids.cylinder(POINTER).turned(solids.onto((1.0, 0.0, 0.0)))
        platform = solids.together(
            shapes['platform'],
            solids.Solid(
                pointer.vertices + (0.0, 0.0, solids.SIZE * POINTER_AT), pointer.triangles
            ),
        )
        # Parts that turn grey, with their own colours.
        self._coloured = [
            (handle, handle.batched_colors.copy())
            for handle in (
                base,
                *(links for _, links in self._batches),
                add(f'{turned}/solid', platform, rgb([css('platform')])),
                add(f'{turned}/axes', solids.cylinder(AXIS), rgb(AXIS_COLOURS), np.eye(3)),
            )
        ]
        # To be scaled to the protection level.
        self.level = surfaces.add(
            scene,
            f'{turned_rest}/level',
            surfaces.two_sided(surfaces.fan(RADIUS, RADIUS, LEVEL_CORNERS)),
            rgb([LEVEL]),
            opacity=LEVEL_OPACITY,
            visible=False,
        )
        self.dome = Dome(scene, fixed_rest, geometry, working_mode)
        self.ghost = surfaces.add(
            scene,
            f'{turned_rest}/ghost',
            platform,
            rgb([GHOST]),
            scale=GHOST_SCALE / solids.SIZE,
            opacity=GHOST_OPACITY,
            visible=False,
        )
        self.torques = [
            surfaces.add(
                scene, f'{turned}/torque_{kind}', surfaces.ARROW, rgb([colour]), visible=False
            )
            for kind, colour in TORQUES.items()
        ]
        # It is in the scene's frame, whatever the mounting is.
        self._floor = surfaces.add(
            scene,
            f'/floor{fixed}',
            surfaces.fan(FLOOR_RADIUS, 0.0, FLOOR_CORNERS),
            rgb([FLOOR]),
            places=place[None] + (0.0, 0.0, FLOOR_HEIGHT),
        )
        axes = np.array(geometry.base_axes)
        for parent, text, at in (
            *((fixed_rest, f'th{SHORT_NAMES[k]}', MOTOR_AT * z) for k, z in enumerate(axes)),
            *((fixed_rest, solids.LEGS[k].upper(), LEG_AT * z) for k, z in enumerate(axes)),
            *(
                (turned_rest, f'th{SHORT_NAMES[len(solids.LEGS) + k]}', THIRD_AT * np.array(z))
                for k, z in enumerate(thirds)
            ),
            (turned_rest, 'handle', np.array([0.0, 0.0, HANDLE_AT])),
            (fixed_rest, 'O', np.zeros(3)),
        ):
            scene.add_label(
                f'{parent}/label_{text}',
                text,
                position=at,
                anchor='center-center',
                font_screen_scale=1.0,
            )
        self.place(angles)
        self.set_alive(False)

    def place(self, angles: Sequence[float]) -> None:
        """Turn the links to the angles of `joint_states`, rad."""
        rows = np.array(solids.link_turns(self._geometry, angles))[:, [3, 0, 1, 2]]
        for links, batch in self._batches:
            batch.batched_wxyzs = rows[links]
        self._frame.wxyz = rows[-1]

    def show_sensors(self, colours: Sequence[str]) -> None:
        """Give each encoder the colour of its state, as CSS has it: #rrggbb."""
        sensors = rgb(colours)
        self._motors.batched_colors = sensors[: len(solids.LEGS)]
        self._others.batched_colors = sensors[len(solids.LEGS) :]

    def show_rest(self) -> None:
        """Show what is beside the device: dome, names, cone, and what three encoders report."""
        for frame in self._rest:
            frame.visible = True

    def show_level(self, level: float) -> None:
        """Show the cone of the protection level, rad, magnified; nan: none."""
        self.level.visible = isfinite(level)
        if isfinite(level):
            width = tan(min(MAGNIFICATION * level, WIDEST))
            self.level.scale = (width, width, 1.0)

    def show_ghost(self, turn: Quaternion[float] | None) -> None:
        """Show what three encoders alone report, turned from the platform; None: nothing."""
        self.ghost.visible = turn is not None
        if turn is not None:
            x, y, z, w = turn
            self.ghost.wxyz = w, x, y, z

    def show_torques(self, torques: Sequence[Sequence[float]]) -> None:
        """Show the torques commanded and rendered, N m, in the platform's frame."""
        for arrow, torque in zip(self.torques, torques, strict=True):
            size = float(np.linalg.norm(torque))
            arrow.visible = shown = size >= LEAST_TORQUE
            if shown:
                arrow.wxyz = wxyz(solids.onto(np.asarray(torque) / size))
                arrow.scale = (1.0, 1.0, TORQUE_LENGTH * size)

    def set_alive(self, alive: bool) -> None:
        """Give the device its colours, or turn it grey: it does not show the present pose."""
        for handle, colours in self._coloured:
            handle.batched_colors = colours if alive else rgb([GREY] * len(colours))
        if not alive:
            self.level.visible = False

    def remove(self) -> None:
        """Take the device out of the scene."""
        self._root.remove()
        self._floor.remove()
