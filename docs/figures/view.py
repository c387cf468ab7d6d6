# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Take the pictures of the page, of the running programs in a real Chromium.

Every state at the size of a desktop and of a phone goes to docs/view; view.png and view.gif stand
beside this file.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing, ExitStack
import io
from math import radians
import os
from pathlib import Path
import shutil
import signal
import tempfile
import time

from benchmarks.browser_process import Browser
from benchmarks.pipeline.child_process import (
    executable,
    private_environment,
    Program,
    wait_until,
)
from benchmarks.view_load import scheduling_of_make_run
from PIL import Image
import rclpy
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, STEER_TOPIC
from spm_haptic_master.supervision.orientation_state import HEALTHY
from spm_haptic_master.view.stories import NEAR, SINGULAR
from std_msgs.msg import Float64MultiArray, String

HERE = Path(__file__).resolve().parent
STATES = HERE.parent / 'view'
# Sizes of the page, and width of the panel on the first (pixels).
SIZES = (1280, 800), (390, 844)
PANEL = 390
ANIMATED_WIDTH = 440
# Frames of the animated picture, the time between two when they are taken and when they are shown
# (s), and its colours.
FRAMES, TAKEN_EVERY, SHOWN_FOR, GIF_COLOURS = 16, 0.35, 0.2, 48
# Colours of a picture: few enough for a small file.
COLOURS = 256
# Time for a page of another size, and for the trace, to be drawn; for a program to start, and for
# a word to appear (s).
RESIZE, SETTLE, PATIENCE = 2.0, 12.0, 120.0
# What viser says of a browser without a GPU is no part of the picture.
WITHOUT_NOTICE = 'document.querySelectorAll(".mantine-Notification-root").forEach(e => e.remove())'
FRONT = '[...document.querySelectorAll("button")].find(e => e.innerText.trim() == "front")'
# Error of three encoders alone (deg), 0 where the page has none.
ERROR = """(() => { const row = [...document.querySelectorAll(".spm-table tr")].find(
    e => e.cells[0].innerText == "three encoders"); return parseFloat(row?.cells[1].innerText) || 0
    })()"""


# Whether the page has th3A as not checked.
UNCHECKED = '[...document.querySelectorAll(".spm-chip")][3]?.title.includes("not checked")'
# Error of three encoders alone that is seen in a picture (deg).
LOST = 6.0


def picture(page: Browser) -> Image.Image:
    """Return what the page shows."""
    page.evaluate(WITHOUT_NOTICE)
    return Image.open(io.BytesIO(page.screenshot())).convert('RGB')


def save(image: Image.Image, path: Path) -> None:
    """Write a picture."""
    image.quantize(COLOURS, kmeans=2).save(path, optimize=True)
    print(path, path.stat().st_size)


def save_state(page: Browser, name: str, condition: Callable[[], object] = lambda: True) -> None:
    """Write the pictures of a state, in both sizes, each when a condition holds."""
    for width, height in SIZES:
        page.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        # As on a page that is opened at that size.
        time.sleep(RESIZE)
        page.evaluate(f'{FRONT}?.click()')
        time.sleep(RESIZE)
        wait(condition, name)
        save(picture(page), STATES / f'{name}_{width}.png')
    width, height = SIZES[0]
    page.call(
        'Emulation.setDeviceMetricsOverride',
        width=width,
        height=height,
        deviceScaleFactor=1,
        mobile=False,
    )
    time.sleep(RESIZE)
    page.evaluate(f'{FRONT}?.click()')


def wait(condition: Callable[[], object], what: str) -> None:
    """Wait for a condition."""
    if not wait_until(condition, PATIENCE):
        raise TimeoutError(what)


class Device:
    """A simulated device that is led and fails by its topics."""

    def __init__(self, page: Browser, **parameters: object) -> None:
        self._page = page
        self._program = Program(
            executable(
                'master',
                parameters={
                    'source': 'sim',
                    'sim.trajectory': 'tour',
                    **scheduling_of_make_run(),
                    **parameters,
                },
            )
        )
        self._node = rclpy.create_node('pictures')
        self._steer = self._node.create_publisher(Float64MultiArray, STEER_TOPIC, 1)
        self._fail = self._node.create_publisher(String, FAULT_TOPIC, 1)
        wait(
            lambda: self._steer.get_subscription_count() and self._fail.get_subscription_count(),
            'the device does not start',
        )
        self.shows(HEALTHY.text)

    def steer(self, *pose: float) -> None:
        """Lead it to tilt, azimuth and phi, deg."""
        self._steer.publish(Float64MultiArray(data=[radians(each) for each in pose]))

    def fail(self, faults: str) -> None:
        """Have its encoders fail."""
        self._fail.publish(String(data=faults))

    def shows(self, words: str) -> None:
        """Wait until the banner begins with some words."""
        wait(lambda: self._page.banner().startswith(words), f'the page is not {words}')

    def close(self) -> None:
        """End it."""
        self._program.stop()
        self._node.destroy_node()


def animate(page: Browser) -> None:
    """Write the animated picture of what the device does."""
    frames = []
    for _ in range(FRAMES):
        width, height = SIZES[0]
        frame = picture(page).crop((0, 0, width - PANEL, height))
        height = round(frame.height * ANIMATED_WIDTH / frame.width)
        frames.append(
            frame.resize((ANIMATED_WIDTH, height), Image.Resampling.LANCZOS).quantize(GIF_COLOURS)
        )
        time.sleep(TAKEN_EVERY)
    frames[0].save(
        HERE / 'view.gif',
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 * SHOWN_FOR),
        loop=0,
        optimize=True,
    )
    print(HERE / 'view.gif')


def main() -> None:
    """Take the pictures."""
    STATES.mkdir(exist_ok=True)
    with ExitStack() as stack:
        # In the domain of the programs that are started here.
        os.environ.update(private_environment())
        rclpy.init()
        stack.callback(rclpy.shutdown)
        view = Program(executable('view', parameters={'view.port': 18280}))
        stack.callback(view.stop)
        wait(lambda: '\n' in view.stdout, 'view does not start')
        folder = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        page = Browser(Path(folder), *SIZES[0])
        stack.callback(page.close)
        url = view.stdout.splitlines()[0].removeprefix('view: ')
        page.visit(url)
        wait(lambda: page.banner().startswith('no device'), 'the page does not open')
        save_state(page, 'no_device')

        with closing(Device(page)) as device:
            time.sleep(SETTLE)
            save_state(page, 'healthy')
            animate(page)
            lost = False
            while not lost:
                for phi in (SINGULAR - NEAR, SINGULAR + NEAR):
                    device.steer(0.0, 0.0, phi)
                    time.sleep(3.0 * RESIZE)
                lost = page.evaluate(ERROR) > LOST
            save_state(page, 'singularity')
            shutil.copy(STATES / f'singularity_{SIZES[0][0]}.png', HERE / 'view.png')
            device.steer(0.0, 0.0, SINGULAR)
            save_state(page, 'unchecked', lambda: page.evaluate(UNCHECKED))
            device.fail('stuck:joint_3a')
            device.shows('silent: joint_3a')
            save_state(page, 'frozen')
        with closing(Device(page, sensors=6)) as device:
            device.fail('dropout:joint_1b')
            device.shows('degraded: joint_1b')
            time.sleep(SETTLE)
            save_state(page, 'unplugged')
            device.fail('')
            device.shows(HEALTHY.text)
            device.fail('stuck:joint_3a')
            device.shows('degraded: joint_3a')
            save_state(page, 'excluded')
            page.visit(f'{url}/?darkMode')
            device.shows('degraded: joint_3a')
            time.sleep(SETTLE)
            save_state(page, 'dark')
            os.kill(view.pid, signal.SIGSTOP)
            try:
                time.sleep(SETTLE)
                save_state(page, 'stopped')
            finally:
                os.kill(view.pid, signal.SIGCONT)


if __name__ == '__main__':
    main()
