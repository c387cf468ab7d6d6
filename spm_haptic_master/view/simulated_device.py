# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The controls of the page; only a device with a simulated source has them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from functools import partial
from html import escape
from math import atan2, degrees, hypot, radians
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.publisher import Publisher
from spm_haptic_master.kinematics import zxz_angles
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES, NUMBER_WORDS
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, FAULTS_TOPIC, STEER_TOPIC
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.simulation.fault_injection import SWITCHED
from spm_haptic_master.simulation.steering import PHI_LIMITS, place, TILT_LIMIT
from std_msgs.msg import Float64MultiArray, String
from viser import GuiApi, GuiEvent, GuiFolderHandle

# Words on the topic `source` of a simulation.
SIMULATED = 'sim'
# Size of an offset, until another one is chosen (deg).
OFFSET = 5.0
# Pose of the sliders before the first one of the device (deg): tilt, azimuth, self-rotation; and
# their steps (deg).
FIRST_POSE, STEPS = (0.0, 0.0, 45.0), (0.5, 1.0, 0.5)
# Self-rotation of the singularity at the workspace's centre; distances from it at which a story is
# clear of it, and three encoders are still on the wrong side (deg).
SINGULAR, AWAY, NEAR = 49.36, 15.0, 7.0


class Step(NamedTuple):
    """What happens at a time."""

    at: float  # time from the beginning, s
    # Self-rotation at the centre to which the device is led, deg; None: unchanged.
    phi: float | None = None
    faults: str | None = None  # faults from then on; None: unchanged


class Story(NamedTuple):
    """A sequence of steps, and its explanation; it ends with the last step."""

    name: str
    words: str
    steps: tuple[Step, ...]


class SimulatedDevice:
    """
    The knobs of a simulated device and the topics behind them; none for another source.

    `folder` is the device's part of the panel and `order` the knobs' place in it; `name` returns
    the name of a topic in the device's namespace.
    """

    def __init__(
        self,
        node: Node,
        gui: GuiApi,
        folder: AbstractContextManager[Any],
        order: float,
        name: Callable[[str], str],
    ) -> None:
        self._node, self._gui, self._panel, self._name = node, gui, folder, name
        self._order = order
        # Publishers by topic, made for the first simulated source.
        self._outs: dict[str, Publisher] = {}
        self.knobs: GuiFolderHandle | None = None
        self._sensors = 0  # number of them; 0 of a device that is not simulated
        # Words of the story that is played, one a tick; threads of the server may replace it.
        self._playing: Iterator[str] = iter(())
        self._now = 0.0  # time of the latest tick, s
        # Whether a user leads the device; if not, the sliders follow it.
        self._touched = False
        # Faults that are present, as a text.
        self._faults = ''
        # Changes of the faults, in words; the caller empties it.
        self.happened: list[str] = []

    def show(self, source: str, sensors: int) -> None:
        """Show the knobs of a simulated source with a number of sensors, of another one none."""
        shown = sensors if source == SIMULATED else 0
        if shown == self._sensors:
            return
        self._sensors = shown
        if self.knobs is not None:
            self.knobs.remove()
            self.knobs = None
            self._lead(False)
        if not shown:
            return
        if not self._outs:
            node, name = self._node, self._name
            self._outs = {
                topic: node.create_publisher(kind, name(topic), 1)
                for topic, kind in ((STEER_TOPIC, Float64MultiArray), (FAULT_TOPIC, String))
            }
            node.create_subscription(String, name(FAULTS_TOPIC), self._on_faults, STATE)
        with self._panel:
            self.knobs = self._gui.add_folder('Simulation', order=self._order)
        with self.knobs:
            self._add_knobs()
        self._show_faults()

    def _add_knobs(self) -> None:
        gui = self._gui
        for story in stories(self._sensors):
            gui.add_button(story.name).on_click(partial(self._play, story))
        low, high = map(degrees, PHI_LIMITS)
        limits = (0.0, round(degrees(TILT_LIMIT))), (-180.0, 180.0), (round(low), round(high))
        self.sliders = tuple(
            gui.add_slider(f'{name}, deg', *limit, step, value)
            for name, limit, step, value in zip(
                ('tilt', 'azimuth', 'self-rotation'), limits, STEPS, FIRST_POSE, strict=True
            )
        )
        for slider in self.sliders:
            slider.on_update(self._on_slider)
        gui.add_button('move by itself').on_click(self._release)
        self.joint = gui.add_dropdown(
            'encoder', ALL_JOINT_NAMES[: self._sensors], initial_value=ALL_JOINT_NAMES[1]
        )
        self.offset = gui.add_number('offset, deg', OFFSET, min=-180.0, max=180.0, step=0.1)
        gui.add_button_group('fault', SWITCHED).on_click(
            lambda event: self.add_fault(str(event.target.value))
        )
        gui.add_button('no fault').on_click(lambda _: self._set_faults(''))
        self._faults_html = gui.add_html('')

    def tick(self, now: float) -> str:
        """Continue the story that is played, at a time, s; return its words, empty without."""
        self._now = now
        return next(self._playing, '')

    def follow(self, orientation: Quaternion[float]) -> None:
        """Set the sliders to an orientation of the device, unless a user leads it."""
        if self.knobs is None or self._touched:
            return
        u, v, phi = place(*zxz_angles(*orientation))
        for slider, value, step in zip(
            self.sliders, (hypot(u, v), atan2(v, u), phi), STEPS, strict=True
        ):
            slider.value = min(max(step * round(degrees(value) / step), slider.min), slider.max)

    def add_fault(self, kind: str) -> None:
        """Ask for one more fault, beside those that are present."""
        text = f'{kind}:{self.joint.value}'
        if kind == 'offset':
            text += f'={self.offset.value:g}'
        # Another offset of the same joint replaces the one before.
        present = [
            each
            for each in self._faults.split(', ')
            if each and each.partition('=')[0] != text.partition('=')[0]
        ]
        self._set_faults(', '.join([*present, text]))

    def _lead(self, touched: bool) -> None:
        """End the story; the device is led by the user or not."""
        self._touched = touched
        self._playing = iter(())

    def _play(self, story: Story, _: Any) -> None:
        self._touched = False
        self._playing = self._steps(story)

    def _steps(self, story: Story) -> Iterator[str]:
        """Do each step of a story when it is due; yield its words until it ends."""
        began = self._now
        for step in story.steps:
            while self._now - began < step.at:
                yield story.words
            if step.faults is not None:
                self._fail(step.faults)
            if step.phi is not None:
                self._steer(0.0, 0.0, radians(step.phi))
        self._steer()

    def _on_slider(self, event: GuiEvent[Any]) -> None:
        if event.client is None:
            return  # it follows the device
        self._lead(True)
        self._steer(*(radians(each.value) for each in self.sliders))

    def _release(self, _: Any) -> None:
        self._lead(False)
        self._steer()

    def _set_faults(self, faults: str) -> None:
        self._playing = iter(())
        self._fail(faults)

    def _on_faults(self, message: String) -> None:
        if message.data != self._faults:
            self.happened.append(f'faults: {message.data or "none"}')
        self._faults = message.data
        if self.knobs is not None:
            self._show_faults()

    def _show_faults(self) -> None:
        self._faults_html.content = (
            f'<div class="spm-device spm-event">faults: {escape(self._faults) or "none"}</div>'
        )

    def _steer(self, *pose: float) -> None:
        """Lead the device to tilt, azimuth and phi, rad; without a pose it moves by itself."""
        if self._sensors:
            self._outs[STEER_TOPIC].publish(Float64MultiArray(data=list(pose)))

    def _fail(self, faults: str) -> None:
        if self._sensors:
            self._outs[FAULT_TOPIC].publish(String(data=faults))


def stories(sensors: int) -> tuple[Story, ...]:
    """Return the stories of a device with a number of sensors."""
    four = sensors == len(JOINT_NAMES)
    number = NUMBER_WORDS[sensors]
    return (
        Story(
            'cross the singularity',
            'Three encoders lose the handle at the singularity: the violet ghost is what they '
            f'would report. The device has {number} and goes through as if nothing were there.',
            (
                Step(0.0, SINGULAR - AWAY, ''),
                Step(3.0, SINGULAR),
                Step(6.0, SINGULAR + NEAR),
                Step(10.0, SINGULAR + AWAY),
                Step(13.0, SINGULAR - AWAY),
                Step(17.0),
            ),
        ),
        Story(
            'break th3A there',
            'Here th3A alone knows the self-rotation and no other encoder checks it: its chip '
            'is amber. It freezes, its own stillness gives it away, and the device is silent.'
            if four
            else f'With {number} encoders the others check th3A even at the singularity. It '
            'freezes, '
            'is excluded, and the device continues without it.',
            (
                Step(0.0, SINGULAR, ''),
                Step(5.0, None, 'stuck:joint_3a'),
                Step(7.0, SINGULAR - AWAY),
                Step(14.0, None, ''),
                Step(16.0),
            ),
        ),
        Story(
            f'unplug one of {number}',
            'With four encoders none may be missing: without th1B the device is silent. With '
            'six it continues: start it with -p sensors:=6.'
            if four
            else f'One of {number} encoders does not answer: its chip is black, and the '
            'state says '
            'so. The device continues with the others.',
            (
                Step(0.0, None, ''),
                Step(2.0, None, 'dropout:joint_1b'),
                Step(9.0, None, ''),
                Step(11.0),
            ),
        ),
    )
