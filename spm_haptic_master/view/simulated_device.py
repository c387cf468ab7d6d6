# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The controls of the page; only a device with a simulated source has them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from html import escape
from math import atan2, degrees, hypot, radians
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from spm_haptic_master.kinematics import zxz_angles
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, FAULTS_TOPIC, STEER_TOPIC
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.simulation.fault_injection import SWITCHED
from spm_haptic_master.simulation.steering import PHI_LIMITS, place, TILT_LIMIT
from spm_haptic_master.view.names import joint_of, SENSOR_NAMES, with_sensor_names
from spm_haptic_master.view.stories import stories, Story, StoryNews
from spm_haptic_master.view.story_player import StoryPlayer
from std_msgs.msg import Float64MultiArray, String
from viser import GuiApi, GuiEvent, GuiFolderHandle

# Words on the topic `source` of a simulation.
SIMULATED = 'sim'
# Size of an offset, until another one is chosen (deg).
OFFSET = 5.0
# Pose of the sliders before the first one of the device (deg): tilt, azimuth, self-rotation; and
# their steps (deg).
FIRST_POSE = (0.0, 0.0, 45.0)
STEPS = (0.5, 1.0, 0.5)
# Tilt below which an azimuth is nothing but noise: its slider stands still (rad).
LEAST_TILT = radians(1.0)


class SimulatedDevice:
    """
    The knobs of a simulated device and the topics behind them; none for another source.

    Parameters
    ----------
    node : Node
        Publishes the requests of the knobs.
    gui : GuiApi
        Panel of the page.
    folder : context manager
        The device's part of the panel.
    order : float
        Place of the knobs in it.
    name : callable
        Returns the name of a topic in the device's namespace.

    Attributes
    ----------
    knobs : GuiFolderHandle or None
        Folder with the knobs; None of a device that is not simulated.
    player : StoryPlayer
        Plays the stories of the buttons.

    """

    def __init__(
        self,
        node: Node,
        gui: GuiApi,
        folder: AbstractContextManager[Any],
        order: float,
        name: Callable[[str], str],
    ) -> None:
        self._node = node
        self._gui = gui
        self._panel = folder
        self._name = name
        self._order = order
        # Publishers by topic, made for the first simulated source.
        self._outs: dict[str, Publisher] = {}
        self.knobs: GuiFolderHandle | None = None
        self._sensors = 0  # number of them; 0 of a device that is not simulated
        self.player = StoryPlayer(self._steer_to, self._fail)
        # Whether a user leads the device; if not, the sliders follow it.
        self._led_by_user = False
        # Faults that are present, as a text.
        self._faults = ''
        # Changes of the faults, in words; the caller empties it.
        self._happened: list[str] = []

    def show(self, source: str, sensors: int) -> None:
        """
        Show the knobs of a simulated source with a number of sensors, of another one none.

        Parameters
        ----------
        source : str
            Words of the topic `source`; empty: not known.
        sensors : int
            Number of sensors, 4 to 6.

        """
        shown = sensors if source == SIMULATED else 0
        if shown == self._sensors:
            return
        self._sensors = shown
        if self.knobs is not None:
            self.knobs.remove()
            self.knobs = None
            self._led_by_user = False
            self.player.stop()
        if shown:
            self._connect()
            self._add_knobs()
            self._show_faults()

    def close(self) -> None:
        """Remove the knobs and end the topics."""
        self.show('', 0)
        for publisher in self._outs.values():
            self._node.destroy_publisher(publisher)

    def _connect(self) -> None:
        """Make the topics, if they have not been made yet."""
        if self._outs:
            return
        for topic, kind in ((STEER_TOPIC, Float64MultiArray), (FAULT_TOPIC, String)):
            self._outs[topic] = self._node.create_publisher(kind, self._name(topic), 1)
        self._node.create_subscription(
            String,
            self._name(FAULTS_TOPIC),
            self._on_faults,
            STATE,
        )

    def _add_knobs(self) -> None:
        """Add the stories, the sliders and the faults."""
        gui = self._gui
        with self._panel:
            self.knobs = gui.add_folder('Simulation: try', order=self._order)
        with self.knobs:
            for story in stories(self._sensors):
                gui.add_button(story.name).on_click(partial(self._play, story))
            self._add_sliders()
            with gui.add_folder('break an encoder', expand_by_default=False):
                self._add_faults()

    def _add_sliders(self) -> None:
        """Add the sliders of the pose, deg."""
        low, high = map(degrees, PHI_LIMITS)
        limits = (0.0, round(degrees(TILT_LIMIT))), (-180.0, 180.0), (round(low), round(high))
        names = 'tilt', 'azimuth', 'self-rotation'
        self.sliders = tuple(
            self._gui.add_slider(f'{name}, deg', *limit, step, value)
            for name, limit, step, value in zip(
                names,
                limits,
                STEPS,
                FIRST_POSE,
                strict=True,
            )
        )
        for slider in self.sliders:
            slider.on_update(self._on_slider)
        self._gui.add_button('move by itself').on_click(self._release)

    def _add_faults(self) -> None:
        """Add what lets encoders fail."""
        gui = self._gui
        names = SENSOR_NAMES[: self._sensors]
        self.sensor = gui.add_dropdown('encoder', names, initial_value=SENSOR_NAMES[1])
        self.offset = gui.add_number(
            'offset, deg',
            OFFSET,
            min=-180.0,
            max=180.0,
            step=0.1,
        )
        kinds = gui.add_button_group('fault', SWITCHED)
        kinds.on_click(lambda event: self.add_fault(str(event.target.value)))
        gui.add_button('no fault').on_click(lambda _: self._set_faults(''))
        self._faults_html = gui.add_html('')

    def tick(self, now: float) -> StoryNews | None:
        """
        Continue the story that is played, at a time, s; return its news, None without one.

        Parameters
        ----------
        now : float
            Present time, monotonic.

        """
        return self.player.tick(now, self._sensors)

    def happened(self) -> list[str]:
        """Return what has happened since the last call, in words."""
        found = [*self._happened, *self.player.happened]
        self._happened = []
        self.player.happened = []
        return found

    def follow(self, orientation: Quaternion[float]) -> None:
        """
        Set the sliders to an orientation of the device, unless a user leads it.

        Parameters
        ----------
        orientation : tuple of 4 float
            Quaternion x, y, z, w of the platform in the base frame.

        """
        if self.knobs is None or self._led_by_user:
            return
        u, v, phi = place(*zxz_angles(*orientation))
        tilt = hypot(u, v)
        pose = tilt, atan2(v, u) if tilt > LEAST_TILT else None, phi
        for slider, value, step in zip(
            self.sliders,
            pose,
            STEPS,
            strict=True,
        ):
            if value is not None:
                rounded = step * round(degrees(value) / step)
                slider.value = min(max(rounded, slider.min), slider.max)

    def add_fault(self, kind: str) -> None:
        """
        Ask for one more fault, beside those that are present.

        Parameters
        ----------
        kind : str
            One of SWITCHED. The encoder, and the size of an offset (deg), are those chosen on the
            page.

        """
        fault = f'{kind}:{joint_of(self.sensor.value)}'
        # Another offset of the same joint replaces the one before.
        present = [
            other
            for other in self._faults.split(', ')
            if other and other.partition('=')[0] != fault
        ]
        if kind == 'offset':
            fault += f'={self.offset.value:g}'
        self._set_faults(', '.join([*present, fault]))

    def _play(self, story: Story, _: Any) -> None:
        """Play a story in place of another one, and of the user."""
        self._led_by_user = False
        self.player.play(story)

    def _on_slider(self, event: GuiEvent[Any]) -> None:
        """Let the user lead the device, unless the slider has followed it."""
        if event.client is None:
            return
        self._led_by_user = True
        self.player.stop()
        self._steer(*(radians(slider.value) for slider in self.sliders))

    def _release(self, _: Any) -> None:
        """Let the device move by itself."""
        self._led_by_user = False
        self.player.stop()
        self._steer()

    def _set_faults(self, faults: str) -> None:
        """Ask for faults in place of a story's."""
        self.player.stop()
        self._fail(faults)

    def _on_faults(self, message: String) -> None:
        """Show the faults that are present."""
        if message.data != self._faults:
            self._happened.append(f'faults: {with_sensor_names(message.data) or "none"}')
        self._faults = message.data
        if self.knobs is not None:
            self._show_faults()

    def _show_faults(self) -> None:
        """Show the faults below the buttons."""
        words = escape(with_sensor_names(self._faults)) or 'none'
        self._faults_html.content = f'<div class="spm-device spm-event">faults: {words}</div>'

    def _steer_to(self, phi: float | None) -> None:
        """Lead the device to a self-rotation at the centre, deg; None: it moves by itself."""
        if phi is None:
            self._steer()
        else:
            self._steer(0.0, 0.0, radians(phi))

    def _steer(self, *pose: float) -> None:
        """Lead the device to tilt, azimuth and phi, rad; without a pose it moves by itself."""
        if self._sensors:
            self._outs[STEER_TOPIC].publish(Float64MultiArray(data=list(pose)))

    def _fail(self, faults: str) -> None:
        """Ask for faults; an empty text: for none."""
        if self._sensors:
            self._outs[FAULT_TOPIC].publish(String(data=faults))
