# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device in 3D, as nodes of viser's scene."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from math import isfinite, pi, tan

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.description.colours import rgb
from spm_haptic_master.description.links import (
    Encoder,
    LEGS,
    LinkTurns,
    MOTOR_ENCODER,
    onto,
    SIZE,
    solids,
    THIRD_ENCODER,
)
from spm_haptic_master.description.solids import disc, Solid, together
from spm_haptic_master.description.workspace_map import HALF_ANGLE, WorkspaceMap
from spm_haptic_master.kinematics import (
    Geometry,
    mechanism_angles,
    quaternion_from_matrix,
    workspace_pose,
)
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.mounting import IDENTITY
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.view import surfaces
from spm_haptic_master.view.overlay import Overlay
from viser import BatchedMeshHandle, LineSegmentsHandle, ViserServer

# Units of the scene for a metre: the proximal links are 1 unit from O.
SCALE = 1.0 / SIZE
# Radius of the map of the workspace about O, outside the handle, and size of its tiles.
MAP_RADIUS, TILE = 1.78, 0.042
# Colour of a device that is not shown as it is now, and of singularities, trace and cone.
GREY = (150, 150, 150)
SINGULAR, TRACE, LEVEL = (70, 0, 20), (20, 20, 20), (214, 96, 30)
# Axes of the platform's frame: radius and length (units of the scene), and colours of x, y, z.
AXIS_RADIUS, AXIS_LENGTH = 0.012, 0.42
AXIS_COLOURS = [(204, 0, 0), (0, 204, 0), (0, 0, 204)]
# Radius of the ball at the end of the trace (units of the scene), and width of lines (pixels).
PIN_RADIUS, LINE = 0.03, 2.0
# Points of the trace, and least distance of two of them (unit of the scene).
TRACE_POINTS, TRACE_STEP = 300, 0.004
# Least change of the self-rotation after which the map is painted again (rad).
MAP_STEP = 0.004
# Corners of a cone about the handle's axis.
CONE_CORNERS = 36
# Opacity of that cone, and of the map.
LEVEL_OPACITY, MAP_OPACITY = 0.22, 0.75
# How many times as wide as it is the cone is drawn, and the half angle at which it ends (rad).
MAGNIFICATION, WIDEST_CONE = 10.0, 0.35
# Distance of two arms from each other (units of the scene): their bases are 2 wide.
ARM_DISTANCE = 2.6
# Self-rotation of the pose before the first one comes (rad): a mechanism that cannot be assembled
# there is refused.
FIRST_PHI = 0.0


class Scene:
    """
    One device, below a root with a name; the second device is beside the first.

    `table` is the quaternion x, y, z, w of R_table_base, `sensors` the number of encoders.
    """

    def __init__(self, server: ViserServer, name: str, number: int, geometry: Geometry,
                 working_mode: WorkingMode, table: Quaternion[float], sensors: int = 4) -> None:
        first = mechanism_angles(tuple(workspace_pose(0.0, 0.0, FIRST_PHI).ravel().tolist()),
                                 geometry, working_mode)
        self._server, self._name = server, name
        self._phi: float | None = None
        self._trace: deque[NDArray[np.float64]] = deque(maxlen=TRACE_POINTS)
        self._alive: bool | None = None
        self._map = WorkspaceMap(geometry, working_mode)
        # Without a mounting the device is upright: its workspace is about the vertical.
        x, y, z, w = _upright() if table == IDENTITY else table
        place = ARM_DISTANCE * number
        self._root = server.scene.add_frame(
            name, show_axes=False, wxyz=(w, x, y, z), position=(place, 0.0, 0.0))
        self._turns = LinkTurns(geometry)
        # What turns grey, and its own colours.
        self._coloured: list[tuple[BatchedMeshHandle, NDArray[np.uint8]]] = []
        # Links of one shape, which one message turns: where they are in `LinkTurns.at`.
        self._batches: list[tuple[list[int], BatchedMeshHandle]] = []
        # Colours of the encoders.
        self._sensors = np.full((sensors, 3), GREY, np.uint8)
        # Number of encoders on third joints: th3A, th3B, th3C.
        thirds = sensors - len(LEGS)
        shapes = solids(geometry)
        platform = together(shapes['platform'], surfaces.pointer())
        self._add_links(geometry, shapes)
        self._frame = server.scene.add_frame(f'{name}/platform', show_axes=False)
        self._add_batch('platform/solid', platform, ['platform'])
        self._others = self._add_encoders(
            'platform/encoder', THIRD_ENCODER, geometry.platform_axes[:thirds])
        self._add_batch('platform/axes', disc(AXIS_RADIUS * SIZE, 0.0, AXIS_LENGTH * SIZE),
                        AXIS_COLOURS, [onto(axis) for axis in np.eye(3)])
        # To be scaled to the protection level.
        self._level = surfaces.add(
            server.scene, f'{name}/platform/level',
            surfaces.two_sided(surfaces.cone(MAP_RADIUS, CONE_CORNERS)), [LEVEL],
            opacity=LEVEL_OPACITY, visible=False)
        self._add_map()
        self.overlay = Overlay(server, name, place, geometry, thirds, platform)
        self.show_rest(False)
        self.place(first)
        self.set_alive(False)

    def _add_links(self, geometry: Geometry, shapes: Mapping[str, Solid]) -> None:
        self._add_batch('base', shapes['base'], ['base'])
        self._motors = self._add_encoders('motors', MOTOR_ENCODER, geometry.base_axes)
        kinds = {'proximal': geometry.alphas, 'distal': geometry.betas}
        for number, (kind, spans) in enumerate(kinds.items()):
            for span in dict.fromkeys(spans):
                legs = [k for k, each in enumerate(spans) if each == span]
                link = f'{kind}_{LEGS[legs[0]]}'
                handle = self._add_batch(link, shapes[link], [f'leg_{LEGS[k]}' for k in legs])
                self._batches.append(([3 * number + k for k in legs], handle))

    def _add_batch(self, path: str, solid: Solid, colours: Sequence[str | tuple[int, int, int]],
                   turns: Sequence[NDArray[np.float64]] | None = None) -> BatchedMeshHandle:
        """Add a solid once for each colour, grey while the device is not alive."""
        alive = np.array([rgb(each) if isinstance(each, str) else each for each in colours],
                         np.uint8)
        handle = surfaces.add(
            self._server.scene, f'{self._name}/{path}', solid, alive, turns, scale=SCALE)
        self._coloured.append((handle, alive))
        return handle

    def _add_encoders(self, path: str, encoder: Encoder,
                      axes: Sequence[Sequence[float]]) -> BatchedMeshHandle:
        """Add encoders on some axes; they have the colours of their states, grey at first."""
        return surfaces.add(
            self._server.scene, f'{self._name}/{path}',
            disc(encoder.radius, encoder.low, encoder.high), [GREY] * len(axes),
            [onto(np.array(axis)) for axis in axes], scale=SCALE)

    def _add_map(self) -> None:
        scene, root = self._server.scene, self._name
        axes = self._map.axes
        self._tiles = surfaces.add(
            scene, f'{root}/map', surfaces.two_sided(surfaces.polygon(TILE, 6)),
            self._map.colours(FIRST_PHI), [onto(axis) for axis in axes], MAP_RADIUS * axes,
            opacity=MAP_OPACITY)
        self._singular = scene.add_point_cloud(
            f'{root}/singular', np.zeros((1, 3)), SINGULAR, point_size=0.022,
            point_shape='circle', point_shading='flat', precision='float32')
        turn = np.linspace(0.0, 2.0 * pi, 97)
        rim = MAP_RADIUS * workspace_pose(HALF_ANGLE, turn, 0.0)[..., 2]
        self._rim = self._add_line('rim', np.stack([rim[:-1], rim[1:]], axis=1), GREY)
        self._line = self._add_line('trace', np.zeros((1, 2, 3)), TRACE)
        self._pin = surfaces.add(scene, f'{root}/pin', surfaces.ball(PIN_RADIUS), [TRACE])

    def _add_line(self, name: str, segments: NDArray[np.float64],
                  colour: tuple[int, int, int]) -> LineSegmentsHandle:
        # As wide as in the scene, a line is drawn twice, by two programs.
        return self._server.scene.add_line_segments(
            f'{self._name}/{name}', segments, colour, thickness=LINE, thickness_units='screen')

    def place(self, angles: Sequence[float]) -> None:
        """Turn the links to the angles of `joint_states`, rad."""
        rows = np.array(self._turns.at(angles))[:, [3, 0, 1, 2]]
        for links, batch in self._batches:
            batch.batched_wxyzs = rows[links]
        self._frame.wxyz = rows[-1]

    def show_sensors(self, colours: Sequence[str]) -> None:
        """Give each encoder the colour of its state, as CSS has it: #rrggbb."""
        sensors = np.array([tuple(bytes.fromhex(each[1:])) for each in colours], np.uint8)
        if np.array_equal(sensors, self._sensors) or len(sensors) != len(self._sensors):
            return
        self._sensors = sensors
        self._motors.batched_colors = sensors[:len(LEGS)]
        self._others.batched_colors = sensors[len(LEGS):]

    def trace(self, axis: Sequence[float]) -> None:
        """Continue the trace of the handle's axis, a unit vector in the base frame."""
        point = MAP_RADIUS * np.asarray(axis)
        self._pin.position = point
        if self._trace and np.abs(point - self._trace[-1]).max() < TRACE_STEP:
            return
        self._trace.append(point)
        if self._line.visible and not self._pin.visible:
            self._pin.visible = True
        points = np.array(self._trace)
        segments = np.stack([points[:-1], points[1:]], axis=1)
        segments = segments[np.isfinite(segments).all(axis=(1, 2))]
        if len(segments):
            self._line.points = segments.astype(np.float32)

    def break_trace(self) -> None:
        """Continue the trace without a line from its end: the way is not known."""
        if self._trace and np.isfinite(self._trace[-1]).all():
            self._trace.append(np.full(3, np.nan))

    def paint(self, phi: float) -> None:
        """Paint the map for a self-rotation, rad, if that has changed."""
        if self._phi is not None and abs(phi - self._phi) < MAP_STEP:
            return
        self._phi = phi
        self._tiles.batched_colors = self._map.colours(phi)
        points = 1.004 * MAP_RADIUS * self._map.singular_axes(phi)
        self._singular.visible = self._tiles.visible and len(points) > 0
        if len(points):
            self._singular.points = points.astype(np.float32)

    def show_rest(self, whole: bool) -> None:
        """Show or hide what is beside the device."""
        self._tiles.visible = self._line.visible = self._rim.visible = whole
        for label in self.overlay.labels:
            label.visible = whole
        # `paint` shows where they are now, and `trace` where the handle is.
        self._singular.visible = False
        self._phi = None
        self._pin.visible = whole and len(self._trace) > 0

    def show_level(self, level: float) -> None:
        """Show the cone of the protection level, rad, magnified; nan: none."""
        self._level.visible = isfinite(level)
        if isfinite(level):
            width = tan(min(MAGNIFICATION * level, WIDEST_CONE))
            self._level.scale = (width, width, 1.0)

    def set_alive(self, alive: bool) -> None:
        """Give the device its colours, or turn it grey: it does not show the present pose."""
        if alive == self._alive:
            return
        self._alive = alive
        for handle, colours in self._coloured:
            handle.batched_colors = colours if alive else np.full_like(colours, GREY)
        if not alive:
            self._level.visible = False

    def remove(self) -> None:
        """Take the device out of the scene."""
        self._root.remove()
        self.overlay.remove()


def _upright() -> Quaternion[float]:
    """Return the turn that takes (1, 1, 1) to the vertical, with leg A at the back."""
    up = np.ones(3) / np.sqrt(3.0)
    back = np.array([0.0, 0.0, 1.0]) - up[2] * up
    back /= np.linalg.norm(back)
    # Rows: the scene's x, y, z in the base frame.
    rows = np.stack([np.cross(back, up), back, up])
    x, y, z, w = quaternion_from_matrix(rows).tolist()
    return x, y, z, w
