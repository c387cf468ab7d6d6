# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is beside the picture of a device: figures, plots, the simulation's knobs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import partial
from html import escape
from typing import Any

from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.view.history import History
from spm_haptic_master.view.liveness import Light
from spm_haptic_master.view.scene import MAGNIFICATION
from spm_haptic_master.view.simulation_knobs import SimulationKnobs
from viser import ViserServer

# Names of the plots. The angles are not the encoders' readings.
ANGLES = 'Joint angles of the orientation, deg'
LEVELS = 'Parity, sigma, and protection level, deg'
LATENCY = 'Latency from sample to publication, us'
# Time that a plot of angles spans (s), its rows per second, and the same of slow figures.
ANGLE_SPAN, ANGLE_RATE = 20.0, 10.0
SLOW_SPAN, SLOW_RATE = 120.0, 1.0
# Height of a plot (pixels).
PLOT_HEIGHT = 150
# Diameter of a dot (pixels), and colours of the quantities.
DOT = 3
LINES = ('#1f77b4', '#d95f1a', '#2b944c', '#7a5bc0')
# What the colours of the picture mean.
LEGEND = ('<div style="font-size:.8em;opacity:.75;padding:0 .8em">Map: dexterity of three sensors '
          'at the present self-rotation, red where it vanishes; dark dots: parallel '
          f'singularities. Cone: protection level, {MAGNIFICATION:g} times as wide.</div>')
# Share above which a motion of a calibration has little left to give.
ENOUGH = 0.9


class Panel:
    """
    The panel of one device.

    Parameters
    ----------
    server : ViserServer
        Server of the page.
    title : str
        Name of the device; empty where there is one without a namespace.
    steer, fail : callable
        As of `SimulationKnobs`.

    Attributes
    ----------
    knobs : SimulationKnobs or None
        The knobs of a simulated device; None with any other.

    """

    def __init__(self, server: ViserServer, title: str, steer: Callable[..., None],
                 fail: Callable[[str], None]) -> None:
        self._gui = gui = server.gui
        self.knobs: SimulationKnobs | None = None
        self._folder = gui.add_folder(title) if title else nullcontext()
        with self._folder:
            self._figures_html = gui.add_html('')
            self._plots = [gui.add_folder(title, visible=False)
                           for title in (ANGLES, LEVELS, LATENCY)]
            with self._plots[0]:
                self.angles = History(4, int(ANGLE_SPAN * ANGLE_RATE))
                self._angle_plot = self._plot(self.angles, ALL_JOINT_NAMES[:4], ANGLE_SPAN)
            with self._plots[1]:
                self.parity = History(2, int(SLOW_SPAN * SLOW_RATE))
                self._parity_plot = self._plot(
                    self.parity, ('parity', 'protection level'), SLOW_SPAN)
            with self._plots[2]:
                self.latency = History(2, int(SLOW_SPAN * SLOW_RATE))
                self._latency_plot = self._plot(self.latency, ('p50', 'p99'), SLOW_SPAN)
            gui.add_html(LEGEND)
            self._calibration_folder = gui.add_folder('Calibration', visible=False)
            with self._calibration_folder:
                self._calibration_html = gui.add_html('')
        # Behind the figures, before the plots.
        self._add_knobs = partial(
            SimulationKnobs, gui, self._figures_html.order + 0.5, steer, fail)

    def _plot(self, history: History, names: tuple[str, ...], span: float) -> Any:
        # Dots: the page has NaN where nothing was seen, over which it would draw a line.
        return self._gui.add_uplot(
            history.columns(0.0),
            ({'label': 'time'}, *(
                {'label': name, 'stroke': colour, 'width': 0, 'points': {
                    'show': True, 'size': DOT, 'width': 1, 'fill': colour}}
                for name, colour in zip(names, LINES, strict=False))),
            scales={'x': {'time': False, 'range': (-span, 0.0)}}, height=PLOT_HEIGHT,
            legend={'show': True, 'live': False})

    def show_figures(self, rows: Mapping[str, str]) -> None:
        """Show a table of figures: HTML by name."""
        content = ''.join(f'<tr><td>{escape(name)}</td><td>{text}</td></tr>'
                          for name, text in rows.items())
        content = f'<table class="spm-table">{content}</table>'
        if content != self._figures_html.content:
            self._figures_html.content = content

    def show_plots(self) -> None:
        """Show the plots, which are hidden at first."""
        for folder in self._plots:
            folder.visible = True

    def show_angles(self, now: float) -> None:
        """Draw the plot of the angles."""
        self._angle_plot.data = self.angles.columns(now)

    def show_slow(self, now: float) -> None:
        """Draw the plots of what comes once a second."""
        self._parity_plot.data = self.parity.columns(now)
        self._latency_plot.data = self.latency.columns(now)

    def show_simulation(self, simulated: bool, sensors: int, faults: str) -> None:
        """
        Show the knobs of a simulated source, and its faults.

        With any other source the page has nothing that a client could operate, shown or not.
        """
        if simulated and self.knobs is None:
            with self._folder:
                self.knobs = self._add_knobs()
        elif not simulated and self.knobs is not None:
            self.knobs.remove()
            self.knobs = None
        if self.knobs is not None:
            self.knobs.show(sensors, faults)

    @property
    def calibrates(self) -> bool:
        """Whether a calibration by motion is shown."""
        return bool(self._calibration_folder.visible)

    def show_calibration(self, text: str, covered: Mapping[str, float]) -> None:
        """Show a calibration by motion: what to do next, and shares 0 .. 1 of what is needed."""
        self._calibration_folder.visible = bool(covered)
        self._calibration_html.content = (
            f'<div style="padding:0 .8em;font-size:.86em"><b>{escape(text)}</b>' + ''.join(
                f'<br>{escape(name)}{bar(share, _colour(share))}'
                for name, share in covered.items()) + '</div>')


def _colour(share: float) -> str:
    return str((Light.GREEN if share >= ENOUGH else Light.AMBER).value)


def bar(share: float, colour: str) -> str:
    """Return a bar that is filled by a share, 0 .. 1, as HTML."""
    width = 100.0 * min(max(share, 0.0), 1.0)
    return (f'<div class="spm-bar"><div style="width:{width:.1f}%;background:{colour}"></div>'
            '</div>')
