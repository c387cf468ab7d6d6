# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device: its topics, and what of them is drawn when."""

from __future__ import annotations

import json
from math import degrees, isfinite, radians
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.geometry_settings import (
    geometry_from,
    GEOMETRY_SETTINGS,
    mechanism_checksum,
    mounting_from,
    MOUNTING_SETTINGS,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics import zxz_angles
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    rotation_from_quaternion,
)
from spm_haptic_master.nodes.diagnostic_status import CHECKSUM_KEY
from spm_haptic_master.nodes.diagnostics import TEXTS
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.nodes.qos import STATE
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, FAULTS_TOPIC, STEER_TOPIC
from spm_haptic_master.settings import complete
from spm_haptic_master.shared_settings import SENSORS_SETTING
from spm_haptic_master.view.error_cones import axis_ellipse, Ellipse
from spm_haptic_master.view.liveness import Banner, banner, Light
from spm_haptic_master.view.panel import bar, Panel
from spm_haptic_master.view.scene import Scene
from std_msgs.msg import Float64MultiArray, String
from viser import ViserServer

# Settings of fkm that the picture needs.
SETTINGS = (*GEOMETRY_SETTINGS, WORKING_MODE_SETTING, *MOUNTING_SETTINGS, SENSORS_SETTING)
# Time in which fkm should answer; then it is asked again (s). So it is after an answer, now and
# then: another fkm may have another mechanism, or another mounting.
ANSWER_TIMEOUT, ASK_PERIOD = 1.0, 5.0
# QoS of what is only looked at: the newest message, and no acknowledgement that a publisher or
# its other subscribers would ever wait for.
LOOK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
# Positions of the joints with the first four sensors in `joint_states`.
MEASURED = tuple(MECHANISM_JOINT_NAMES.index(name)
                 for name in ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a'))
# Least time between two drawings of the joints (s): what comes faster is not seen.
LEAST_PERIOD = 0.012
# Periods of the map, of figures and plot, of the trace, and of the sign of life (s).
MAP_PERIOD, FIGURES_PERIOD, TRACE_PERIOD, NEWS_PERIOD = 0.8, 0.3, 0.1, 1.0
# Period of the plots of what comes once a second, where it does not come (s).
SLOW_PERIOD = 1.5
# Longest age of an entry on /diagnostics (s): they come every second.
ENTRY_TIMEOUT = 2.5
# Time between two ticks from which on the second is late (s): two periods.
LONGEST_TICK = 0.1
# Colours of the bar of the dexterity, by the level of the singularity.
LEVELS = {DiagnosticStatus.OK: Light.GREEN, DiagnosticStatus.WARN: Light.AMBER,
          DiagnosticStatus.ERROR: Light.RED}
# Dexterity at which the bar is full (unit 1).
FULL_DEXTERITY = 0.2


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
    namespace : str
        Namespace of the device's topics, '/' or '/NAME'.
    number : int
        Number of the device in the scene.

    """

    def __init__(self, node: Node, taker: Node, server: ViserServer, namespace: str,
                 number: int) -> None:
        self._node, self._taker, self._server = node, taker, server
        self._number = number
        self._prefix = namespace.rstrip('/')
        self._scene: Scene | None = None
        self._geometry = geometry_from(complete(SETTINGS, {}))
        self._mounting = Mounting()
        self._sensors = 4
        # Settings of the mechanism that is drawn, none before the first, and its checksum.
        self._drawn: dict[str, Any] = {}
        self._checksum = ''
        self._state = ''
        self._source = ''
        self._dexterity: tuple[float, float] | None = None
        self._angles: tuple[float, ...] | None = None
        self._stamp: tuple[int, int] | None = None
        # When joint angles came last (s, monotonic), and the time since then at the last tick (s).
        self._came: float | None = None
        self._age: float | None = None
        # Whether the last tick was late: this process stood still.
        self._late = False
        # Whether trace and plots go on from where they are.
        self._unbroken = False
        # When the last tick was, and when what was drawn last (s, monotonic).
        self._ticked = time.monotonic()
        self._due = dict.fromkeys(('joints', 'map', 'figures', 'trace', 'news', 'slow'), 0.0)
        # Latest entries on /diagnostics, by their name without namespace, and when they came
        # (s, monotonic).
        self._entries: dict[str, tuple[DiagnosticStatus, float]] = {}
        self._timed = False
        self._ellipse: Ellipse | None = None
        self._look_at: Subscription | None = None
        self._steer_out: Publisher | None = None
        self._fail_out: Publisher | None = None
        self.panel = Panel(
            server, self._prefix.strip('/'), number, self._steer, self._fail)
        for box in (self.panel.map, self.panel.trace):
            box.on_update(lambda _: self._show_chosen())
        self._banner: Banner | None = None
        name = self._name
        node.create_subscription(JointState, name('joint_states'), self._on_joints, LOOK)
        node.create_subscription(String, name('state'), self._on_state, STATE)
        node.create_subscription(String, name('source'), self._on_source, STATE)
        self._dexterity_in = taker.create_subscription(
            Float64MultiArray, name('dexterity'), _ignore, LOOK, raw=True)
        node.create_subscription(String, name(COVERAGE_TOPIC), self._on_coverage, STATE)
        self._client = node.create_client(GetParameters, name('fkm/get_parameters'))
        # When fkm was asked for its settings (s, monotonic), and whether what is drawn is its
        # answer, as far as is known.
        self._asked_at = float('-inf')
        self._answered = False

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
        self._came, self._age = now, 0.0
        if self._scene is not None and banner(self._state, 0.0).alive \
                and now - self._due['joints'] >= LEAST_PERIOD and self._server.get_clients():
            self._due['joints'] = now
            with self._server.atomic():
                self._scene.place(self._angles)

    def _on_state(self, message: String) -> None:
        self._state = message.data
        if message.data == 'starting':
            self._answered = False  # another fkm may have another mechanism
        self.show_state()

    def _on_source(self, message: String) -> None:
        self._source = message.data
        simulated = self._source == 'sim'
        self.panel.show_simulation(simulated, self._sensors)
        if simulated and self._steer_out is None:
            node = self._node
            self._steer_out = node.create_publisher(
                Float64MultiArray, self._name(STEER_TOPIC), 1)
            self._fail_out = node.create_publisher(String, self._name(FAULT_TOPIC), 1)
            node.create_subscription(
                String, self._name(FAULTS_TOPIC), self._on_faults, STATE)

    def _on_faults(self, message: String) -> None:
        self.panel.show_faults(message.data)

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
        prefix = f'{self._prefix}/'.lstrip('/')
        name = entry.name.removeprefix(prefix)
        if '/' in name or not entry.name.startswith(prefix):
            return
        self._entries[name] = entry, time.monotonic()
        if name == 'fkm: orientation':
            self._check_mechanism(entry)
        if name == 'fkm: timing':
            self._timed = True

    def _steer(self, *pose: float) -> None:
        if self._steer_out is not None:
            self._steer_out.publish(Float64MultiArray(data=list(pose)))

    def _fail(self, faults: str) -> None:
        if self._fail_out is not None:
            self._fail_out.publish(String(data=faults))

    # The mechanism --------------------------------------------------------------------------

    def _ask(self, now: float) -> None:
        """Ask fkm for its mechanism when that is due."""
        period = ASK_PERIOD if self._answered else ANSWER_TIMEOUT
        if now - self._asked_at >= period and self._client.service_is_ready():
            self._asked_at, self._answered = now, False
            request = GetParameters.Request(names=[setting.name for setting in SETTINGS])
            self._client.call_async(request).add_done_callback(self._on_answer)

    def _check_mechanism(self, entry: DiagnosticStatus) -> None:
        """Ask anew where fkm reports another mechanism than is drawn."""
        reported = next((value.value for value in entry.values if value.key == CHECKSUM_KEY), '')
        if reported not in ('', self._checksum):
            self._answered = False

    def _on_answer(self, future: Future) -> None:
        answers = map(parameter_value_to_python, future.result().values)
        given = {setting.name: value for setting, value in zip(SETTINGS, answers, strict=False)
                 if value is not None}
        try:
            values = complete(SETTINGS, given)
            if values != self._drawn:
                self._build(values)
        except SpmError:
            return  # of another version: asked again
        self._answered = True

    def _build(self, values: dict[str, Any]) -> None:
        """Draw the mechanism of checked settings."""
        self._geometry = geometry_from(values)
        self._mounting = mounting_from(values) or Mounting()
        self._drawn, self._checksum = values, mechanism_checksum(values)
        self._sensors = values[SENSORS_SETTING.name]
        if self._scene is not None:
            self._scene.remove()
        self._scene = Scene(
            self._server, f'/arm{self._number}', self._number, self._geometry,
            values[WORKING_MODE_SETTING.name], self._mounting.base)
        self._banner = None
        self._show_chosen()
        self.panel.show_simulation(self._source == 'sim', self._sensors)

    def _show_chosen(self) -> None:
        """Show of the picture what is chosen on the page."""
        if self._scene is not None:
            self._scene.show_map(self.panel.map.value)
            self._scene.show_trace(self.panel.trace.value)

    # What is drawn ---------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Draw what is due; call it every 50 ms."""
        self._ask(now)
        late = now - self._ticked > LONGEST_TICK
        if self._came is not None:
            age = max(0.0, now - self._came)
            # After a pause of this process itself, what came meanwhile is not read yet.
            self._age = min(age, (self._age or 0.0) + LONGEST_TICK) \
                if late and not self._late else age
        self._ticked, self._late = now, late
        self.show_state()
        watched = bool(self._server.get_clients())
        self._look(watched and self.panel.covariance.value)
        alive = self._banner is not None and self._banner.alive
        if not (watched and alive):
            self._break_off(now, watched)
        if not watched:
            return
        if self._is_due('news', now, NEWS_PERIOD):
            self.panel.refresh()
        orientation = self._orientation()
        if alive and orientation is not None and self._scene is not None:
            rotation = rotation_from_quaternion(*orientation)
            if self._is_due('trace', now, TRACE_PERIOD):
                self._unbroken = True
                self._scene.trace(rotation[2::3])
                self._show_cones()
            if self.panel.map.value and self._is_due('map', now, MAP_PERIOD):
                self._scene.paint(zxz_angles(*orientation)[2])
        if self._is_due('figures', now, FIGURES_PERIOD):
            if alive and self._angles is not None:
                self._unbroken = True
                self.panel.angles.add(now, [degrees(self._angles[k]) for k in MEASURED])
            self.panel.show_angles(now)
            self._show_figures(orientation if alive else None)
        if self._timed or now - self._due['slow'] >= SLOW_PERIOD:
            self._add_slow(now)
            self._timed, self._due['slow'] = False, now

    def _break_off(self, now: float, watched: bool) -> None:
        """Break trace and plots where nothing is drawn: they must not join before and after."""
        if not self._unbroken:
            return
        self._unbroken = False
        if self._scene is not None:
            self._scene.break_trace()
        self.panel.angles.add(now, None)
        if not watched:
            self.panel.parity.add(now, None)
            self.panel.latency.add(now, None)

    def _is_due(self, what: str, now: float, period: float) -> bool:
        if now - self._due[what] < period:
            return False
        self._due[what] = now
        return True

    def show_state(self) -> None:
        """Show the state, and whether the picture is alive."""
        entry = self._entry('diagnostics: singularity')
        reason = '' if entry is None or entry.message in TEXTS.values() else entry.message
        shown = banner(self._state, self._age, reason, self._heard)
        if shown == self._banner:
            return
        self._banner = shown
        with self._server.atomic():
            if self._scene is not None:
                self._scene.set_alive(shown.alive)
            self.panel.show_banner(shown)

    @property
    def _heard(self) -> bool:
        """Whether fkm is on /diagnostics; True until its first entry."""
        return 'fkm: orientation' not in self._entries \
            or self._entry('fkm: orientation') is not None

    def _orientation(self) -> Quaternion[float] | None:
        """Return the quaternion of R_base_platform, of leg A's joints."""
        if self._angles is None:
            return None
        th1a, th2a, th3a = self._angles[:3]
        return chain_quaternion(th1a, th2a, th3a, self._geometry, FLOATS)

    def _look(self, wanted: bool) -> None:
        """Subscribe to the covariance, which fkm computes for subscribers only, or end that."""
        if wanted and self._look_at is None:
            self._look_at = self._taker.create_subscription(
                PoseWithCovarianceStamped, self._name('pose_with_covariance'), _ignore, LOOK,
                raw=True)
        elif not wanted and self._look_at is not None:
            self._taker.destroy_subscription(self._look_at)
            self._look_at = self._ellipse = None

    def _show_cones(self) -> None:
        if self._scene is None:
            return
        pose = None if self._look_at is None else _taken(self._look_at)
        if pose is not None:
            message = deserialize_message(pose, PoseWithCovarianceStamped)
            q = message.pose.pose.orientation
            # Of the 6 x 6 matrix the lower right block.
            xx, xy, xz, yx, yy, yz, zx, zy, zz = (
                float(message.pose.covariance[row + column])
                for row in (21, 27, 33) for column in range(3))
            # The cone hangs on the platform, not on the handle.
            platform = multiply_quaternions(
                self._mounting.base, self._mounting.unmounted((q.x, q.y, q.z, q.w)))
            self._ellipse = axis_ellipse(
                (xx, xy, xz, yx, yy, yz, zx, zy, zz), rotation_from_quaternion(*platform))
        level = self._values('fkm: orientation').get('protection level (deg)')
        self._scene.show_cones(
            radians(level) if level is not None and self.panel.cones.value else None,
            self._ellipse, self.panel.magnification)

    def _show_figures(self, orientation: Quaternion[float] | None) -> None:
        values = self._values('fkm: orientation')
        rows = {'source': _text(self._source) or 'unknown'}
        entry = self._entry('encoder_driver: encoders')
        if entry is not None:
            rows['encoders'] = _text(entry.message)
        entry = self._entry('fkm: orientation')
        if entry is not None and '; ' in entry.message:
            rows['caution'] = _text(entry.message.partition('; ')[2])
        if orientation is not None:
            psi, theta, phi = map(degrees, zxz_angles(*orientation))
            rows['orientation'] = (f'&psi; {psi:.2f}&deg;, &theta; {theta:.2f}&deg;, '
                                   f'&phi; {phi:.2f}&deg;')
            if 'protection level (deg)' in values:
                rows['protection level'] = f'{values["protection level (deg)"]:.2f}&deg;'
            if 'parity (sigma)' in values:
                rows['parity'] = f'{values["parity (sigma)"]:.1f} sigma'
            dexterity = _taken(self._dexterity_in)
            if dexterity is not None:
                numbers = deserialize_message(dexterity, Float64MultiArray).data
                self._dexterity = tuple(numbers) if len(numbers) == 2 else None
            if self._dexterity is not None:
                rows |= self._singularity(*self._dexterity)
        timing = self._values('fkm: timing')
        if 'orientation rate (Hz)' in timing:
            rows['rate'] = f'{timing["orientation rate (Hz)"]:.0f} Hz'
        if 'latency p50 (us)' in timing:
            rows['latency'] = (f'p50 {timing["latency p50 (us)"]:.0f} us, '
                               f'p99 {timing["latency p99 (us)"]:.0f} us')
        self.panel.show_figures(rows)

    def _singularity(self, three: float, every: float) -> dict[str, str]:
        """Return the rows on the nearness of a singularity."""
        entry = self._entry('diagnostics: singularity')
        light = LEVELS.get(entry.level, Light.GREY) if entry is not None else Light.GREY
        text = '' if entry is None else _text(entry.message)
        return {'singularity': f'{text}{bar(three / FULL_DEXTERITY, light.value)}',
                'dexterity': f'{three:.3f} (3 sensors), {every:.3f} ({self._sensors} sensors)'}

    def _entry(self, name: str) -> DiagnosticStatus | None:
        """Return an entry on /diagnostics, None without one that is as it should be now."""
        entry, came = self._entries.get(name, (None, 0.0))
        return entry if time.monotonic() - came <= ENTRY_TIMEOUT else None

    def _values(self, name: str) -> dict[str, float]:
        """Return the numbers of an entry on /diagnostics."""
        found = {}
        entry = self._entry(name)
        for value in entry.values if entry is not None else ():
            try:
                found[value.key] = float(value.value)
            except ValueError:
                continue
        return found

    def _add_slow(self, now: float) -> None:
        """Continue the plots of what comes once a second; with a gap where it did not come."""
        values, timing = self._values('fkm: orientation'), self._values('fkm: timing')
        alive = self._timed and self._banner is not None and self._banner.alive
        nan = float('nan')
        self.panel.parity.add(now, [values.get('parity (sigma)', nan),
                                    values.get('protection level (deg)', nan)] if alive else None)
        self.panel.latency.add(now, [timing.get('latency p50 (us)', nan),
                                     timing.get('latency p99 (us)', nan)]
                               if self._timed else None)
        self.panel.show_slow(now)


def _taken(subscription: Subscription) -> bytes | None:
    """Return the newest message of a subscription in no executor, serialized, or None."""
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, True)
    return None if taken is None else taken[0]


def _ignore(_: bytes) -> None:
    """Take a message of a subscription in no executor: it never comes."""


def _text(text: str) -> str:
    return text.replace('&', '&amp;').replace('<', '&lt;')
