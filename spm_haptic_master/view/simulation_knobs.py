# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""All that a client of the page can operate; only a simulated device has it."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from math import degrees, radians

from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.simulation.fault_injection import SWITCHED
from spm_haptic_master.simulation.steering import PHI_LIMITS, TILT_LIMIT
from viser import GuiApi

# Size of an offset, until another one is chosen (deg).
OFFSET = 5.0
# Pose of the sliders before one is moved (deg): tilt, azimuth, self-rotation.
FIRST_POSE = 0.0, 0.0, 45.0


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

    """

    def __init__(self, gui: GuiApi, order: float, steer: Callable[..., None],
                 fail: Callable[[str], None]) -> None:
        self._gui, self._steer, self._fail = gui, steer, fail
        self._folder = gui.add_folder('Simulation', order=order)
        with self._folder:
            self._add_simulation()

    def _add_simulation(self) -> None:
        gui = self._gui
        tilt, azimuth, phi = FIRST_POSE
        low, high = map(degrees, PHI_LIMITS)
        sliders = (
            gui.add_slider('tilt, deg', 0.0, round(degrees(TILT_LIMIT)), 0.5, tilt),
            gui.add_slider('azimuth, deg', -180.0, 180.0, 1.0, azimuth),
            gui.add_slider('self-rotation, deg', round(low), round(high), 0.5, phi))
        for slider in sliders:
            slider.on_update(lambda _: self._steer(*(radians(each.value) for each in sliders)))
        gui.add_button('move by itself').on_click(lambda _: self._steer())
        self.joint = gui.add_dropdown('encoder', ALL_JOINT_NAMES[:4],
                                      initial_value=ALL_JOINT_NAMES[1])
        self.offset = gui.add_number('offset, deg', OFFSET, min=-180.0, max=180.0, step=0.1)
        gui.add_button_group('fault', SWITCHED).on_click(
            lambda event: self.add_fault(str(event.target.value)))
        gui.add_button('no fault').on_click(lambda _: self._fail(''))
        self._faults_html = gui.add_html('')
        self._faults = ''

    def add_fault(self, kind: str) -> None:
        """Ask for one more fault, beside those that there are."""
        text = f'{kind}:{self.joint.value}'
        if kind == 'offset':
            text += f'={self.offset.value:g}'
        # Another offset of the same joint is in place of that before, not on top of it.
        present = [each for each in self._faults.split(', ')
                   if each and each.partition('=')[0] != text.partition('=')[0]]
        self._fail(', '.join([*present, text]))

    def show(self, sensors: int, faults: str) -> None:
        """Offer the encoders of a device with so many, and show the faults that are present."""
        self.joint.options = ALL_JOINT_NAMES[:sensors]
        self._faults = faults
        self._faults_html.content = (
            '<div style="padding:0 .8em;font-size:.86em">faults: '
            f'{escape(faults) or "none"}</div>')

    def remove(self) -> None:
        """Take them from the page."""
        self._folder.remove()
