# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device: its topics, and when each of them is drawn."""

from __future__ import annotations

from contextlib import nullcontext, suppress
import json
from math import inf, isfinite, nan, radians
import time

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.description.three_encoders import ThreeEncoders
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.force import FORCE_STATES
from spm_haptic_master.kinematics import Geometry, zxz_angles
from spm_haptic_master.kinematics.joints import JOINT_NAMES, MECHANISM_JOINT_NAMES, SHORT_NAMES
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion
from spm_haptic_master.kinematics.mounting import IDENTITY
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion
from spm_haptic_master.nodes.diagnostics import MESSAGES
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.parameters import geometry
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete, SENSORS_SETTING, Values
from spm_haptic_master.ros.inputs import SampledTopic
from spm_haptic_master.ros.qos import DISPLAY, STATE
from spm_haptic_master.supervision.orientation_state import OrientationState, received_state
from spm_haptic_master.timing import Periodic, SECOND
from spm_haptic_master.view import status
from spm_haptic_master.view.page import Page, Seen
from spm_haptic_master.view.scene import Scene
from spm_haptic_master.view.simulated_device import SimulatedDevice
from std_msgs.msg import Float64MultiArray, String

# Settings of fkm that the page needs, and the period of asking for them (s): another fkm may have
# another mechanism or mounting.
SETTINGS = (
    *geometry.MECHANISM_SETTINGS,
    *geometry.MOUNTING_SETTINGS,
    SENSORS_SETTING,
    *(setting for setting in FKM_SETTINGS if setting.name == 'alert_limit_deg'),
)
ASK_PERIOD = 1.0
# Shortest time between two drawings of the joints (s): nobody sees faster ones.
LEAST_PERIOD = 0.012
# Periods of the map, of the trace and of the figures (s).
MAP_PERIOD, TRACE_PERIOD, FIGURES_PERIOD = 0.8, 0.1, 0.25
# Time for which the first page has the device without dome, names and cones (s): a browser without
# a GPU takes a second for these, and the device would wait for that.
DEVICE_ALONE = 3.0
# Topics of the torques commanded and rendered, in the handle's frame; time without a message after
# which a torque ends (s).
TORQUE_TOPICS, TORQUE_TIMEOUT = ('body/servo_cf', 'body/measured_cf'), 0.25
NO_TORQUE = 0.0, 0.0, 0.0


class Arm:
    """
    One device: the topics of a namespace, '/' or '/NAME', and its number in the scene.

    `node` subscribes and publishes for it; `taker`, a node without an executor, has the topics of
    which only the newest message is taken, when it is drawn.
    """

    def __init__(self, node: Node, taker: Node, page: Page, namespace: str, number: int) -> None:
        self._node, self._page, self._number = node, page, number
        self._server = server = page.server
        self._prefix = namespace.rstrip('/')
        self._title = self._prefix.strip('/')
        self._scene: Scene | None = None
        self._geometry = Geometry()
        self._ghost = ThreeEncoders(self._geometry)
        self._state: OrientationState | None = None
        self._stamp: int | None = None  # of the latest joint angles, ns
        now = time.monotonic()
        self._age = status.SampleAge()
        # Time since which a page shows the device (s, monotonic).
        self._seen_since = now
        self._joints, self._trace = Periodic(LEAST_PERIOD), Periodic(TRACE_PERIOD)
        self._map, self._figures = Periodic(MAP_PERIOD), Periodic(FIGURES_PERIOD)
        # Poses drawn since the figures were shown, and when that was (s).
        self._drawn, self._shown_at = 0, now
        self.seen = Seen(status.banner(None, None))
        self._entries = status.StatusEntries(self._prefix)
        folder = server.gui.add_folder(self._title) if self._title else nullcontext()
        with folder:
            figures, _ = (
                server.gui.add_html(f'<div id="spm-{self._title}{part}" class="spm-device"></div>')
                for part in ('', '-lower')
            )
        name = self._name
        self.simulation = SimulatedDevice(node, server.gui, folder, figures.order + 0.5, name)
        node.create_subscription(JointState, name('joint_states'), self._on_joints, DISPLAY)
        for topic, take in (
            ('state', self._on_state),
            ('source', self._on_source),
            ('force_state', self._on_force),
            (COVERAGE_TOPIC, self._on_coverage),
        ):
            node.create_subscription(String, name(topic), take, STATE)
        self._dexterity = SampledTopic(taker, Float64MultiArray, name('dexterity'))
        self._readings = SampledTopic(taker, JointState, name('readings'))
        self._wrenches = [
            SampledTopic(taker, WrenchStamped, name(topic)) for topic in TORQUE_TOPICS
        ]
        # Torques commanded and rendered, N m, in the handle's frame, and when they came (s).
        self._torques = [(-inf, NO_TORQUE)] * len(TORQUE_TOPICS)
        self._fkm, self._asks = (
            node.create_client(GetParameters, name('fkm/get_parameters')),
            Periodic(ASK_PERIOD),
        )
        # Settings of the mechanism that is drawn, none before the first.
        self._settings: Values = {}

    def _name(self, topic: str) -> str:
        return f'{self._prefix}/{topic}'

    def _on_joints(self, message: JointState) -> None:
        if list(message.name) != list(MECHANISM_JOINT_NAMES) or not all(
            map(isfinite, message.position)
        ):
            return
        stamp = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
        if stamp == self._stamp:
            return  # an old pose, repeated
        self._stamp = stamp
        self.seen.angles = tuple(message.position)
        self._ghost.add_pose(stamp, self.seen.angles)
        now = time.monotonic()
        self._age.renew(now)
        if (
            self._scene is not None
            and self._state is not None
            and self._state.publishes
            and self._server.get_clients()
            and self._joints.is_due(now)
        ):
            with self._server.atomic():
                self._scene.place(self.seen.angles)
            self._drawn += 1

    def _on_state(self, message: String) -> None:
        self._state = received_state(message.data)
        self._show_state(time.monotonic())

    def _on_force(self, message: String) -> None:
        self.seen.force = message.data if message.data in FORCE_STATES else ''

    def _on_source(self, message: String) -> None:
        self.seen.source = message.data
        self.simulation.show(message.data, self.seen.sensors)

    def _on_coverage(self, message: String) -> None:
        # Words of another program change nothing.
        with suppress(ValueError, TypeError, AttributeError):
            found = json.loads(message.data)
            shares = {str(name): float(share) for name, share in found.get('covered', {}).items()}
            self.seen.calibration = (str(found.get('text', '')), shares) if shares else None

    def on_diagnostics(self, entry: DiagnosticStatus) -> None:
        """Take an entry of /diagnostics, if it is this device's."""
        self._entries.take(entry, time.monotonic())

    def _on_settings(self, future: Future) -> None:
        """Take the answer of fkm; ignore settings that cannot be drawn."""
        answers = map(parameter_value_to_python, future.result().values)
        given = {
            setting.name: value
            for setting, value in zip(SETTINGS, answers, strict=False)
            if value is not None
        }
        with suppress(SpmError):
            self.build(complete(SETTINGS, given))

    def build(self, values: Values) -> None:
        """Draw the mechanism of checked settings, if they are new; SpmError: it cannot be."""
        if values == self._settings:
            return
        self._geometry = geometry.geometry_from(values)
        mounting = geometry.mounting_from(values)
        self.seen.sensors = values[SENSORS_SETTING.name]
        self.seen.alert_limit = values['alert_limit_deg']
        self._ghost = ThreeEncoders(self._geometry)
        if self._scene is not None:
            self._scene.remove()
        self._scene = Scene(
            self._server.scene,
            self._number,
            self._geometry,
            values[geometry.WORKING_MODE_SETTING.name],
            IDENTITY if mounting is None else mounting.base,
            self.seen.sensors,
        )
        self.seen.states = []
        self.simulation.show(self.seen.source, self.seen.sensors)
        self._settings = values

    def tick(self, now: float) -> None:
        """Draw what is due; call it every 50 ms."""
        if self._fkm.service_is_ready() and self._asks.is_due(now):
            self._fkm.call_async(
                GetParameters.Request(names=[setting.name for setting in SETTINGS])
            ).add_done_callback(self._on_settings)
        self._age.tick(now)
        self._show_state(now)
        watched = bool(self._server.get_clients())
        seen, scene, alive = self.seen, self._scene, self.seen.banner.alive
        if scene is not None and not (watched and alive):
            # The trace must not bridge the gap.
            scene.dome.break_trace()
        if scene is None or not watched:
            self._seen_since = now
        elif now - self._seen_since >= DEVICE_ALONE:
            scene.show_rest()
        seen.story = self.simulation.tick(now)
        self._take_samples(now, watched)
        if watched and scene is not None and seen.angles is not None:
            th1a, th2a, th3a = seen.angles[:3]
            seen.orientation = chain_quaternion(th1a, th2a, th3a, self._geometry, FLOATS)
            self._draw_over(scene, seen.orientation, now)
        if watched and self._figures.is_due(now):
            self._show_figures(now)

    def _take_samples(self, now: float, watched: bool) -> None:
        """Take the newest messages; subscribe only while a page is open."""
        for topic in (self._dexterity, self._readings, *self._wrenches):
            if watched:
                topic.subscribe()
            else:
                topic.unsubscribe()
        dexterity = self._dexterity.take()
        if dexterity is not None:
            self.seen.dexterities = tuple(dexterity.data) if len(dexterity.data) == 2 else None
        self._ghost.solve(None if self.seen.dexterities is None else self.seen.dexterities[0])
        readings = self._readings.take()
        if readings is not None and list(readings.name[:4]) == list(JOINT_NAMES):
            stamp = readings.header.stamp
            self._ghost.add_readings(stamp.sec * SECOND + stamp.nanosec, readings.position[:3])
        for index, topic in enumerate(self._wrenches):
            wrench = topic.take()
            if wrench is not None:
                torque = wrench.wrench.torque
                self._torques[index] = now, (torque.x, torque.y, torque.z)

    def _draw_over(self, scene: Scene, orientation: Quaternion[float], now: float) -> None:
        """Draw what is over the device: its trace, its map, the ghost and the torques."""
        alive = self.seen.banner.alive
        if alive and self._trace.is_due(now):
            scene.dome.move(rotation_from_quaternion(*orientation)[2::3])
            level = self._entries.numbers(status.ORIENTATION).get('protection level (deg)', nan)
            scene.show_level(radians(level))
        if self._map.is_due(now):
            scene.dome.paint(zxz_angles(*orientation)[2])
        scene.show_ghost(self._ghost.turn if alive else None)
        scene.show_torques(
            [
                torque if alive and now - came <= TORQUE_TIMEOUT else NO_TORQUE
                for came, torque in self._torques
            ]
        )

    def _show_figures(self, now: float) -> None:
        """Show figures, plots, the encoders' states and the sliders."""
        seen = self.seen
        before, seen.states = seen.states, self._entries.sensor_states(seen.sensors, self._state)
        seen.happened = [
            *self.simulation.happened,
            *(
                f'th{name} {state.words}'
                for name, state, was in zip(SHORT_NAMES, seen.states, before, strict=False)
                if state != was
            ),
        ]
        self.simulation.happened = []
        seen.ghost = self._ghost.error
        seen.pace = self._drawn / max(now - self._shown_at, FIGURES_PERIOD)
        self._drawn, self._shown_at = 0, now
        if not self._node.count_publishers(self._name(COVERAGE_TOPIC)):
            seen.calibration = None  # its program has ended
        if self._scene is not None:
            self._scene.show_sensors([state.colour for state in seen.states])
        self._page.show_content(self._title, seen, self._entries)
        if seen.orientation is not None and seen.banner.alive:
            self.simulation.follow(seen.orientation)

    def _show_state(self, now: float) -> None:
        """Show the state at a time, s, and whether the picture is alive."""
        self._entries.now = now
        entry = self._entries.entry(status.SINGULARITY)
        reason = '' if entry is None or entry.message in MESSAGES else entry.message
        self.seen.banner = shown = status.banner(
            self._state,
            self._age.value,
            reason,
            heard=not self._entries.has_ended(status.ORIENTATION),
        )
        if self._scene is not None:
            self._scene.set_alive(shown.alive)
        self._page.show(self._title, shown)
