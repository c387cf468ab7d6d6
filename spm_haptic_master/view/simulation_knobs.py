# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""All that a client of the page can operate; only a simulated device has it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from html import escape
from math import degrees, radians
from typing import Any

from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.simulation.fault_injection import SWITCHED
from spm_haptic_master.simulation.steering import PHI_LIMITS, TILT_LIMIT
from spm_haptic_master.simulation.stories import Player, stories, Story
from viser import GuiApi, GuiEvent

# Size of an offset, until another one is chosen (deg).
OFFSET = 5.0
# Pose of the sliders before the first one of the device (deg): tilt, azimuth, self-rotation; and
# their steps (deg).
FIRST_POSE, STEPS = (0.0, 0.0, 45.0), (0.5, 1.0, 0.5)


class SimulationKnobs:
    """
    The knobs of a simulated device.

    Parameters
    ----------
    gui : GuiApi
        Panel of the page.
    order : float
        Where they are in the panel.
    steer : callable
        Called with tilt, azimuth and phi, rad, or with nothing to let the device go on by itself.
    fail : callable
        Called with the faults wanted, as a text.
    sensors : int
        Number of sensors.

    Attributes
    ----------
    player : Player
        What plays the stories.

    """

    def __init__(self, gui: GuiApi, order: float, steer: Callable[..., None],
                 fail: Callable[[str], None], sensors: int) -> None:
        self._gui, self._steer, self._fail = gui, steer, fail
        self.sensors = sensors
        self.player = Player(steer, fail)
        # Whether a user leads the device; if not, the sliders follow it.
        self._touched = False
        self._faults = ''
        self._folder = gui.add_folder('Simulation', order=order)
        with self._folder:
            self._add_simulation()

    def _add_simulation(self) -> None:
        gui = self._gui
        for story in stories(self.sensors):
            gui.add_button(story.name).on_click(partial(self._play, story))
        low, high = map(degrees, PHI_LIMITS)
        limits = (0.0, round(degrees(TILT_LIMIT))), (-180.0, 180.0), (round(low), round(high))
        self.sliders = tuple(
            gui.add_slider(f'{name}, deg', *limit, step, value)
            for name, limit, step, value in zip(
                ('tilt', 'azimuth', 'self-rotation'), limits, STEPS, FIRST_POSE, strict=True))
        for slider in self.sliders:
            slider.on_update(self._on_slider)
        gui.add_button('move by itself').on_click(lambda _: self._release())
        self.joint = gui.add_dropdown('encoder', ALL_JOINT_NAMES[:self.sensors],
                                      initial_value=ALL_JOINT_NAMES[1])
        self.offset = gui.add_number('offset, deg', OFFSET, min=-180.0, max=180.0, step=0.1)
        gui.add_button_group('fault', SWITCHED).on_click(
            lambda event: self.add_fault(str(event.target.value)))
        gui.add_button('no fault').on_click(lambda _: self._set_faults(''))
        self._faults_html = gui.add_html('')

    def _play(self, story: Story, _: Any) -> None:
        self._touched = False
        self.player.play(story)

    def _on_slider(self, event: GuiEvent[Any]) -> None:
        if event.client is None:
            return  # it follows the device
        self._touched = True
        self.player.stop()
        self._steer(*(radians(each.value) for each in self.sliders))

    def _release(self) -> None:
        self._touched = False
        self.player.stop()
        self._steer()

    def _set_faults(self, faults: str) -> None:
        self.player.stop()
        self._fail(faults)

    def add_fault(self, kind: str) -> None:
        """Ask for one more fault, beside those that there are."""
        text = f'{kind}:{self.joint.value}'
        if kind == 'offset':
            text += f'={self.offset.value:g}'
        # Another offset of the same joint is in place of that before, not on top of it.
        present = [each for each in self._faults.split(', ')
                   if each and each.partition('=')[0] != text.partition('=')[0]]
        self._set_faults(', '.join([*present, text]))

    def follow(self, tilt: float, azimuth: float, phi: float) -> None:
        """Set the sliders to a pose of the device, rad, unless a user leads it."""
        if self._touched:
            return
        for slider, value, step in zip(self.sliders, (tilt, azimuth, phi), STEPS, strict=True):
            shown = min(max(step * round(degrees(value) / step), slider.min), slider.max)
            if shown != slider.value:
                slider.value = shown

    def show(self, faults: str) -> None:
        """Show the faults that are present."""
        self._faults = faults
        self._faults_html.content = (
            '<div class="spm-device spm-event">faults: '
            f'{escape(faults) or "none"}</div>')

    def remove(self) -> None:
        """Take them from the page."""
        self._folder.remove()
