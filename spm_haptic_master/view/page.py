# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The page: its server, light and cameras, and what it shows beside the picture.

Banners and cover belong to the page, not to its panel, which leaves the page when a user collapses
it. viser has no element outside the panel; its message for a script brings `page/page.js`, which
shows what it is given and sends nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
import errno
from io import StringIO
import json
import logging
from pathlib import Path
import socket
from typing import Any

from spm_haptic_master.description.workspace_map import colour_bar
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.view.access import guarded
from spm_haptic_master.view.scene import ARM_DISTANCE
from spm_haptic_master.view.status import Banner
from viser import ViserServer
from viser._messages import RunJavascriptMessage as ViserScript

# Time after which a page that gets no news from this program covers itself (s).
NEWS_TIMEOUT = 2.5
# The page's script and style.
FOLDER = Path(__file__).with_name('page')
# What signs and figures mean.
LEGEND = (
    'Encoder: green healthy, amber not checked by the others, red faulty, black no reading.',
    'Parity: how far the encoders disagree, in standard deviations; of noise mostly below 3.',
    "Protection level: bound of the orientation's error, even if an encoder is wrong.",
    'Cone about the handle: the protection level, ten times as wide, at most 20 deg.')
# Begin of a script with news.
NEWS = 'window.spm.show('
# Last port of TCP.
LAST_PORT = 65535
# Light from everywhere (unit 1).
AMBIENT = 0.8
# Camera's position relative to its target in each view of one device, and the target (units of the
# scene); share of that distance by which it backs off for each further device (unit 1).
CAMERAS = {'front': (1.15, -3.1, 1.85), 'side': (3.9, -0.01, 0.4), 'top': (0.0, -0.01, 4.1)}
LOOK_AT, BACK_OFF = (0.0, 0.0, 0.88), 0.75
# Field of view, from top to bottom (rad).
VIEW_ANGLE = 0.75


class RunJavascriptMessage(ViserScript):
    """A script; viser, which knows it by its name, keeps the latest of each kind for new pages."""

    def redundancy_key(self) -> str:
        """Return the key under which a message replaces the one before."""
        return f'spm-{self.source.startswith(NEWS)}'


class Page:
    """The banners, one below the other, the figures of each device, and the views of all."""

    def __init__(self, server: ViserServer) -> None:
        self.server = server
        # Banners, and contents as of `readout.content`, by the names of the devices.
        self.shown: dict[str, Banner] = {}
        self.content: dict[str, Mapping[str, Any]] = {}
        self.aim(1)
        setup = {
            'css': (FOLDER / 'page.css').read_text(), 'timeout': round(1e3 * NEWS_TIMEOUT),
            'lost': 'no news from view: the picture is old', 'dome': colour_bar(),
            'views': self.views, 'legend': LEGEND}
        self._run((FOLDER / 'page.js').read_text().replace('SETUP', json.dumps(setup)))

    def aim(self, arms: int) -> None:
        """Have each view, and the first picture, show a number of devices in a row."""
        self.views = views(arms)
        camera = self.server.initial_camera
        camera.position, camera.look_at = self.views['front']

    def show(self, name: str, banner: Banner) -> None:
        """Show the state of a device; without a name it is the only one."""
        if self.shown.get(name) != banner:
            self.shown[name] = banner
            self.refresh()

    def show_content(self, name: str, content: Mapping[str, Any]) -> None:
        """Show the figures of a device whose banner is shown."""
        self.content[name] = content
        self.refresh()

    def remove(self, name: str) -> None:
        """Take a banner from the page."""
        del self.shown[name]
        self.refresh()

    def refresh(self) -> None:
        """Let the page know that this program is alive; call it every second."""
        devices = [{
            'name': name, 'content': self.content.get(name),
            'banner': (f'{name}: {banner.text}' if name else banner.text, banner.light.value,
                       banner.alive)} for name, banner in self.shown.items()]
        # A text in JSON is one in a script, and so are its NaN and Infinity.
        self._run(f'{NEWS}{json.dumps({"devices": devices, "views": self.views})});')

    def _run(self, script: str) -> None:
        # viser's own script, plotly, goes the same way.
        self.server._websock_server.queue_message(RunJavascriptMessage(script))


def serve(host: str, port: int, names: str = '',
          report: Callable[[str], None] = lambda _: None) -> ViserServer:
    """
    Return the server of the page at a host and a port, or the next free one.

    `names` are further names of the page; `report` is called, in the server's thread, with the
    reason of a refused request. InputError: the address cannot be used.
    """
    # Its log is of connections, to standard error.
    logging.getLogger('websockets').setLevel(logging.CRITICAL)
    # viser would try one port after the other, for ever or beyond the last.
    port = free_port(host, port)
    # It prints its address in a frame; the first line of this program has it.
    with redirect_stdout(StringIO()), guarded(host, names, report):
        server = ViserServer(host=host, port=port, label='haptic master', verbose=False)
    server.gui.configure_theme(control_width='large', show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction('+z')
    # Shadows take most of the time where no GPU draws them.
    server.scene.configure_default_lights(cast_shadow=False)
    # So do reflections of surroundings that are not there.
    server.scene.configure_environment_map(hdri=None)
    server.scene.add_light_ambient('/ambient', intensity=AMBIENT)
    server.initial_camera.fov = VIEW_ANGLE
    return server


def free_port(host: str, first: int) -> int:
    """Return the first free port of an address; InputError: there is none."""
    try:
        addresses = {(family, address) for family, *_, address in socket.getaddrinfo(
            host, None, type=socket.SOCK_STREAM)}
        for port in range(first, LAST_PORT + 1):
            try:
                for family, address in addresses:
                    with socket.socket(family, socket.SOCK_STREAM) as trial:
                        # As viser: a connection that has just ended does not keep the port.
                        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                        # Of IPv6, a scope is behind the port.
                        trial.bind((address[0], port, *address[2:]))
                        trial.listen()
                return port
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
    except OSError as error:
        raise InputError(f"parameter 'view.host' is {host!r}; expected an address of this host "
                         f'({error.strerror})') from error
    raise InputError(f"parameter 'view.port' is {first}; expected a port that is free, or has a "
                     'free one after it')


def views(arms: int) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return the camera's position and target for each view of a number of devices in a row."""
    x, y, z = LOOK_AT
    x += 0.5 * ARM_DISTANCE * (arms - 1)
    back = 1.0 + BACK_OFF * (arms - 1)
    return {name: ((x + back * dx, y + back * dy, z + back * dz), (x, y, z))
            for name, (dx, dy, dz) in CAMERAS.items()}
