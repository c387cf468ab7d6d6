# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Take view.png, view_fault.png and view.gif of the running programs, in a real Chromium."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
import io
from pathlib import Path
import sys
import tempfile
import time

from benchmarks.view_load import scheduling_of_make_run
from PIL import Image
from spm_haptic_master.benchmark.child_process import executable, Program, wait_until
from spm_haptic_master.orientation_state import HEALTHY, silent

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'view'))

from browser import Browser  # noqa: E402, I100

HERE = Path(__file__).resolve().parent
# Size of the page and of the animated picture (pixels).
WIDTH, HEIGHT = 1180, 720
ANIMATED_WIDTH = 440
# Frames of the animated picture, the time between two when they are taken and when they are shown
# (s), and its colours.
FRAMES, TAKEN_EVERY, SHOWN_FOR, GIF_COLOURS = 20, 0.35, 0.2, 48
# Colours of a picture: few enough for a small file.
COLOURS = 160
# Time for the trace to be drawn, for a program to start, and for a word to appear (s).
SETTLE, PATIENCE = 8.0, 300.0
# What viser says of a browser without a GPU is no part of the picture.
WITHOUT_NOTICE = 'document.querySelectorAll(".mantine-Notification-root").forEach(e => e.remove())'
FAULT = '[...document.querySelectorAll("button")].find(e => e.innerText.trim() == "dropout")'


def picture(page: Browser) -> Image.Image:
    """Return what the page shows."""
    page.evaluate(WITHOUT_NOTICE)
    return Image.open(io.BytesIO(page.screenshot())).convert('RGB')


def save(image: Image.Image, name: str) -> None:
    """Write a picture beside this file."""
    image.quantize(COLOURS).save(HERE / name, optimize=True)
    print(HERE / name)


def wait(condition: Callable[[], object], what: str) -> None:
    """Wait for a condition."""
    if not wait_until(condition, PATIENCE):
        raise TimeoutError(what)


def main() -> None:
    """Take the pictures."""
    with ExitStack() as stack:
        def start(name: str, **parameters: object) -> Program:
            program = Program(executable(name, parameters=parameters))
            stack.callback(program.stop)
            return program

        start('master', **{'source': 'sim', 'sim.trajectory': 'sweep'}, **scheduling_of_make_run())
        view = start('view', **{'view.port': 18280})
        wait(lambda: '\n' in view.stdout, 'view does not start')
        folder = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        page = Browser(Path(folder), WIDTH, HEIGHT)
        stack.callback(page.close)
        page.visit(view.stdout.splitlines()[0].removeprefix('view: '))
        wait(lambda: page.banner() == HEALTHY.text, 'the page is not healthy')
        time.sleep(SETTLE)
        save(picture(page), 'view.png')
        frames = []
        for _ in range(FRAMES):
            frame = picture(page).crop((0, 0, WIDTH - 390, HEIGHT))
            height = round(frame.height * ANIMATED_WIDTH / frame.width)
            frames.append(frame.resize((ANIMATED_WIDTH, height), Image.Resampling.LANCZOS)
                          .quantize(GIF_COLOURS))
            time.sleep(TAKEN_EVERY)
        frames[0].save(HERE / 'view.gif', save_all=True, append_images=frames[1:],
                       duration=round(1000 * SHOWN_FOR), loop=0, optimize=True)
        print(HERE / 'view.gif')
        page.click(FAULT)
        wait(lambda: page.banner() == silent('no joint samples').text,
             'the fault is not shown')
        time.sleep(3.0)
        save(picture(page), 'view_fault.png')


if __name__ == '__main__':
    main()
