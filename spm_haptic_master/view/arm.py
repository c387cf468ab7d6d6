# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device: its topics, and what of them is drawn when."""

from __future__ import annotations

import json
from math import isfinite, nan, radians
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from spm_haptic_master.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry, zxz_angles
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion
from spm_haptic_master.nodes.dexterity_levels import MESSAGES
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, FAULTS_TOPIC, STEER_TOPIC
from spm_haptic_master.orientation_state import OrientationState, received_state, STARTING
from spm_haptic_master.parameters.geometry import (
    geometry_from,
    mounting_from,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.parameters.shared import SENSORS_SETTING
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.view.liveness import Banner, banner, SampleAge
from spm_haptic_master.view.mechanism_query import MechanismQuery
from spm_haptic_master.view.page_banners import PageBanners
from spm_haptic_master.view.panel import Panel
from spm_haptic_master.view.periodic import Periodic
from spm_haptic_master.view.readout import Readout
from spm_haptic_master.view.sampled_topic import DISPLAY, SampledTopic
from spm_haptic_master.view.scene import Scene
from spm_haptic_master.view.status_entries import StatusEntries
from std_msgs.msg import Float64MultiArray, String
from viser import ViserServer

# Least time between two drawings of the joints (s): what comes faster is not seen.
LEAST_PERIOD = 0.012
# Periods of the map and of the trace (s).
MAP_PERIOD, TRACE_PERIOD = 0.8, 0.1
# Time for which the first page has the device without map, trace, cones and plots (s): a browser
# without a GPU takes a second for these, and the device would wait for that.
DEVICE_ALONE = 3.0


class Arm:
    """
    One device.

    Parameters
    ----------
    node : Node
        Node that subscribes and publishes for it.
    taker : Node
        Node of no executor, whose messages are taken when they are needed.
    server : ViserServer
        Server of the page.
    banners : PageBanners
        Banners of the page.
    namespace : str
        Namespace of the device's topics, '/' or '/NAME'.
    number : int
        Number of the device in the scene.

    """

    def __init__(self, node: Node, taker: Node, server: ViserServer, banners: PageBanners,
                 namespace: str, number: int) -> None:
        self._node, self._server, self._banners = node, server, banners
        self._number = number
        self._prefix = namespace.rstrip('/')
        self._scene: Scene | None = None
        self._geometry = Geometry()
        self._mounting = Mounting()
        self._sensors = 4
        self._state: OrientationState | None = None
        self._source = self._faults = ''
        self._angles: tuple[float, ...] | None = None
        self._stamp: tuple[int, int] | None = None
        now = time.monotonic()
        self._age = SampleAge(now)
        # When the first page has all of the picture (s, monotonic), and whether it has.
        self._whole_at: float | None = None
        self._whole = False
        # Whether the trace goes on from where it is.
        self._unbroken = False
        self._joints, self._trace = Periodic(LEAST_PERIOD), Periodic(TRACE_PERIOD)
        self._map = Periodic(MAP_PERIOD)
        self._entries = StatusEntries(self._prefix)
        self._steer_out: Publisher | None = None
        self._fail_out: Publisher | None = None
        self._title = self._prefix.strip('/')
        self.panel = Panel(server, self._title, self._steer, self._fail)
        self._banner: Banner | None = None
        name = self._name
        node.create_subscription(JointState, name('joint_states'), self._on_joints, DISPLAY)
        node.create_subscription(String, name('state'), self._on_state, STATE)
        node.create_subscription(String, name('source'), self._on_source, STATE)
        dexterity = SampledTopic(taker, Float64MultiArray, name('dexterity'))
        dexterity.subscribe()
        self._readout = Readout(self.panel, self._entries, dexterity, now)
        node.create_subscription(String, name(COVERAGE_TOPIC), self._on_coverage, STATE)
        self._query = MechanismQuery(node, name('fkm/get_parameters'), self._build)

    def _name(self, topic: str) -> str:
        return f'{self._prefix}/{topic}'

    # What comes ----------------------------------------------------------------------------

    def _on_joints(self, message: JointState) -> None:
        if list(message.name) != list(MECHANISM_JOINT_NAMES) \
                or not all(map(isfinite, message.position)):
            return
        stamp = message.header.stamp.sec, message.header.stamp.nanosec
        if stamp == self._stamp:
            return  # an old pose, repeated
        self._stamp = stamp
        self._angles = tuple(message.position)
        now = time.monotonic()
        self._age.renew(now)
        if self._scene is not None and banner(self._state, 0.0).alive \
                and self._server.get_clients() and self._joints.is_due(now):
            with self._server.atomic():
                self._scene.place(self._angles)
            self._readout.count_drawn()

    def _on_state(self, message: String) -> None:
        self._state = received_state(message.data)
        if self._state == STARTING:
            self._query.invalidate()  # it may be another fkm
        self.show_state(time.monotonic())

    def _on_source(self, message: String) -> None:
        self._source = message.data
        simulated = self._source == 'sim'
        self._show_knobs()
        if simulated and self._steer_out is None:
            node = self._node
            self._steer_out = node.create_publisher(
                Float64MultiArray, self._name(STEER_TOPIC), 1)
            self._fail_out = node.create_publisher(String, self._name(FAULT_TOPIC), 1)
            node.create_subscription(
                String, self._name(FAULTS_TOPIC), self._on_faults, STATE)

    def _on_faults(self, message: String) -> None:
        self._faults = message.data
        self._show_knobs()

    def _show_knobs(self) -> None:
        """Show the knobs of a simulated device."""
        self.panel.show_simulation(self._source == 'sim', self._sensors, self._faults)

    def _on_coverage(self, message: String) -> None:
        try:
            found = json.loads(message.data)
            text = str(found.get('text', ''))
            covered = {str(name): float(share)
                       for name, share in found.get('covered', {}).items()}
        except (ValueError, TypeError, AttributeError):
            return  # of another program
        self.panel.show_calibration(text, {
            name: share for name, share in covered.items() if isfinite(share)})

    def check_calibration(self) -> None:
        """Hide a calibration whose program has ended without a last word."""
        if self.panel.calibrates and not self._node.count_publishers(self._name(COVERAGE_TOPIC)):
            self.panel.show_calibration('', {})

    def on_diagnostics(self, entry: DiagnosticStatus) -> None:
        """Take an entry of /diagnostics, if it is this device's."""
        name = self._entries.take(entry, time.monotonic())
        if name == 'fkm: orientation':
            self._query.check(entry)
        if name == 'fkm: timing':
            self._readout.note_timing()

    def _steer(self, *pose: float) -> None:
        if self._steer_out is not None and self._source == 'sim':
            self._steer_out.publish(Float64MultiArray(data=list(pose)))

    def _fail(self, faults: str) -> None:
        if self._fail_out is not None and self._source == 'sim':
            self._fail_out.publish(String(data=faults))

    def _build(self, values: dict[str, Any]) -> None:
        """Draw the mechanism of checked settings."""
        self._geometry = geometry_from(values)
        self._mounting = mounting_from(values) or Mounting()
        self._sensors = values[SENSORS_SETTING.name]
        if self._scene is not None:
            self._scene.remove()
            self._scene = None
        self._scene = Scene(
            self._server, f'/arm{self._number}', self._number, self._geometry,
            values[WORKING_MODE_SETTING.name], self._mounting.base)
        self._banner = None
        self._show_whole()
        self._show_knobs()

    def _show_whole(self) -> None:
        """Show what is beside the device, if that is due; of a scene drawn anew, too."""
        if self._scene is not None:
            self._scene.show_rest(self._whole)
            self._map.hasten()

    def _show_rest(self, now: float, watched: bool) -> None:
        """Show what is beside the device, when somebody has seen that for a while."""
        if self._whole:
            return
        if not watched or self._scene is None:
            self._whole_at = None
        elif self._whole_at is None:
            self._whole_at = now + DEVICE_ALONE
        elif now >= self._whole_at:
            self._whole = True
            self._show_whole()
            self.panel.show_plots()

    # What is drawn ---------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Draw what is due; call it every 50 ms."""
        self._query.ask(now)
        self._age.tick(now)
        self.show_state(now)
        watched = bool(self._server.get_clients())
        alive = self._banner is not None and self._banner.alive
        if not (watched and alive):
            self._break_off(now, watched)
        self._show_rest(now, watched)
        if not watched:
            return
        orientation = self._orientation()
        if orientation is not None and self._scene is not None:
            if alive and self._trace.is_due(now):
                self._unbroken = True
                self._scene.trace(rotation_from_quaternion(*orientation)[2::3])
                level = self._entries.numbers('fkm: orientation', now).get(
                    'protection level (deg)', nan)
                self._scene.show_level(radians(level) if self._whole else nan)
            if self._whole and self._map.is_due(now):
                self._scene.paint(zxz_angles(*orientation)[2])
        self._readout.show(
            now, self._source, self._sensors, self._angles if alive else None,
            orientation if alive else None)

    def _break_off(self, now: float, watched: bool) -> None:
        """Break trace and plots where nothing is drawn: they must not join before and after."""
        if self._unbroken:
            self._unbroken = False
            if self._scene is not None:
                self._scene.break_trace()
        self._readout.break_off(now, watched)

    def show_state(self, now: float) -> None:
        """Show the state at a time, s, and whether the picture is alive."""
        entry = self._entries.entry('diagnostics: singularity', now)
        reason = '' if entry is None or entry.message in MESSAGES else entry.message
        # Until its first entry, fkm is not missing.
        heard = not self._entries.has_come('fkm: orientation') \
            or self._entries.entry('fkm: orientation', now) is not None
        shown = banner(self._state, self._age.value, reason, heard)
        if shown == self._banner:
            return
        self._banner = shown
        with self._server.atomic():
            if self._scene is not None:
                self._scene.set_alive(shown.alive)
            self._banners.show(self._title, shown)

    def _orientation(self) -> Quaternion[float] | None:
        """Return the quaternion of R_base_platform, of leg A's joints."""
        if self._angles is None:
            return None
        th1a, th2a, th3a = self._angles[:3]
        return chain_quaternion(th1a, th2a, th3a, self._geometry, FLOATS)
