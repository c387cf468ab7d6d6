# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The page beside the picture: banners, the content of each device, and the views.

Banners and cover belong to the page, not to its panel, which leaves the page when a user collapses
it. viser has no elements outside the panel: scripts in `page/` draw them, and send nothing.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import asdict
import json
from pathlib import Path
import time
from typing import Any

from spm_haptic_master.description.workspace_map import colour_bar
from spm_haptic_master.view import status
from spm_haptic_master.view.content import content
from spm_haptic_master.view.legend import INTRODUCTION, legend
from spm_haptic_master.view.scene import ARM_DISTANCE
from spm_haptic_master.view.seen import Seen
from spm_haptic_master.view.status_entries import StatusEntries
from viser import GuiApi, GuiFolderHandle, ViserServer
from viser._messages import RunJavascriptMessage as ViserScript

# The page's scripts, in the order in which they are read, and its style.
FOLDER = Path(__file__).with_name('page')
SCRIPTS = (
    'elements.js',
    'lateness.js',
    'camera.js',
    'past.js',
    'names.js',
    'plots.js',
    'panel.js',
    'page.js',
)
# Begin of a script with news.
NEWS = 'window.spm.show('
# How late news may be, and how old the latest ones, before the page covers itself (s): a pose that
# is 0.5 s late is covered within a second.
LATEST = 0.5
OLDEST = 1.0
# Camera's position relative to its target in each view of one device, and the target (units of the
# scene); share of that distance by which it backs off for each further device (unit 1).
CAMERAS = {'front': (1.15, -3.15, 1.75), 'side': (3.9, -0.01, 0.4), 'top': (0.0, -0.01, 4.1)}
LOOK_AT = (0.0, 0.0, 0.98)
BACK_OFF = 0.75
# The view of a story, relative to the device: the flags above the dome.
GHOST_CAMERA = (-0.3, -2.4, 2.5)
GHOST_LOOK_AT = (0.0, 0.0, 1.35)
# What the page shows before the first device.
NO_DEVICE = status.Banner(
    light=status.Light.GREY,
    text='no device found. Start it: make run',
    alive=False,
    event='no device found',
)
# Places in the panel: the page's introduction, then the devices.
INTRODUCTION_ORDER = 0.0
DEVICES_ORDER = 10.0


class RunJavascriptMessage(ViserScript):
    """A script, by the name that viser knows; one of each kind is kept for new pages."""

    def redundancy_key(self) -> str:
        """Return the key under which a message replaces the one before."""
        return f'spm-{self.source.startswith(NEWS)}'


class Panel:
    """
    The part of the panel for a device, in a folder if it has a name; scripts fill it.

    Parameters
    ----------
    gui : GuiApi
        Panel of viser's page.
    title : str
        Name of the device; empty if there is only one, without a namespace.

    Attributes
    ----------
    folder : context manager
        What is added to the panel in it is in the device's part.
    knobs_order : float
        Place of the knobs in the part: between the figures and the lower plots.

    """

    def __init__(self, gui: GuiApi, title: str) -> None:
        self._folder: GuiFolderHandle | None = gui.add_folder(title) if title else None
        self.folder = self._folder or nullcontext()
        # In a folder of its own, or beside nothing else.
        first = 1.0
        self.knobs_order = first + 1.0
        with self.folder:
            self._parts = [
                gui.add_html(f'<div id="spm-{title}{part}" class="spm-device"></div>', order=order)
                for part, order in (('', first), ('-lower', first + 2.0))
            ]

    def stand(self, rank: int) -> None:
        """Let the folder stand at a place, from 0."""
        if self._folder is not None:
            self._folder.order = DEVICES_ORDER + rank

    def remove(self) -> None:
        """Take the part off the panel."""
        if self._folder is not None:
            self._folder.remove()
            return
        for part in self._parts:
            part.remove()


class Page:
    """
    The banners, one below the other, the content of each device, and the views of all.

    Parameters
    ----------
    server : ViserServer
        The server of the page.

    Attributes
    ----------
    shown : dict
        Banner of each device by its name; the name may be empty.
    content : dict
        What the page shows below the banner, by the name of the device, ready for JSON.
    views : dict
        Position and target of the camera (units of the scene) by the name of the view.

    """

    def __init__(self, server: ViserServer) -> None:
        self.server = server
        # By which a page notices that another process serves it.
        self._session = time.monotonic()
        # Banners and contents by the names of the devices; the only one need not have a name.
        self.shown: dict[str, status.Banner] = {}
        self.content: dict[str, dict[str, Any]] = {}
        server.gui.add_html('<div id="spm-introduction"></div>', order=INTRODUCTION_ORDER)
        self.aim(1)
        setup = {
            'css': (FOLDER / 'page.css').read_text(),
            'latest': LATEST,
            'oldest': OLDEST,
            'introduction': INTRODUCTION,
            'dome': colour_bar(),
            'views': self.views,
            'legend': [asdict(entry) for entry in legend()],
        }
        self._run(script(setup))
        self.refresh()

    def aim(self, arms: int) -> None:
        """
        Have each view, and the first picture, show a number of devices in a row.

        Parameters
        ----------
        arms : int
            Number of devices in the row.

        """
        self.views = views(arms)
        camera = self.server.initial_camera
        camera.position, camera.look_at = self.views['front']

    def show(self, name: str, banner: status.Banner) -> None:
        """
        Show the state of a device.

        A change is sent at once.

        Parameters
        ----------
        name : str
            Name of the device; empty without a namespace.
        banner : Banner
            Its state.

        """
        if self.shown.get(name) != banner:
            self.shown[name] = banner
            self.refresh()

    def show_content(
        self,
        name: str,
        seen: Seen,
        entries: StatusEntries,
        rank: int,
    ) -> None:
        """
        Show the figures of a device at a place of the row with the next news.

        Parameters
        ----------
        name : str
            Name of the device; empty without a namespace.
        seen : Seen
            What is known of it.
        entries : StatusEntries
            Its entries on /diagnostics.
        rank : int
            Its place in the row, from 0: the view of the ghost is relative to it.

        """
        self.content[name] = {**content(seen, entries), 'ghostView': ghost_view(rank)}

    def drop(self, name: str) -> None:
        """
        Show a device no longer.

        Parameters
        ----------
        name : str
            Name of the device; one that is not shown is ignored.

        """
        self.shown.pop(name, None)
        self.content.pop(name, None)
        self.refresh()

    def refresh(self) -> None:
        """
        Send all of it, with this program's clock (s), by which the page knows how late it is.

        Call it every quarter of a second.
        """
        # JSON of Python, with NaN and Infinity, is valid in a script.
        self._run(f'{NEWS}{json.dumps(self.news())});')

    def news(self) -> dict[str, Any]:
        """
        Return all that the page shows now.

        Returns
        -------
        dict
            The clock of this program (s, monotonic), the session, banner and content of each
            device in the order of the row, and the views.

        """
        shown = self.shown or {'': NO_DEVICE}
        return {
            'clock': time.monotonic(),
            'session': self._session,
            'hasDevice': bool(self.shown),
            'devices': [self._device(name, shown[name]) for name in sorted(shown, key=place_of)],
            'views': self.views,
        }

    def _device(
        self,
        name: str,
        banner: status.Banner,
    ) -> dict[str, Any]:
        """Return the news of one device."""
        return {
            'name': name,
            'content': self.content.get(name),
            'banner': {
                'text': f'{name}: {banner.text}' if name else banner.text,
                'light': banner.light.name,
                'colour': banner.light.colour,
                'sign': banner.light.sign,
                'alive': banner.alive,
            },
        }

    def _run(self, script: str) -> None:
        """Run a script in every browser, and in those that open the page later."""
        # viser sends its own script, plotly, in this way.
        self.server._websock_server.queue_message(RunJavascriptMessage(script))


def place_of(name: str) -> tuple[bool, bool, str]:
    """
    Return the key by which devices stand in a row: left first, right last, else by name.

    Parameters
    ----------
    name : str
        Name of a device, or its namespace; the part after its last slash may be left or right.

    Returns
    -------
    tuple of bool, bool and str
        A key for `sorted`.

    """
    last = name.rpartition('/')[2]
    return last == 'right', last != 'left', name


def script(setup: dict[str, Any]) -> str:
    """
    Return the page's script: all of its files in one function, called with the setup once.

    Parameters
    ----------
    setup : dict
        Style, limits of lateness (s), introduction, colours of the dome, views and legend, for
        JSON.

    Returns
    -------
    str
        JavaScript that defines `window.spm` unless the page already has it.

    """
    files = '\n'.join((FOLDER / name).read_text() for name in SCRIPTS)
    return f'window.spm ??= ((setup) => {{\n{files}\n}})({json.dumps(setup)});'


def views(arms: int) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    """
    Return the camera's position and target for each view of a number of devices in a row.

    Parameters
    ----------
    arms : int
        Number of devices; the camera looks at the middle of their row, and backs off for each
        further one.

    Returns
    -------
    dict
        Position and target, x, y, z each (units of the scene), by the name of the view.

    """
    x, y, z = LOOK_AT
    x += 0.5 * ARM_DISTANCE * (arms - 1)
    back = 1.0 + BACK_OFF * (arms - 1)
    return {
        name: ((x + back * dx, y + back * dy, z + back * dz), (x, y, z))
        for name, (dx, dy, dz) in CAMERAS.items()
    }


def ghost_view(rank: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """
    Return the camera's position and target for the ghost of the device at a place.

    Parameters
    ----------
    rank : int
        Place of the device in the row, from 0.

    Returns
    -------
    tuple of two tuples of 3 float
        Position and target, x, y, z (units of the scene).

    """
    (dx, dy, dz), (x, y, z) = GHOST_CAMERA, GHOST_LOOK_AT
    x += ARM_DISTANCE * rank
    return (x + dx, y + dy, z + dz), (x, y, z)
