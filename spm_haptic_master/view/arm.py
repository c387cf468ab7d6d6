# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device: when each of its topics is drawn and shown."""

from __future__ import annotations

from contextlib import suppress
from math import nan, radians
import time

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from spm_haptic_master.description.three_encoders import ThreeEncoders
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics import Geometry, zxz_angles
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion
from spm_haptic_master.kinematics.mounting import IDENTITY
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion
from spm_haptic_master.nodes.diagnostics import MESSAGES
from spm_haptic_master.parameters import geometry
from spm_haptic_master.parameters.setting import SENSORS_SETTING, Values
from spm_haptic_master.supervision.orientation_state import OrientationState, received_state
from spm_haptic_master.timing import Periodic
from spm_haptic_master.view import status
from spm_haptic_master.view.messages import StampedAngles
from spm_haptic_master.view.names import SENSOR_NAMES
from spm_haptic_master.view.page import Page, Panel
from spm_haptic_master.view.scene import Scene
from spm_haptic_master.view.seen import Seen, Settings
from spm_haptic_master.view.settings_client import SettingsClient
from spm_haptic_master.view.simulated_device import SimulatedDevice
from spm_haptic_master.view.status_entries import ORIENTATION, SINGULARITY, StatusEntries
from spm_haptic_master.view.topics import DeviceTopics
from spm_haptic_master.view.truth import DeviceError

# Shortest time between two drawings of the joints (s): nobody sees faster ones.
LEAST_PERIOD = 0.012
# Periods of the map, of the trace and of the figures (s).
MAP_PERIOD = 0.8
TRACE_PERIOD = 0.1
FIGURES_PERIOD = 0.25
# Time for which the first page has the device without dome, names and cones (s): a browser without
# a GPU takes a second for these, and the device would wait for that.
DEVICE_ALONE = 3.0
# Time without a publisher after which a device can be dropped (s).
GONE_AFTER = 60.0


class Arm:
    """
    One device: the topics of a namespace, '/' or '/NAME'.

    It draws the pose as joint angles come, and everything else at the periods above.

    Parameters
    ----------
    node : Node
        Subscribes and publishes for the device.
    taker : Node
        A node without an executor. It has the topics of which only the newest message is taken,
        when it is drawn.
    page : Page
        The page that shows the device.
    namespace : str
        Namespace of the device, '/' or '/NAME'.

    Attributes
    ----------
    title : str
        Name on the page: the namespace without slashes at its ends, empty for '/'.
    seen : Seen
        What is known of the device, as the page shows it.
    simulation : SimulatedDevice
        Controls of the device, which it has only with a simulated source.

    """

    def __init__(
        self,
        node: Node,
        taker: Node,
        page: Page,
        namespace: str,
    ) -> None:
        now = time.monotonic()
        self._page = page
        self._prefix = namespace.rstrip('/')
        self.title = self._prefix.strip('/')
        self._rank = 0
        self._scene: Scene | None = None
        self._state: OrientationState | None = None
        self._stamp: int | None = None  # of the latest joint angles, ns
        self._age = status.SampleAge()
        # Times since which a page shows the device, and of the latest tick (s, monotonic).
        self._seen_since = self._ticked = now
        self._there_at = now  # when it had a publisher last (s)
        self._joints = Periodic(LEAST_PERIOD)
        self._trace = Periodic(TRACE_PERIOD)
        self._map = Periodic(MAP_PERIOD)
        self._figures = Periodic(FIGURES_PERIOD)
        # Poses drawn since the figures were shown, and when that was (s).
        self._drawn = 0
        self._shown_at = now
        self._use_geometry(Geometry())
        self.seen = Seen(status.banner(None, None))
        self._entries = StatusEntries(self._prefix)
        self._panel = Panel(page.server.gui, self.title)
        self.simulation = SimulatedDevice(
            node,
            page.server.gui,
            self._panel.folder,
            self._panel.knobs_order,
            self._name,
        )
        self._topics = DeviceTopics(
            node,
            taker,
            self._name,
            self._on_joints,
            self._on_state,
            self._on_source,
        )
        self._client = SettingsClient(node, self._name('fkm/get_parameters'), self._on_settings)
        # Settings of the mechanism that is drawn, none before the first.
        self._settings: Values = {}

    def _name(self, topic: str) -> str:
        """Return the name of a topic in the namespace of the device."""
        return f'{self._prefix}/{topic}'

    def _use_geometry(self, mechanism: Geometry) -> None:
        """
        Compute with a mechanism from now on.

        The classic model and the error of a story begin again without poses.
        """
        self._geometry = mechanism
        self._ghost = ThreeEncoders(mechanism)
        self._truth = DeviceError(mechanism)

    def close(self) -> None:
        """Take the device off the page, and end its subscriptions."""
        self._topics.close()
        self._client.close()
        self.simulation.close()
        self._panel.remove()
        if self._scene is not None:
            self._scene.remove()
        self._page.drop(self.title)

    def stand(self, rank: int) -> None:
        """
        Let the device stand at a place of the row, from 0, and of the panel.

        Parameters
        ----------
        rank : int
            Place in the row, from 0 on the left.

        """
        self._rank = rank
        self._panel.stand(rank)
        if self._scene is not None:
            self._scene.stand(rank)

    def is_there(self, now: float) -> bool:
        """
        Return whether a program has published topics of the device, a minute ago or less.

        Parameters
        ----------
        now : float
            Present time, s, monotonic.

        Returns
        -------
        bool
            False if no program has published its topics for more than GONE_AFTER.

        """
        if self._topics.publishers():
            self._there_at = now
        return now - self._there_at <= GONE_AFTER

    def on_diagnostics(self, entry: DiagnosticStatus) -> None:
        """
        Take an entry of /diagnostics, if it is this device's.

        Parameters
        ----------
        entry : DiagnosticStatus
            An entry of any node of any device.

        """
        self._entries.add(entry, time.monotonic())

    def _on_joints(self, joints: StampedAngles) -> None:
        """
        Take the angles of all nine joints, and draw them if that is due.

        A repeated stamp is ignored. The pose is drawn only if a page is open and the orientation
        is being published, and at most once in LEAST_PERIOD.

        Parameters
        ----------
        joints : StampedAngles
            Angles of all nine joints, rad, and their stamp, ns.

        """
        if joints.stamp == self._stamp:
            return  # an old pose, repeated
        now = time.monotonic()
        self._stamp = joints.stamp
        self.seen.angles = joints.angles
        self._ghost.add_pose(joints.stamp, joints.angles)
        self._truth.add_pose(joints.stamp, joints.angles)
        self._age.renew(now)
        publishes = self._state is not None and self._state.publishes
        if self._scene is None or not publishes or not self._is_watched():
            return
        if self._joints.is_due(now):
            with self._page.server.atomic():
                self._scene.place(joints.angles)
            self._drawn += 1

    def _on_state(self, words: str) -> None:
        """Take the state of the orientation, and show it at once."""
        self._state = received_state(words)
        self._show_state(time.monotonic())

    def _on_source(self, words: str) -> None:
        """Take the source of the joint angles; a simulated one has knobs."""
        self.seen.source = words
        self.simulation.show(words, self.seen.settings.sensors)

    def _on_settings(self, values: Values) -> None:
        """Draw the mechanism of fkm's settings; ignore those that cannot be drawn."""
        with suppress(SpmError):
            self.build(values)

    def build(self, values: Values) -> None:
        """
        Draw the mechanism of settings, if they are new.

        Parameters
        ----------
        values : mapping
            Checked settings of fkm by name: those of `settings_client.SETTINGS`.

        Raises
        ------
        SpmError
            The mechanism cannot be assembled, and so cannot be drawn.

        """
        if values == self._settings:
            return
        mechanism = geometry.geometry_from(values)
        mounting = geometry.mounting_from(values)
        sensors = values[SENSORS_SETTING.name]
        self._use_geometry(mechanism)
        self.seen.settings = Settings(
            sensors=sensors,
            alert_limit=values['alert_limit_deg'],
            calibration=values.get('calibration', ''),
        )
        if self._scene is not None:
            self._scene.remove()
        self._scene = Scene(
            self._page.server.scene,
            self.title,
            mechanism,
            values[geometry.WORKING_MODE_SETTING.name],
            IDENTITY if mounting is None else mounting.base,
            sensors,
        )
        self._scene.stand(self._rank)
        self.seen.states = []
        self.simulation.show(self.seen.source, sensors)
        self._settings = values

    def _is_watched(self) -> bool:
        """Return whether a browser has the page open."""
        return bool(self._page.server.get_clients())

    def tick(self, now: float) -> None:
        """
        Draw what is due; call it every 50 ms.

        Parameters
        ----------
        now : float
            Present time, s, monotonic.

        """
        self._client.tick(now)
        self._age.tick(now)
        self._show_state(now)
        watched = self._is_watched()
        self._watch(now, watched)
        self._play(now)
        self._solve(now, watched)
        seen = self.seen
        scene = self._scene
        if watched and scene is not None and seen.angles is not None:
            th1a, th2a, th3a = seen.angles[:3]
            seen.orientation = chain_quaternion(
                th1a,
                th2a,
                th3a,
                self._geometry,
                FLOATS,
            )
            self._draw_over(scene, seen.orientation, now)
        if watched and self._figures.is_due(now):
            self._show_figures(now)
        self._ticked = now

    def _watch(self, now: float, watched: bool) -> None:
        """
        Follow since when the device is seen: the trace must not bridge what nobody saw.

        After DEVICE_ALONE, the dome, the names and the cones are shown as well.
        """
        scene = self._scene
        if scene is not None and not (watched and self.seen.banner.alive):
            scene.dome.break_trace()
        if scene is None or not watched:
            self._seen_since = now
        elif now - self._seen_since >= DEVICE_ALONE:
            scene.show_rest()

    def _play(self, now: float) -> None:
        """Continue the story that is played, and observe the device meanwhile."""
        self.seen.story = self.simulation.tick(now)
        player = self.simulation.player
        truth = self._topics.truth(wanted=player.is_playing)
        error = self._truth.error(truth)
        alive = self.seen.banner.alive
        if player.is_playing:
            three = self._ghost.error if alive else None
            player.observed.add(
                now - self._ticked,
                alive,
                nan if three is None else three,
                error if alive else nan,
            )

    def _solve(self, now: float, watched: bool) -> None:
        """
        Take the newest messages, and solve for three encoders alone.

        The dexterity of three sensors decides from which pose their solution continues.
        """
        readings = self._topics.tick(now, watched)
        self.seen.dexterities = self._topics.dexterities
        if self.seen.dexterities is None:
            three = None
        else:
            three = self.seen.dexterities[0]
        self._ghost.solve(three)
        if readings is not None:
            self._ghost.add_readings(readings.stamp, readings.angles[:3])

    def _draw_over(
        self,
        scene: Scene,
        orientation: Quaternion[float],
        now: float,
    ) -> None:
        """
        Draw what is over the device: its trace, its map, the ghost and the torques.

        Parameters
        ----------
        scene : Scene
            The device in the scene.
        orientation : tuple of 4 float
            Quaternion x, y, z, w of the platform in the base frame.
        now : float
            Present time, s, monotonic.

        """
        alive = self.seen.banner.alive
        if alive and self._trace.is_due(now):
            scene.dome.move(rotation_from_quaternion(*orientation)[2::3])
            level = self._entries.numbers(ORIENTATION).get('protection level (deg)', nan)
            scene.show_level(radians(level))
            scene.ghost.show(self._ghost.turn)
        if self._map.is_due(now):
            scene.dome.paint(zxz_angles(*orientation)[2])
        if not alive:
            scene.ghost.show(None)
        no_torques = [(0.0, 0.0, 0.0)] * len(scene.torques)
        scene.show_torques(self._topics.torques() if alive else no_torques)

    def _show_figures(self, now: float) -> None:
        """Show figures, plots, the encoders' states and the sliders."""
        seen = self.seen
        topics = self._topics
        self._show_sensors()
        seen.ghost = self._ghost.error
        seen.pace = self._drawn / max(now - self._shown_at, FIGURES_PERIOD)
        self._drawn = 0
        self._shown_at = now
        seen.force = topics.force()
        seen.teleop = topics.teleop()
        seen.crtk = topics.crtk()
        seen.readings = topics.readings
        seen.ages = topics.ages()
        seen.torques = topics.torque_sizes()
        seen.further = topics.further()
        if topics.is_calibrating():
            seen.calibration = topics.calibration
        else:
            seen.calibration = None
        self._page.show_content(
            self.title,
            seen,
            self._entries,
            self._rank,
        )
        if seen.orientation is not None and seen.banner.alive:
            self.simulation.follow(seen.orientation)

    def _show_sensors(self) -> None:
        """
        Show the states of the encoders, and note what has happened.

        What has happened are events of the simulation and encoders whose state has changed.
        """
        seen = self.seen
        before = self.seen.states
        seen.states = status.sensor_states(
            self._entries,
            seen.settings.sensors,
            self._state,
            self._topics.unread(),
        )
        changed = zip(SENSOR_NAMES, seen.states, before, strict=False)
        seen.happened = [
            *self.simulation.happened(),
            *(f'{name} {state.words}' for name, state, was in changed if state != was),
        ]
        if self._scene is not None:
            self._scene.show_sensors(seen.states)

    def _show_state(self, now: float) -> None:
        """
        Show the state at a time, s, and whether the picture is alive.

        The reason of the node `diagnostics` is shown only if it is not one of its messages about
        dexterity.
        """
        self._entries.now = now
        entry = self._entries.entry(SINGULARITY)
        if entry is None or entry.message in MESSAGES:
            reason = ''
        else:
            reason = entry.message
        heard = not self._entries.has_ended(ORIENTATION)
        shown = status.banner(
            self._state,
            self._age.value,
            reason,
            heard,
        )
        self.seen.banner = shown
        if self._scene is not None:
            self._scene.set_alive(shown.alive)
        self._page.show(self.title, shown)
