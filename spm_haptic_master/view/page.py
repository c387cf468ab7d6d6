# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the page shows beside the picture: banners, figures, plots, and a cover without news.

Banners and cover belong to the page, not to its panel, which leaves the page when a user collapses
it. viser has no element outside the panel; its message for a script brings `page/page.js`, which
shows what it is given and sends nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
import json
from pathlib import Path
from typing import Any

from spm_haptic_master.description.workspace_map import colour_bar
from spm_haptic_master.view.liveness import Banner
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
# What a script begins with that has news.
NEWS = 'window.spm.show('


class RunJavascriptMessage(ViserScript):
    """A script; viser, which knows it by its name, keeps the latest of each kind for new pages."""

    def redundancy_key(self) -> str:
        """Return the key under which a message replaces the one before."""
        return f'spm-{self.source.startswith(NEWS)}'


class Page:
    """
    The banners, one below the other, and the figures of each device.

    `views` are the position of the camera and what it looks at, in the scene, by name.
    """

    def __init__(self, server: ViserServer, views: Mapping[str, Any]) -> None:
        self._server = server
        # Banners, and contents as of `readout.content`, by the names of the devices.
        self.shown: dict[str, Banner] = {}
        self.content: dict[str, Mapping[str, Any]] = {}
        self.views = views
        setup = {
            'css': (FOLDER / 'page.css').read_text(), 'timeout': round(1e3 * NEWS_TIMEOUT),
            'lost': 'no news from view: the picture is old', 'dome': colour_bar(),
            'views': views, 'legend': LEGEND}
        self._run((FOLDER / 'page.js').read_text().replace('SETUP', json.dumps(setup)))

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
        self._server._websock_server.queue_message(RunJavascriptMessage(script))


def hosts(name: str) -> tuple[str, str]:
    """Return the elements of the panel for figures and for plots of a device, as HTML."""
    figures, plots = (f'<div id="spm-{name}{part}" class="spm-device"></div>'
                      for part in ('', '-lower'))
    return figures, plots
