# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The banners of all devices, and the cover of a page that gets no news from this program.

They belong to the page, not to its panel, which leaves the page when a user collapses it. viser
has no element outside the panel; its message for a script makes them.
"""

from __future__ import annotations

import json

from spm_haptic_master.view.liveness import Banner
from viser import ViserServer
from viser._messages import RunJavascriptMessage as ViserScript

# Time after which a page that gets no news from this program covers itself (s).
NEWS_TIMEOUT = 2.5
# The page's own notices, such as that of a browser without a GPU, are below the banners; what a
# user opens over the page (a plot) is below banners and cover.
STYLE = """
.spm-banners{position:fixed;top:1em;left:calc(50vw - 210px);transform:translateX(-50%);
width:max-content;max-width:calc(100vw - 440px);z-index:99999;display:flex;flex-direction:column;
align-items:center;gap:.5em}
@media (max-width:576px){.spm-banners{left:50vw;max-width:calc(100vw - 2em)}}
.spm-banner{color:#fff;padding:.6em .9em;border-radius:.4em;font:600 1.15em sans-serif;
overflow-wrap:anywhere;box-shadow:0 1px 4px rgba(0,0,0,.3)}
.mantine-Notifications-root{z-index:1!important}
.spm-lost{position:fixed;inset:0;z-index:100000;background:rgba(70,70,70,.88);color:#fff;
font:600 1.6em sans-serif;display:flex;align-items:center;justify-content:center;
visibility:hidden;pointer-events:none}
.spm-table{width:100%;font-size:.86em;border-collapse:collapse;margin:.2em 0}
.spm-table td{padding:.1em .3em;vertical-align:top}
.spm-table td:first-child{white-space:nowrap;opacity:.65}
.spm-bar{background:#d8dce1;border-radius:.3em;height:.6em;margin:.3em 0}
.spm-bar div{height:100%;border-radius:.3em}
"""
# Shows rows of text, colour and alive; the first time it adds the elements. Each call is news.
SCRIPT = """
window.spmShow ??= (() => {
    const add = (parent, name, text) => {
        const element = document.createElement('div');
        element.className = name;
        element.textContent = text;
        parent.append(element);
        return element;
    };
    const style = document.createElement('style');
    style.textContent = %(style)s;
    document.head.append(style);
    const banners = add(document.body, 'spm-banners', '');
    const lost = add(document.body, 'spm-lost', 'no news from view: the picture is old');
    let timer, shown;
    return rows => {
        if (JSON.stringify(rows) != shown) {
            shown = JSON.stringify(rows);
            banners.replaceChildren();
            for (const [text, colour, alive] of rows) {
                const banner = add(banners, 'spm-banner', text);
                banner.style.background = colour;
                banner.dataset.alive = Number(alive);
            }
        }
        clearTimeout(timer);
        lost.style.visibility = 'hidden';
        timer = setTimeout(() => { lost.style.visibility = 'visible'; }, %(timeout)d);
    };
})();
window.spmShow(%(rows)s);
"""


class RunJavascriptMessage(ViserScript):
    """The script, of which viser keeps the latest for a page to come; by its name it is known."""

    def redundancy_key(self) -> str:
        """Return the key under which a message replaces the one before."""
        return 'spm-banners'


class PageBanners:
    """
    The banners, one below the other.

    Parameters
    ----------
    server : ViserServer
        Server of the page.

    """

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        # Banners by the names of their devices.
        self.shown: dict[str, Banner] = {}

    def show(self, name: str, banner: Banner) -> None:
        """Show the state of a device; without a name it is the only one."""
        if self.shown.get(name) != banner:
            self.shown[name] = banner
            self.refresh()

    def remove(self, name: str) -> None:
        """Take a banner from the page."""
        del self.shown[name]
        self.refresh()

    def refresh(self) -> None:
        """Let the page know that this program is alive; call it every second."""
        rows = [(f'{name}: {banner.text}' if name else banner.text, banner.light.value,
                 banner.alive) for name, banner in self.shown.items()]
        # viser's own script, plotly, goes the same way.
        self._server._websock_server.queue_message(RunJavascriptMessage(SCRIPT % {
            'style': json.dumps(STYLE), 'timeout': round(1e3 * NEWS_TIMEOUT),
            'rows': json.dumps(rows)}))
