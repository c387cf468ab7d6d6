# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A Chromium without a window, as the person who looks at `view` has one."""

from __future__ import annotations

from collections.abc import Sequence
import os
from pathlib import Path
import shutil
import signal
import subprocess

# Names of the browser.
NAMES = ('chromium', 'chromium-browser', 'google-chrome')
# Options: no window, no sandbox (tests may run as root), and 3D drawn by the CPU where there is no
# GPU. The rest of the page is then drawn without 3D, as in any browser without a GPU.
OPTIONS = ('--headless=new', '--no-sandbox', '--mute-audio', '--enable-unsafe-swiftshader',
           '--disable-dev-shm-usage', '--no-first-run', '--disable-background-networking',
           '--disable-component-update', '--disable-extensions', '--hide-scrollbars',
           '--remote-debugging-port=0')
# Nobody looks at it. Without the right to do so (of root) it does not raise its own priority above
# that of all others.
LOW_PRIORITY = (*(('setpriv', '--bounding-set', '-sys_nice') if os.geteuid() == 0 else ()),
                'nice', '-n', '10')


def browser() -> str | None:
    """Return the path of the browser, None where none is installed."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


def command(path: str, profile: Path, url: str, size: Sequence[int]) -> list[str]:
    """Return the command line of a browser with a profile folder, a page, a size in pixels."""
    width, height = size
    return [*LOW_PRIORITY, path, *OPTIONS, f'--window-size={width},{height}',
            f'--user-data-dir={profile}', url]


def end(process: subprocess.Popen[bytes]) -> None:
    """End a browser that leads a process group, with all its processes."""
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
