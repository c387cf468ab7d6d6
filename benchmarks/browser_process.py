# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A Chromium without a window, and one page in it, driven by its own devtools protocol."""

from __future__ import annotations

import base64
from collections import deque
from collections.abc import Sequence
from itertools import count
import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
import time
from typing import Any
from urllib.request import urlopen

# Names of the browser.
NAMES = ('chromium', 'chromium-browser', 'google-chrome')
# Options: no window, no sandbox (tests may run as root), and 3D drawn by the CPU where there is no
# GPU. The rest of the page is then drawn without 3D, as in any browser without a GPU.
OPTIONS = (
    '--headless=new',
    '--no-sandbox',
    '--mute-audio',
    '--enable-unsafe-swiftshader',
    '--disable-dev-shm-usage',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-extensions',
    '--hide-scrollbars',
    '--remote-debugging-port=0',
)
# Nobody looks at it. Without the right to do so (of root) it does not raise its own priority above
# that of all others.
LOW_PRIORITY = (
    *(('setpriv', '--bounding-set', '-sys_nice') if os.geteuid() == 0 else ()),
    'nice',
    '-n',
    '10',
)
# Longest time that the browser may need to start, and to answer (s).
PATIENCE = 120.0


def browser() -> str | None:
    """Return the path of the browser, None where none is installed."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


def command(path: str, profile: Path, url: str, size: Sequence[int]) -> list[str]:
    """Return the command line of a browser with a profile folder, a page, a size in pixels."""
    width, height = size
    return [
        *LOW_PRIORITY,
        path,
        *OPTIONS,
        f'--window-size={width},{height}',
        f'--user-data-dir={profile}',
        url,
    ]


def end(process: subprocess.Popen[bytes]) -> None:
    """End a browser that leads a process group, with all its processes."""
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


class Browser:
    """One page of a size, pixels; the browser's profile has a folder of its own."""

    def __init__(self, folder: Path, width: int = 720, height: int = 480) -> None:
        from websockets.sync.client import connect

        self._process = subprocess.Popen(
            command(str(browser()), folder, 'about:blank', (width, height)),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        address = folder / 'DevToolsActivePort'
        deadline = time.monotonic() + PATIENCE
        while not address.exists() or not address.read_text().count('\n'):
            assert time.monotonic() < deadline, 'the browser does not start'
            time.sleep(0.05)
        port = address.read_text().split()[0]
        with urlopen(f'http://127.0.0.1:{port}/json/list', timeout=PATIENCE) as answer:
            pages = json.load(answer)
        page = next(each for each in pages if each['type'] == 'page')
        self._socket = connect(page['webSocketDebuggerUrl'], max_size=None)
        self._numbers = count(1)
        # Events that came while an answer was waited for.
        self._events: deque[dict[str, Any]] = deque()
        self.call('Page.enable')
        # As of a page that a user has just opened: viser connects only one that has the focus.
        self.call('Emulation.setFocusEmulationEnabled', enabled=True)
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({'id': number, 'method': method, 'params': parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE))
            if answer.get('id') == number:
                assert 'error' not in answer, answer
                return answer['result']
            if 'method' in answer:
                self._events.append(answer)

    def frame(self) -> tuple[float, bytes]:
        """
        Return the next frame of a screencast: when it was shown (s, Unix epoch), and a JPEG.

        `Page.startScreencast` begins it.
        """
        while True:
            event = (
                self._events.popleft()
                if self._events
                else json.loads(self._socket.recv(timeout=PATIENCE))
            )
            if event.get('method') == 'Page.screencastFrame':
                frame = event['params']
                self.call('Page.screencastFrameAck', sessionId=frame['sessionId'])
                return frame['metadata']['timestamp'], base64.b64decode(frame['data'])

    def visit(self, url: str) -> None:
        """Load a page."""
        self.call('Page.navigate', url=url)

    def evaluate(self, script: str) -> Any:
        """Return the value of a JavaScript expression."""
        result = self.call(
            'Runtime.evaluate', expression=script, returnByValue=True, awaitPromise=True
        )
        assert 'exceptionDetails' not in result, result
        return result['result'].get('value')

    def text(self) -> str:
        """Return the text of the page."""
        return self.evaluate('document.body ? document.body.innerText : ""') or ''

    def banner(self) -> str:
        """Return the text of the first banner; empty if there is none."""
        return self.evaluate(
            '(document.querySelector(".spm-banner") || {innerText: ""}).innerText'
        )

    def box(self, script: str) -> tuple[float, float, float, float]:
        """Return x, y, width and height of the element that an expression gives, pixels."""
        return tuple(
            self.evaluate(
                f'(async () => {{const element = {script};'
                'element.scrollIntoView({block: "center", behavior: "instant"});'
                'await new Promise(done => setTimeout(done, 300));'
                'const b = element.getBoundingClientRect();'
                'return [b.x, b.y, b.width, b.height]})()'
            )
        )

    def click(self, script: str) -> None:
        """Click on the element that an expression gives."""
        x, y, width, height = self.box(script)
        x, y = x + 0.5 * width, y + 0.5 * height
        for kind in ('mouseMoved', 'mousePressed', 'mouseReleased'):
            self.call(
                'Input.dispatchMouseEvent',
                type=kind,
                x=x,
                y=y,
                button='left',
                buttons=1,
                clickCount=1,
            )

    def screenshot(self, clip: tuple[float, float, float, float] | None = None) -> bytes:
        """Return a picture of the page, or a part of it (x, y, width, height), PNG."""
        parameters = (
            {}
            if clip is None
            else {'clip': dict(zip(('x', 'y', 'width', 'height'), clip, strict=True), scale=1)}
        )
        return base64.b64decode(
            self.call('Page.captureScreenshot', format='png', **parameters)['data']
        )

    def close(self) -> None:
        """End the browser."""
        self._socket.close()
        end(self._process)
