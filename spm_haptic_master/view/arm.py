# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device: its topics, and when each of them is drawn."""

from __future__ import annotations

from contextlib import nullcontext
import json
from math import isfinite, nan, radians
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import JointState
from spm_haptic_master.description.three_encoders import ThreeEncoders
from spm_haptic_master.force import FORCE_STATES
from spm_haptic_master.kinematics import Geometry, zxz_angles
from spm_haptic_master.kinematics.joints import MECHANISM_JOINT_NAMES, SHORT_NAMES
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion
from spm_haptic_master.kinematics.mounting import IDENTITY
from spm_haptic_master.kinematics.number_backends import FLOATS
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion
from spm_haptic_master.nodes.diagnostics import MESSAGES
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.parameters.geometry import (
    geometry_from,
    mounting_from,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.parameters.setting import SENSORS_SETTING
from spm_haptic_master.ros.qos import DISPLAY, STATE
from spm_haptic_master.supervision.orientation_state import OrientationState, received_state
from spm_haptic_master.timing import Periodic, SECOND
from spm_haptic_master.view import readout
from spm_haptic_master.view.mechanism_query import ALERT_LIMIT_SETTING, MechanismQuery
from spm_haptic_master.view.page import Page
from spm_haptic_master.view.samples import Samples
from spm_haptic_master.view.scene import Scene
from spm_haptic_master.view.simulated_device import SimulatedDevice
from spm_haptic_master.view.status import (
    Banner,
    banner,
    ORIENTATION,
    SampleAge,
    SINGULARITY,
    StatusEntries,
)
from std_msgs.msg import String

# Least time between two drawings of the joints (s): what comes faster is not seen.
LEAST_PERIOD = 0.012
# Periods of the map, of the trace and of the figures (s).
MAP_PERIOD, TRACE_PERIOD, FIGURES_PERIOD = 0.8, 0.1, 0.25
# Time for which the first page has the device without map, trace, cones and plots (s): a browser
# without a GPU takes a second for these, and the device would wait for that.
DEVICE_ALONE = 3.0


class Arm:
    """
    One device: the topics of a namespace, '/' or '/NAME', and its number in the scene.

    `node` subscribes and publishes for it; `taker`, a node of no executor, has the topics whose
    newest message is taken when it is drawn.
    """

    def __init__(self, node: Node, taker: Node, page: Page, namespace: str,
                 number: int) -> None:
        self._node, self._page = node, page
        self._server = server = page.server
        self._number = number
        self._prefix = namespace.rstrip('/')
        self._scene: Scene | None = None
        self._geometry = Geometry()
        self._state: OrientationState | None = None
        self._stamp: tuple[int, int] | None = None
        now = time.monotonic()
        self._age = SampleAge(now)
        # When all of the picture is due on the first page (s, monotonic), and whether it is there.
        self._whole_at: float | None = None
        self._whole = False
        self._joints, self._trace = Periodic(LEAST_PERIOD), Periodic(TRACE_PERIOD)
        self._map, self._figures = Periodic(MAP_PERIOD), Periodic(FIGURES_PERIOD)
        # Poses drawn since the figures were shown, and when that was (s).
        self._drawn, self._shown_at = 0, now
        self._ghost = ThreeEncoders(self._geometry)
        self.seen = readout.Seen(banner(None, None))
        # The banner that page and scene show; None before one does.
        self._shown: Banner | None = None
        self._entries = StatusEntries(self._prefix)
        self._title = self._prefix.strip('/')
        folder = server.gui.add_folder(self._title) if self._title else nullcontext()
        with folder:
            figures, _ = (server.gui.add_html(
                f'<div id="spm-{self._title}{part}" class="spm-device"></div>')
                for part in ('', '-lower'))
        self.simulation = SimulatedDevice(
            node, server.gui, folder, figures.order + 0.5, self._name)
        name = self._name
        node.create_subscription(JointState, name('joint_states'), self._on_joints, DISPLAY)
        for topic, take in (('state', self._on_state), ('source', self._on_source),
                            ('force_state', self._on_force), (COVERAGE_TOPIC, self._on_coverage)):
            node.create_subscription(String, name(topic), take, STATE)
        self._samples = Samples(taker, name)
        self._query = MechanismQuery(node, name('fkm/get_parameters'), self._build)

    def _name(self, topic: str) -> str:
        return f'{self._prefix}/{topic}'

    def _on_joints(self, message: JointState) -> None:
        if list(message.name) != list(MECHANISM_JOINT_NAMES) \
                or not all(map(isfinite, message.position)):
            return
        stamp = message.header.stamp.sec, message.header.stamp.nanosec
        if stamp == self._stamp:
            return  # an old pose, repeated
        self._stamp = stamp
        self.seen.angles = tuple(message.position)
        self._ghost.add_pose(stamp[0] * SECOND + stamp[1], self.seen.angles)
        now = time.monotonic()
        self._age.renew(now)
        if self._scene is not None and banner(self._state, 0.0).alive \
                and self._server.get_clients() and self._joints.is_due(now):
            with self._server.atomic():
                self._scene.place(self.seen.angles)
            self._drawn += 1

    def _on_state(self, message: String) -> None:
        self._state = received_state(message.data)
        self.show_state(time.monotonic())

    def _on_force(self, message: String) -> None:
        self.seen.force = message.data if message.data in FORCE_STATES else ''

    def _on_source(self, message: String) -> None:
        self.seen.source = message.data
        self.simulation.show(message.data, self.seen.sensors)

    def _on_coverage(self, message: String) -> None:
        try:
            found = json.loads(message.data)
            text = str(found.get('text', ''))
            covered = {str(name): float(share)
                       for name, share in found.get('covered', {}).items()}
        except (ValueError, TypeError, AttributeError):
            return  # of another program
        shares = {name: share for name, share in covered.items() if isfinite(share)}
        self.seen.calibration = (text, shares) if covered else None

    def check_calibration(self) -> None:
        """Hide a calibration whose program has ended without a last word."""
        if self.seen.calibration \
                and not self._node.count_publishers(self._name(COVERAGE_TOPIC)):
            self.seen.calibration = None

    def on_diagnostics(self, entry: DiagnosticStatus) -> None:
        """Take an entry of /diagnostics, if it is this device's."""
        name = self._entries.take(entry, time.monotonic())
        if name == ORIENTATION:
            self._query.check(entry)

    def _build(self, values: dict[str, Any]) -> None:
        """Draw the mechanism of checked settings."""
        self._geometry = geometry_from(values)
        mounting = mounting_from(values)
        self.seen.sensors = values[SENSORS_SETTING.name]
        self.seen.alert_limit = values[ALERT_LIMIT_SETTING.name]
        self._ghost = ThreeEncoders(self._geometry)
        if self._scene is not None:
            self._scene.remove()
            self._scene = None  # also if the next one cannot be drawn
        self._scene = Scene(
            self._server, f'/arm{self._number}', self._number, self._geometry,
            values[WORKING_MODE_SETTING.name], IDENTITY if mounting is None else mounting.base,
            self.seen.sensors)
        self.seen.states = []
        self._shown = None
        self._scene.show_rest(self._whole)
        self._map = Periodic(MAP_PERIOD)  # due at once
        self.simulation.show(self.seen.source, self.seen.sensors)

    def _wait_for_rest(self, now: float, watched: bool) -> None:
        """Show what is beside the device once somebody has seen the device for a while."""
        if self._whole:
            return
        if not watched or self._scene is None:
            self._whole_at = None
        elif self._whole_at is None:
            self._whole_at = now + DEVICE_ALONE
        elif now >= self._whole_at:
            self._whole = True
            self._scene.show_rest(True)

    def tick(self, now: float) -> None:
        """Draw what is due; call it every 50 ms."""
        self._query.ask(now)
        self._age.tick(now)
        self.show_state(now)
        watched = bool(self._server.get_clients())
        seen, alive = self.seen, self.seen.banner.alive
        if self._scene is not None and not (watched and alive):
            # The trace must not join before and after.
            self._scene.break_trace()
        self._wait_for_rest(now, watched)
        seen.story = self.simulation.tick(now)
        self._samples.take(now, watched, self._ghost)
        if not watched:
            return
        if seen.angles is not None:
            th1a, th2a, th3a = seen.angles[:3]
            seen.orientation = chain_quaternion(th1a, th2a, th3a, self._geometry, FLOATS)
        seen.ghost = self._ghost.error
        seen.dexterities = self._samples.dexterities
        if seen.orientation is not None and self._scene is not None:
            if alive and self._trace.is_due(now):
                self._scene.trace(rotation_from_quaternion(*seen.orientation)[2::3])
                level = self._entries.numbers(ORIENTATION).get('protection level (deg)', nan)
                self._scene.show_level(radians(level) if self._whole else nan)
            if self._whole and self._map.is_due(now):
                self._scene.paint(zxz_angles(*seen.orientation)[2])
            self._scene.overlay.show_ghost(
                self._ghost.turn if alive and self._whole else None)
            self._scene.overlay.show_torques(
                self._samples.torques if alive else (None, None))
        if self._figures.is_due(now):
            self._show_figures(now)

    def _show_figures(self, now: float) -> None:
        """Show figures, plots, the encoders' states and the sliders."""
        seen = self.seen
        before, seen.states = seen.states, self._entries.sensor_states(seen.sensors, self._state)
        seen.happened += self.simulation.happened
        seen.happened += [f'th{name} {state.words}' for name, state, was in zip(
            SHORT_NAMES, seen.states, before, strict=False) if state != was]
        seen.pace = self._drawn / max(now - self._shown_at, FIGURES_PERIOD)
        self._drawn, self._shown_at = 0, now
        if self._scene is not None:
            self._scene.show_sensors([state.colour for state in seen.states])
        self._page.show_content(self._title, readout.content(seen, self._entries))
        seen.happened, self.simulation.happened = [], []
        if seen.orientation is not None and seen.banner.alive:
            self.simulation.follow(seen.orientation)

    def show_state(self, now: float) -> None:
        """Show the state at a time, s, and whether the picture is alive."""
        self._entries.now = now
        entry = self._entries.entry(SINGULARITY)
        reason = '' if entry is None or entry.message in MESSAGES else entry.message
        shown = banner(self._state, self._age.value, reason,
                       heard=not self._entries.has_ended(ORIENTATION))
        if shown == self._shown:
            return
        self.seen.banner = self._shown = shown
        with self._server.atomic():
            if self._scene is not None:
                self._scene.set_alive(shown.alive)
            self._page.show(self._title, shown)
