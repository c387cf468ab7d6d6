# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is beside the picture of a device: state, figures, plots, the simulation's knobs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from html import escape
from math import degrees, radians
from typing import Any

from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.simulation.fault_injection import SWITCHED
from spm_haptic_master.simulation.steering import PHI_LIMITS, TILT_LIMIT
from spm_haptic_master.view.history import History
from spm_haptic_master.view.liveness import Banner, Light
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
# Colours of the lines.
LINES = ('#1f77b4', '#d95f1a', '#2b944c', '#7a5bc0')
# Size of an offset, until another one is chosen (deg).
OFFSET = 5.0
# Magnifications of the error cones.
MAGNIFICATIONS = ('1', '10', '30')
# Pose of the sliders before one is moved (deg): tilt, azimuth, self-rotation.
FIRST_POSE = 0.0, 0.0, 45.0
# Distance of the banners of two devices (em).
BANNER = 3.0
# Time after which a page that gets no news from this program says so itself (s).
NEWS_TIMEOUT = 2.5
# Share from which on a motion of a calibration has little left to give.
ENOUGH = 0.9
# Style of the banner. What covers the page when the program stands still is a part of it, hidden
# until an animation that each news starts again has run down. The page's own notices, such as that
# of a browser without a GPU, are below the banner.
STYLE = """<style>
.spm-banner{color:#fff;padding:.6em .9em;border-radius:.4em;font:600 1.15em sans-serif;
overflow-wrap:anywhere;position:fixed;left:calc(50vw - 210px);transform:translateX(-50%%);
max-width:calc(100vw - 440px);z-index:50;
box-shadow:0 1px 4px rgba(0,0,0,.3)}
@media (max-width:576px){.spm-banner{left:50vw;max-width:calc(100vw - 2em)}}
.mantine-Notifications-root{z-index:1!important}
.spm-lost{position:fixed;inset:0;z-index:100000;background:rgba(70,70,70,.88);color:#fff;
font:600 1.6em sans-serif;display:flex;align-items:center;justify-content:center;
visibility:hidden;pointer-events:none}
.spm-news0{animation:spm-lost0 .1s %(timeout)gs forwards}
.spm-news1{animation:spm-lost1 .1s %(timeout)gs forwards}
@keyframes spm-lost0{to{visibility:visible}}
@keyframes spm-lost1{to{visibility:visible}}
.spm-table{width:100%%;font-size:.86em;border-collapse:collapse;margin:.2em 0}
.spm-table td{padding:.1em .3em;vertical-align:top}
.spm-table td:first-child{white-space:nowrap;opacity:.65}
.spm-bar{background:#d8dce1;border-radius:.3em;height:.6em;margin:.3em 0}
.spm-bar div{height:100%%;border-radius:.3em}
</style>""" % {'timeout': NEWS_TIMEOUT}


class PageBanner:
    """
    The banner above the picture, with what covers the page when this program stands still.

    Parameters
    ----------
    server : ViserServer
        Server of the page.
    title : str
        Name of the device; empty where there is one without a namespace.
    number : int
        Number of the banner on the page: the second is below the first.

    """

    def __init__(self, server: ViserServer, title: str, number: int) -> None:
        self._title, self._number = title, number
        self._banner: Banner | None = None
        self._news = 0
        self._html = server.gui.add_html('')

    def show(self, banner: Banner) -> None:
        """Show a state."""
        if banner != self._banner:
            self._banner = banner
            self.refresh()

    def refresh(self) -> None:
        """Let the page know that this program is alive; call it every second."""
        if self._banner is None:
            return
        self._news = 1 - self._news
        text = f'{self._title}: {self._banner.text}' if self._title else self._banner.text
        self._html.content = (
            f'{STYLE}<div class="spm-banner" data-alive="{int(self._banner.alive)}" '
            f'style="background:{self._banner.light.value};top:{1.0 + BANNER * self._number}em">'
            f'{escape(text)}</div>'
            f'<div class="spm-lost spm-news{self._news}">no news from view: the picture is old'
            '</div>')

    def remove(self) -> None:
        """Take it from the page."""
        self._html.remove()


class Panel:
    """
    The panel of one device.

    Parameters
    ----------
    server : ViserServer
        Server of the page.
    title : str
        Name of the device; empty where there is one without a namespace.
    number : int
        Number of the device on the page: the banner of the second is below that of the first.
    steer : callable
        Called with tilt, azimuth and phi, rad, or with nothing to let the device go on by itself.
    fail : callable
        Called with the faults wanted, as a text.

    """

    def __init__(self, server: ViserServer, title: str, number: int, steer: Callable[..., None],
                 fail: Callable[[str], None]) -> None:
        self._gui = gui = server.gui
        self._steer, self._fail = steer, fail
        self._folder = gui.add_folder(title) if title else nullcontext()
        with self._folder:
            self._banner = PageBanner(server, title, number)
            self._figures_html = gui.add_html('')
            self._simulation = gui.add_folder('Simulation', visible=False)
            with self._simulation:
                self._add_simulation()
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
            self._add_picture()
            self._calibration_folder = gui.add_folder('Calibration', visible=False)
            with self._calibration_folder:
                self._calibration_html = gui.add_html('')

    def _plot(self, history: History, names: tuple[str, ...], span: float) -> Any:
        return self._gui.add_uplot(
            history.columns(0.0),
            ({'label': 'time'}, *(
                {'label': name, 'stroke': colour, 'width': 1.6}
                for name, colour in zip(names, LINES, strict=False))),
            scales={'x': {'time': False, 'range': (-span, 0.0)}}, height=PLOT_HEIGHT,
            legend={'show': True, 'live': False})

    def _add_picture(self) -> None:
        gui = self._gui
        with gui.add_folder('Picture', expand_by_default=False):
            self.map = gui.add_checkbox('dexterity, singularities', True)
            self.trace = gui.add_checkbox('trace of the handle', True)
            self.cones = gui.add_checkbox('protection level', True)
            self.covariance = gui.add_checkbox('covariance (fkm computes it then)', False)
            self._times = gui.add_dropdown('cones, times', MAGNIFICATIONS,
                                           initial_value=MAGNIFICATIONS[1])
            gui.add_html(
                '<div style="font-size:.8em;opacity:.75;padding:0 .8em">Orange: protection level. '
                'Blue: 3 sigma of the covariance. Both so many times as wide as they are. Map: '
                'dexterity of three sensors at the present self-rotation, red where it vanishes; '
                'dark dots: parallel singularities.</div>')

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
        self._joint = gui.add_dropdown('encoder', ALL_JOINT_NAMES[:4],
                                       initial_value=ALL_JOINT_NAMES[1])
        self._offset = gui.add_number('offset, deg', OFFSET, min=-180.0, max=180.0, step=0.1)
        gui.add_button_group('fault', SWITCHED).on_click(
            lambda event: self._add_fault(str(event.target.value)))
        gui.add_button('no fault').on_click(lambda _: self._fail(''))
        self._faults_html = gui.add_html('')
        self._faults = ''

    def _add_fault(self, kind: str) -> None:
        """Ask for one more fault, beside those that there are."""
        text = f'{kind}:{self._joint.value}'
        if kind == 'offset':
            text += f'={self._offset.value:g}'
        # Another offset of the same joint is in place of that before, not on top of it.
        present = [each for each in self._faults.split(', ')
                   if each and each.partition('=')[0] != text.partition('=')[0]]
        self._fail(', '.join([*present, text]))

    @property
    def magnification(self) -> float:
        """How many times as wide as they are the error cones are drawn."""
        return float(self._times.value)

    def show_banner(self, banner: Banner) -> None:
        """Show the state."""
        self._banner.show(banner)

    def refresh(self) -> None:
        """Let the page know that this program is alive; call it every second."""
        self._banner.refresh()

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

    def show_simulation(self, simulated: bool, sensors: int) -> None:
        """Show the knobs of a simulated source, and of no other."""
        self._simulation.visible = simulated
        self._joint.options = ALL_JOINT_NAMES[:sensors]

    def show_faults(self, faults: str) -> None:
        """Show the faults that are present."""
        self._faults = faults
        self._faults_html.content = (
            '<div style="padding:0 .8em;font-size:.86em">faults: '
            f'{escape(faults) or "none"}</div>')

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
