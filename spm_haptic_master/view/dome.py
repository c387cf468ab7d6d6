# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The dome over a device: its workspace, painted, and where its handle was."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import pi

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.description.workspace_map import HALF_ANGLE, WorkspaceMap
from spm_haptic_master.kinematics import Geometry, workspace_pose
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.view import surfaces
from spm_haptic_master.view.surfaces import GREY, rgb
from viser import LineSegmentsHandle, SceneApi

# Radius of the dome about O, outside the handle; radius of its tiles and of the ball at the end of
# the trace (units of the scene); opacity.
RADIUS = 1.78
TILE_RADIUS = 0.042
PIN_RADIUS = 0.03
TILE_OPACITY = 0.75
# Singularities: colour, size (units of the scene), and how much higher than the tiles (unit 1).
SINGULAR = '#8c0018'
SINGULAR_SIZE = 0.026
SINGULAR_RATIO = 1.004
# Lines: colours of trace and rim, width (pixels).
TRACE_COLOUR = '#141414'
LINE_WIDTH = 2.0
# Points of the trace, and least distance of two of them (unit of the scene).
TRACE_POINTS = 300
TRACE_STEP = 0.004
# Points of the trace that are added before all of it is sent again.
TRACE_STRIDE = 3


class Dome:
    """
    The dome of a device.

    Parameters
    ----------
    scene : SceneApi
        The scene of the page.
    root : str
        Name of a frame of the scene that has the axes of the device's base; the dome is below it.
    geometry : Geometry
        The mechanism.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.

    Attributes
    ----------
    tiles : BatchedMeshHandle
        The painted map.
    singular : PointCloudHandle
        Singularities of three encoders.
    trace : LineSegmentsHandle
        Where the handle pointed.
    pin : BatchedMeshHandle
        Ball at the end of the trace.

    """

    def __init__(
        self,
        scene: SceneApi,
        root: str,
        geometry: Geometry,
        working_mode: WorkingMode,
    ) -> None:
        self._scene = scene
        self._root = root
        self._map = WorkspaceMap(geometry, working_mode)
        self._points: deque[NDArray[np.float64]] = deque(maxlen=TRACE_POINTS)
        self._added = 0
        self.tiles = surfaces.add(
            scene,
            f'{root}/map',
            surfaces.two_sided(surfaces.fan(TILE_RADIUS, 0.0, 6)),
            self._map.colours(0.0),
            self._map.axes,
            RADIUS * self._map.axes,
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
        self._add_line('rim', np.stack([rim[:-1], rim[1:]], axis=1), GREY)
        self.trace = self._add_line('trace', np.zeros((1, 2, 3)), TRACE_COLOUR)
        self.pin = surfaces.add(
            scene,
            f'{root}/pin',
            surfaces.ball(PIN_RADIUS),
            rgb([TRACE_COLOUR]),
            visible=False,
        )

    def _add_line(
        self,
        name: str,
        segments: NDArray[np.float64],
        colour: str,
    ) -> LineSegmentsHandle:
        """
        Add segments, (n, 2, 3). A line as wide as in the scene would need two programs.

        Parameters
        ----------
        name : str
            Name below the root.
        segments : ndarray, shape (n, 2, 3)
            Both ends of each segment (units of the scene).
        colour : str
            Colour in CSS, #rrggbb.

        Returns
        -------
        LineSegmentsHandle
            The line.

        """
        return self._scene.add_line_segments(
            f'{self._root}/{name}',
            segments,
            rgb([colour])[0],
            thickness=LINE_WIDTH,
            thickness_units='screen',
        )

    def move(self, axis: Sequence[float]) -> None:
        """
        Continue the trace of the handle's axis, a unit vector in the base frame.

        A step of less than TRACE_STEP moves the pin alone.

        Parameters
        ----------
        axis : sequence of 3 float
            z of the platform.

        """
        point = RADIUS * np.asarray(axis)
        self.pin.position = point
        self.pin.visible = True
        if self._points and np.abs(point - self._points[-1]).max() < TRACE_STEP:
            return
        self._points.append(point)
        self._added += 1
        # All of it is sent each time: not for each point, for the sake of slow networks.
        if self._added >= TRACE_STRIDE:
            self._added = 0
            self._draw_trace()

    def _draw_trace(self) -> None:
        """Send the trace, without what is on both sides of a gap."""
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
        """
        Paint the map for a self-rotation, rad.

        Parameters
        ----------
        phi : float
            Self-rotation of the platform; the map is of all directions of the handle at this one.

        """
        self.tiles.batched_colors = self._map.colours(phi)
        points = SINGULAR_RATIO * RADIUS * self._map.singular_axes(phi)
        self.singular.visible = are_there = bool(len(points))
        if are_there:
            self.singular.points = points.astype(np.float32)
