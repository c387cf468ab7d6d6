# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The workspace's cone about O as a dome: its map, and the way of the handle's axis on it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import nan, pi

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.description.workspace_map import HALF_ANGLE, WorkspaceMap
from spm_haptic_master.kinematics import Geometry, workspace_pose
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.view import surfaces
from viser import LineSegmentsHandle, SceneApi

# Radius of the dome about O, outside the handle; radius of its tiles and of the ball at the end of
# the trace (units of the scene).
RADIUS, TILE, PIN = 1.78, 0.042, 0.03
OPACITY = 0.75
# Colours of singularities, trace and rim.
SINGULAR, TRACE, RIM = (70, 0, 20), (20, 20, 20), (150, 150, 150)
# Size of a singularity (units of the scene), how much higher than the tiles it is (unit 1), and
# width of lines (pixels).
POINT, ABOVE, LINE = 0.022, 1.004, 2.0
# Points of the trace, and least distance of two of them (unit of the scene).
TRACE_POINTS, TRACE_STEP = 300, 0.004
# Least change of the self-rotation after which the map is painted again (rad).
MAP_STEP = 0.004


class Dome:
    """The dome of a device, below its root in the scene."""

    def __init__(self, scene: SceneApi, root: str, geometry: Geometry,
                 working_mode: WorkingMode) -> None:
        def line(name: str, segments: NDArray[np.float64],
                 colour: tuple[int, int, int]) -> LineSegmentsHandle:
            # As wide as in the scene, a line is drawn twice, by two programs.
            return scene.add_line_segments(f'{root}/{name}', segments, colour, thickness=LINE,
                                           thickness_units='screen')

        self._map = WorkspaceMap(geometry, working_mode)
        # Self-rotation for which the map is painted (rad); nan before it is.
        self._phi = nan
        self._points: deque[NDArray[np.float64]] = deque(maxlen=TRACE_POINTS)
        axes = self._map.axes
        self.tiles = surfaces.add(
            scene, f'{root}/map', surfaces.two_sided(surfaces.polygon(TILE, 6)),
            self._map.colours(0.0), axes, RADIUS * axes, opacity=OPACITY)
        self.singular = scene.add_point_cloud(
            f'{root}/singular', np.zeros((1, 3)), SINGULAR, point_size=POINT,
            point_shape='circle', point_shading='flat', precision='float32')
        rim = RADIUS * workspace_pose(HALF_ANGLE, np.linspace(0.0, 2.0 * pi, 97), 0.0)[..., 2]
        self.rim = line('rim', np.stack([rim[:-1], rim[1:]], axis=1), RIM)
        self.trace = line('trace', np.zeros((1, 2, 3)), TRACE)
        self.pin = surfaces.add(scene, f'{root}/pin', surfaces.ball(PIN), [TRACE])

    def show(self, visible: bool) -> None:
        """Show or hide the dome."""
        self.tiles.visible = self.trace.visible = self.rim.visible = visible
        # `paint` shows where they are now, and `move` where the handle is.
        self.singular.visible = False
        self._phi = nan
        self.pin.visible = visible and len(self._points) > 0

    def move(self, axis: Sequence[float]) -> None:
        """Continue the trace of the handle's axis, a unit vector in the base frame."""
        point = RADIUS * np.asarray(axis)
        self.pin.position = point
        if self._points and np.abs(point - self._points[-1]).max() < TRACE_STEP:
            return
        self._points.append(point)
        if self.trace.visible and not self.pin.visible:
            self.pin.visible = True
        points = np.array(self._points)
        segments = np.stack([points[:-1], points[1:]], axis=1)
        segments = segments[np.isfinite(segments).all(axis=(1, 2))]
        if len(segments):
            self.trace.points = segments.astype(np.float32)

    def break_trace(self) -> None:
        """Continue the trace without a line from its end: the way is not known."""
        if self._points and np.isfinite(self._points[-1]).all():
            self._points.append(np.full(3, np.nan))

    def paint(self, phi: float) -> None:
        """Paint the map for a self-rotation, rad, if that has changed."""
        if abs(phi - self._phi) < MAP_STEP:
            return
        self._phi = phi
        self.tiles.batched_colors = self._map.colours(phi)
        points = ABOVE * RADIUS * self._map.singular_axes(phi)
        self.singular.visible = len(points) > 0
        if len(points):
            self.singular.points = points.astype(np.float32)
