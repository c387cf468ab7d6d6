# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Measures when the first picture is there after `make run`, in a real Chromium that is open.

In turn with it, the page of a viser server with nothing but a ball: what that takes is the
browser's own. Each page has a new browser.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
import io
import os
from pathlib import Path
import re
from statistics import median
import sys
import tempfile
import threading
import time

from benchmarks.browser_process import Browser
from benchmarks.pipeline.child_process import (
    executable,
    private_environment,
    Program,
    wait_until,
)
from benchmarks.view_load import scheduling_of_make_run
from geometry_msgs.msg import QuaternionStamped
from PIL import Image
import rclpy
from rclpy.executors import SingleThreadedExecutor
from spm_haptic_master.ros.qos import SAMPLES

# Page without a device.
BALL = """import time, viser
server = viser.ViserServer(port=18480, verbose=False)
ball = server.scene.add_icosphere('/ball', 1.0, color=(200, 40, 40))
server.gui.add_html('<div class="spm-banner">healthy</div>')
print('view: http://127.0.0.1:%d' % server.get_port(), flush=True)
for number in range(10 ** 6):  # it moves, as the device does
    ball.position = (0.01 * (number % 20), 0.0, 0.0)
    time.sleep(0.05)
"""
# Notes when the banner is first healthy (s, Unix epoch).
WATCH = """setInterval(() => {
  const banner = document.querySelector('.spm-banner');
  if (!window.healthyAt && banner && banner.innerText === 'healthy')
    window.healthyAt = (performance.timeOrigin + performance.now()) / 1000;
}, 20)"""
# Frames of the page that the browser hands out, small: they cost time, too.
FRAMES = {'format': 'jpeg', 'quality': 40, 'maxWidth': 640, 'maxHeight': 360, 'everyNthFrame': 1}
# Part of the page with the picture: left, upper, right, lower (unit 1 of width and height).
PART = 0.05, 0.35, 0.6, 0.9
# Colours that a picture with something in it has at least: without it there is the background,
# and the edges of what lies over it.
COLOURS = 200
# Longest time for a program to start and a picture to come (s).
PATIENCE = 120.0
# Longest time from the first orientation to the first picture (s).
LIMIT = 3.0


def picture_time(page: Browser, view: Program) -> float:
    """Load the page of a program as soon as it prints the address; return when it is shown (s)."""
    page.call('Page.addScriptToEvaluateOnNewDocument', source=WATCH)
    line = re.compile('^view: (.+)\n', re.MULTILINE)
    if not wait_until(lambda: line.search(view.stdout), PATIENCE):
        raise TimeoutError(f'no page: {view.stderr}')
    url = line.search(view.stdout).group(1)
    page.visit(url)
    if not wait_until(lambda: page.evaluate('location.href').startswith(url), PATIENCE):
        raise TimeoutError(f'{url}: not loaded')
    if not wait_until(lambda: page.evaluate('window.healthyAt') is not None, PATIENCE):
        raise TimeoutError(f'{url}: not healthy: {page.text()}')
    healthy = page.evaluate('window.healthyAt')
    # Not before: to hand out frames costs the browser time.
    page.call('Page.startScreencast', **FRAMES)
    end = time.monotonic() + PATIENCE
    try:
        while time.monotonic() < end:
            at, jpeg = page.frame()
            # A frame from before the banner is healthy is not the picture.
            if at >= healthy and colours(jpeg) > COLOURS:
                return at
    finally:
        page.call('Page.stopScreencast')
    raise TimeoutError(f'no picture: {page.text()}')


def colours(jpeg: bytes) -> int:
    """Return the number of colours where the picture is in a frame of the page."""
    frame = Image.open(io.BytesIO(jpeg)).convert('RGB')
    width, height = frame.size
    left, upper, right, lower = PART
    part = frame.crop(
        (round(left * width), round(upper * height), round(right * width), round(lower * height))
    )
    return len(part.getcolors(1 << 24) or ())


class FirstOrientation:
    """Waits for the first message on `orientation`, in a thread of its own."""

    def __init__(self) -> None:
        self.at = float('nan')
        self._node = rclpy.create_node('first_orientation')
        self._node.create_subscription(QuaternionStamped, 'orientation', self._take, SAMPLES)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _take(self, _: QuaternionStamped) -> None:
        if not self._stop.is_set():
            self.at = time.time()
            self._stop.set()

    def _run(self) -> None:
        while not self._stop.is_set():
            self._executor.spin_once(0.05)

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()
        self._node.destroy_node()


@contextmanager
def browser() -> Iterator[Browser]:
    """Give a browser that has drawn nothing before, nor has anything left to draw."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        page = Browser(Path(folder), 1280, 720)
        try:
            yield page
        finally:
            page.close()


def device(page: Browser) -> tuple[float, float]:
    """Return the times from start to orientation, and from orientation to picture (s)."""
    with ExitStack() as stack:
        first = FirstOrientation()
        stack.callback(first.close)
        begun = time.time()
        stack.enter_context(
            Program(executable('master', parameters={'source': 'sim', **scheduling_of_make_run()}))
        )
        view = stack.enter_context(Program(executable('view', parameters={'view.port': 18380})))
        drawn = picture_time(page, view)
        return first.at - begun, drawn - first.at


def ball(page: Browser) -> float:
    """Return the time from start to picture of a page without a device (s)."""
    begun = time.time()
    with Program([sys.executable, '-c', BALL]) as view:
        return picture_time(page, view) - begun


def main(args: Sequence[str] | None = None) -> int:
    """Measure in turn, and print each figure and the medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rounds', type=int, default=5)
    options = parser.parse_args(args)
    os.environ.update(private_environment())
    rclpy.init()
    orientations, pictures, balls = [], [], []
    for number in range(1, options.rounds + 1):
        with browser() as page:
            balls.append(ball(page))
        with browser() as page:
            orientation, picture = device(page)
        orientations.append(orientation)
        pictures.append(picture)
        print(
            f'round {number} of {options.rounds}: first orientation {orientation:.2f} s after '
            f'the start, first picture {picture:.2f} s after that; a ball {balls[-1]:.2f} s '
            'after the start',
            flush=True,
        )
    late = sum(picture > LIMIT for picture in pictures)
    whole = median(o + p for o, p in zip(orientations, pictures, strict=True))
    print(
        f'first picture {median(pictures):.2f} s after the first orientation (median; '
        f'{min(pictures):.2f} .. {max(pictures):.2f}), later than {LIMIT:g} s: {late}; '
        f'from the start {whole / median(balls):.2f} of what a ball takes'
    )
    rclpy.shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
