# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Take the pictures of the page, of the running programs in a real Chromium.

Every state at the size of a desktop and of a phone goes to docs/view; view.png and view.gif stand
beside this file. Names of pictures as arguments take these alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing, ExitStack
import io
from math import radians
import os
from pathlib import Path
import signal
import sys
import tempfile
import time

from PIL import Image
import rclpy
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, STEER_TOPIC
from spm_haptic_master.supervision.orientation_state import HEALTHY
from spm_haptic_master.view.stories import NEAR, SINGULAR
from std_msgs.msg import Float64MultiArray, String

HERE = Path(__file__).resolve().parent
# As a script it finds the benchmarks of its checkout.
sys.path.insert(0, str(HERE.parents[1]))

from benchmarks.browser_process import Browser  # noqa: E402, I100
from benchmarks.pipeline.child_process import (  # noqa: E402
    executable,
    private_environment,
    Program,
    wait_until,
)
from benchmarks.view_load import scheduling_of_make_run  # noqa: E402

STATES = HERE.parent / 'view'
# Sizes of the page, and width of the panel on the first (pixels).
SIZES = (1280, 800), (390, 844)
PANEL = 390
ANIMATED_WIDTH = 440
# Frames of the animated picture, the time between two when they are taken and when they are shown
# (s), and its colours.
FRAMES, TAKEN_EVERY, SHOWN_FOR, GIF_COLOURS = 16, 0.35, 0.2, 128
# Colours of a picture: few enough for a small file.
COLOURS = 256
# Time for a page that opens to be drawn, with dome and some seconds of its plots; for a program
# to start, and for a word to appear (s).
SETTLE, PATIENCE = 14.0, 120.0
# Pictures that are taken until one is of the state: a busy computer has moments without it.
ATTEMPTS = 100
# What viser says of a browser without a GPU is no part of the picture.
WITHOUT_NOTICE = 'document.querySelectorAll(".mantine-Notification-root").forEach(e => e.remove())'
# Error of three encoders alone (deg), 0 where the page has none.
ERROR = """(() => { const row = [...document.querySelectorAll(".spm-table tr")].find(
    e => e.cells[0].innerText == "three encoders"); return parseFloat(row?.cells[1].innerText) || 0
    })()"""
# Whether the page has all encoders as healthy, th3A as not checked, and whether it is covered.
CHECKED = '[...document.querySelectorAll(".spm-chip")].every(e => e.title.endsWith("healthy"))'
UNCHECKED = '[...document.querySelectorAll(".spm-chip")][3]?.title.includes("not checked")'
COVERED = 'getComputedStyle(document.querySelector(".spm-lost")).visibility == "visible"'
# The button of the story of the singularity in the introduction, and the time of the story (s).
CROSS = 'document.querySelector(".spm-introduction button")'
STORY_TIME = 15.0
# Notes whether the page is covered from now on: on a busy computer that is a moment.
WATCH_COVER = f"""window.wasCovered = {COVERED};
window.coverWatch ??= setInterval(() => {{ window.wasCovered ||= {COVERED}; }}, 20)"""
# Error of three encoders alone that is seen in a picture (deg).
LOST = 6.0
# Error that is not drawn (deg).
UNSEEN = 1.0
# Pictures of a device with four encoders, and of one with six.
OF_FOUR = 'healthy', 'view.gif', 'singularity', 'view.png', 'unchecked', 'frozen'
OF_SIX = 'unplugged', 'excluded', 'dark', 'stopped'


class Pictures:
    """The page in a browser, and the pictures of its states, each at all sizes."""

    def __init__(self, page: Browser, url: str, names: Sequence[str]) -> None:
        self.page = page
        self._url = url
        self._names = names

    def wants(self, *names: str) -> bool:
        """Return whether any of some pictures is to be taken: all are, if none is named."""
        return not self._names or not set(names).isdisjoint(self._names)

    def open(self, width: int, height: int, query: str = '') -> None:
        """Open the page at a size (pixels), as a user does: nobody clicks before its picture."""
        say(f'the page at {width}x{height}')
        self.page.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.page.visit(f'{self._url}/{query}')
        wait(self.page.banner, 'the page does not open')

    def take(self) -> Image.Image:
        """Return what the page shows."""
        self.page.evaluate(WITHOUT_NOTICE)
        return Image.open(io.BytesIO(self.page.screenshot())).convert('RGB')

    def is_covered(self) -> bool:
        """Return whether the page says that its picture is late."""
        return bool(self.page.evaluate(COVERED))

    def save(
        self,
        name: str,
        condition: Callable[[], object] = lambda: True,
        query: str = '',
        prepare: Callable[[], None] = lambda: None,
    ) -> None:
        """Write the pictures of a state, in all sizes, prepared, while a condition holds."""
        if not self.wants(name):
            return
        for width, height in SIZES:
            self.open(width, height, query)
            time.sleep(SETTLE)
            self._save_one(STATES / f'{name}_{width}.png', condition, prepare)

    def save_covered(self, name: str, view: Program) -> None:
        """Write the pictures of a page whose program stands still."""
        if not self.wants(name):
            return
        for width, height in SIZES:
            self.open(width, height)
            time.sleep(SETTLE)
            os.kill(view.pid, signal.SIGSTOP)
            try:
                time.sleep(3.0)
                wait(self.is_covered, 'the page is not covered')
                save(self.take(), STATES / f'{name}_{width}.png')
            finally:
                os.kill(view.pid, signal.SIGCONT)

    def _save_one(
        self, path: Path, condition: Callable[[], object], prepare: Callable[[], None]
    ) -> None:
        """Write one picture; the condition holds before it is taken and afterwards."""
        for attempt in range(ATTEMPTS):
            if attempt:
                say(f'{path.name}: attempt {attempt + 1}, as the state had gone meanwhile')
            prepare()
            wait(lambda: not self.is_covered(), path.name)
            self.page.evaluate(WATCH_COVER)
            held = condition()
            image = self.take()
            if held and condition() and not self.page.evaluate('window.wasCovered'):
                save(image, path)
                return
            time.sleep(1.0)
        raise TimeoutError(path.name)


def save(image: Image.Image, path: Path) -> None:
    """Write a picture."""
    image.quantize(COLOURS, kmeans=2).save(path, optimize=True)
    say(f'{path.name}: {path.stat().st_size} bytes')


def say(words: str) -> None:
    """Print how far it is."""
    print(words, flush=True)


def wait(condition: Callable[[], object], what: str) -> None:
    """Wait for a condition."""
    if not wait_until(condition, PATIENCE):
        raise TimeoutError(what)


class Device:
    """A simulated device that is led and fails by its topics."""

    def __init__(self, page: Browser, **parameters: object) -> None:
        self._page = page
        say(f'a device with {parameters.get("sensors", 4)} encoders starts')
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

    def has_words(self, words: str) -> bool:
        """Return whether the banner begins with some words."""
        return self._page.banner().startswith(words)

    def is_healthy(self) -> bool:
        """Return whether the page says that all is well."""
        return self._page.banner() == HEALTHY.text

    def shows(self, words: str) -> None:
        """Wait until the banner begins with some words."""
        wait(lambda: self.has_words(words), f'the page is not {words}')

    def close(self) -> None:
        """End it."""
        self._program.stop()
        self._node.destroy_node()


def animate(pictures: Pictures) -> None:
    """Write the animated picture of what the device does, all of its frames in one palette."""
    frames = []
    for _ in range(FRAMES):
        width, height = SIZES[0]
        frame = pictures.take().crop((0, 0, width - PANEL, height))
        height = round(frame.height * ANIMATED_WIDTH / frame.width)
        frames.append(frame.resize((ANIMATED_WIDTH, height), Image.Resampling.LANCZOS))
        time.sleep(TAKEN_EVERY)
    all_frames = Image.new('RGB', (ANIMATED_WIDTH, len(frames) * frames[0].height))
    for index, frame in enumerate(frames):
        all_frames.paste(frame, (0, index * frame.height))
    palette = all_frames.quantize(GIF_COLOURS, kmeans=2)
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    indexed[0].save(
        HERE / 'view.gif',
        save_all=True,
        append_images=indexed[1:],
        duration=round(1000 * SHOWN_FOR),
        loop=0,
        optimize=True,
    )
    say(f'view.gif: {(HERE / "view.gif").stat().st_size} bytes')


def lose(device: Device, pictures: Pictures) -> None:
    """Lead the device across the singularity until three encoders alone come out wrong."""
    while not pictures.page.evaluate(ERROR) > LOST:
        for phi in (SINGULAR - NEAR, SINGULAR + NEAR):
            device.steer(0.0, 0.0, phi)
            time.sleep(6.0)


def tell_story(pictures: Pictures, device: Device) -> None:
    """Write view.png: the story of the singularity, where three encoders have lost the handle."""
    pictures.open(*SIZES[0])
    time.sleep(SETTLE)
    while True:
        pictures.page.click(CROSS)
        if wait_until(lambda: pictures.page.evaluate(ERROR) > LOST, STORY_TIME):
            time.sleep(1.0)
            image = pictures.take()
            still_lost = pictures.page.evaluate(ERROR) > LOST
            if still_lost and device.is_healthy() and not pictures.is_covered():
                save(image, HERE / 'view.png')
                return


def with_four(pictures: Pictures) -> None:
    """Take the pictures of a device with four encoders."""
    with closing(Device(pictures.page)) as device:
        pictures.save(
            'healthy',
            lambda: (
                device.is_healthy()
                and pictures.page.evaluate(CHECKED)
                and pictures.page.evaluate(ERROR) < UNSEEN
            ),
        )
        if pictures.wants('view.gif'):
            pictures.open(*SIZES[0])
            time.sleep(SETTLE)
            wait(device.is_healthy, 'the device is not healthy')
            animate(pictures)
        pictures.save(
            'singularity',
            lambda: device.is_healthy() and pictures.page.evaluate(ERROR) > LOST,
            prepare=lambda: lose(device, pictures),
        )
        if pictures.wants('view.png'):
            tell_story(pictures, device)
        device.steer(0.0, 0.0, SINGULAR)
        time.sleep(6.0)
        pictures.save('unchecked', lambda: pictures.page.evaluate(UNCHECKED))
        device.fail('stuck:joint_3a')
        device.shows('silent: th3A')
        pictures.save('frozen', lambda: device.has_words('silent: th3A'))


def with_six(pictures: Pictures, view: Program) -> None:
    """Take the pictures of a device with six encoders."""
    with closing(Device(pictures.page, sensors=6)) as device:
        device.fail('dropout:joint_1b')
        device.shows('degraded: th1B')
        pictures.save('unplugged', lambda: device.has_words('degraded: th1B'))
        device.fail('')
        device.shows(HEALTHY.text)
        device.fail('stuck:joint_3a')
        device.shows('degraded: th3A')
        pictures.save('excluded', lambda: device.has_words('degraded: th3A'))
        pictures.save('dark', lambda: device.has_words('degraded: th3A'), '?darkMode')
        pictures.save_covered('stopped', view)


def main(names: Sequence[str]) -> None:
    """Take the pictures with some names, all of them if there are none."""
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
        pictures = Pictures(page, view.stdout.splitlines()[0].removeprefix('view: '), names)
        pictures.open(*SIZES[0])
        pictures.save('no_device', lambda: page.banner().startswith('no device'))
        if pictures.wants(*OF_FOUR):
            with_four(pictures)
        if pictures.wants(*OF_SIX):
            with_six(pictures, view)


if __name__ == '__main__':
    main(sys.argv[1:])
