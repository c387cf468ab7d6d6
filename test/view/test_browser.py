# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of `view` in a real Chromium: it moves, says what is, and operates the device."""

import base64
import io
from itertools import pairwise
import os
import signal
import time

from benchmarks import browser_process
from disturbance import Disturbance
from harness import SIM
import pytest
from spm_haptic_master.benchmark.child_process import wait_until

pytestmark = [
    pytest.mark.process, pytest.mark.alone,
    pytest.mark.skipif(browser_process.browser() is None, reason='no Chromium is installed')]
PATIENCE = 240.0
# Longest time from the end of the samples to the words on the page (s).
SEEN_WITHIN = 0.5
DESKTOP, PHONE = (1280, 800), (390, 844)
# What collapses the panel: the arrow at its top, and its title.
COLLAPSE = {
    DESKTOP: 'document.querySelector("[aria-label=\'Collapse panel area\']")',
    PHONE: '[...document.querySelectorAll("div")].filter(e => e.innerText?.trim() == '
           '"haptic master").at(-1)'}
# Keeps the banner's latest text and since when it is there, by a clock of the page (ms) that
# stands still while the page gets no time of the processor.
WATCH = """(() => { window.clock = 0; window.seen = [0, '']; let before = Date.now();
setInterval(() => { const now = Date.now(); window.clock += Math.min(now - before, 50);
before = now; const text = document.querySelector('.spm-banner')?.innerText ?? '';
if (text != window.seen[1]) window.seen = [window.clock, text]; }, 10); })()"""
BUTTON = '[...document.querySelectorAll("button")].find(e => e.innerText.trim() == "%s")'
LOG = 'document.querySelector(".spm-log").innerText'
# Value of a row of figures.
ROW = """[...document.querySelectorAll(".spm-table tr")].find(
    e => e.cells[0].innerText == "%s").cells[1].innerText"""
CHIPS = """Object.fromEntries([...document.querySelectorAll(".spm-chip")].map(
    e => [e.innerText, e.title]))"""
# Where every row, chip, knob and plot is in its panel: name, left, top.
PLACES = """(() => { const panel = document.querySelector(".spm-device").getBoundingClientRect();
    return [...document.querySelectorAll(".spm-table tr, .spm-chip, .spm-plot, " +
        ".mantine-Button-root, .mantine-Slider-root")].map(e => {
        const b = e.getBoundingClientRect();
        return [e.className, Math.round(b.left - panel.left), Math.round(b.top - panel.top)]
    }).filter(([, left]) => left > -30)
    })()"""
# Number of rows and chips that reach under the scrollbar or out of the page.
HIDDEN = """[...document.querySelectorAll(".spm-table, .spm-note, .spm-plot, .spm-log")].filter(
    e => e.getBoundingClientRect().right > innerWidth - 8).length"""
CANVAS = 'window.__viserMutable.canvas'
PANEL = """document.querySelector('.mantine-Paper-root[style*="max-height: 60%"]')
    .getBoundingClientRect()"""
# The pixels of a plot, and the number of plots.
PLOT = 'document.querySelector(".spm-plot").toDataURL()'
PLOTS = 'document.querySelectorAll(".spm-plot").length'
# Whether the first chip of the panel is in front on the page, where it is on it.
CHIP = """(() => { const b = document.querySelector(".spm-chip")?.getBoundingClientRect();
    return Boolean(b && b.width && b.left >= 0 && b.right <= innerWidth && b.top < innerHeight)
    })()"""
# The banner's text, where all of it is on the page and nothing is before it.
BANNER = """(() => { const e = document.querySelector(".spm-banner");
    if (!e) return "";
    const b = e.getBoundingClientRect();
    const front = [0.02, 0.5, 0.98].every(part =>
        document.elementFromPoint(b.x + part * b.width, b.y + 0.5 * b.height) == e);
    return front && b.left >= 0 && b.right <= innerWidth && b.top >= 0 && b.width >= 60
        && b.height < 80 ? e.innerText : "" })()"""
# A notice as a browser without a GPU has it, over all of the page.
NOTICE = """(() => { const notice = document.createElement("div");
    notice.style = "width: 100vw; height: 100vh; pointer-events: auto";
    document.querySelector(".mantine-Notifications-root").append(notice); })()"""
# Whether the page is covered, all of it and above all else.
COVERED = """(() => { const e = document.querySelector(".spm-lost");
    if (!e) return false;
    e.style.pointerEvents = "auto";
    const front = [[0, 0], [innerWidth - 1, 0], [innerWidth / 2, innerHeight / 2],
        [0, innerHeight - 1], [innerWidth - 1, innerHeight - 1]].every(
        ([x, y]) => document.elementFromPoint(x, y) == e);
    e.style.pointerEvents = "none";
    return front && getComputedStyle(e).visibility == "visible" })()"""
# Of the plot of the joint angles: the columns of its canvas, 0 .. 1 of its width, where the first
# quantity is.
COLUMNS = """(() => { const title = [...document.querySelectorAll(".spm-title")].find(
    e => e.innerText.startsWith("joint angles")), canvas = title?.nextElementSibling;
    if (!canvas?.width) return [];
    const {width, height} = canvas, found = [];
    const data = canvas.getContext("2d").getImageData(0, 0, width, height).data;
    for (let x = 0; x < width; x++) for (let y = 0; y < height; y++) {
        const k = 4 * (y * width + x);
        if (data[k + 3] > 128 && Math.abs(data[k] - 31) < 40 && Math.abs(data[k + 1] - 119) < 40
            && Math.abs(data[k + 2] - 180) < 40) { found.push(x / width); break; } }
    return found })()"""


@pytest.fixture
def page(start, tmp_path):
    """Start `view` beside what runs; return its page and the program."""
    pages = []

    def begin(size=(720, 480)):
        view = start('view', parameters={'view.port': 18180})
        assert wait_until(lambda: '\n' in view.stdout, PATIENCE), view.stderr
        pages.append(browser_process.Browser(tmp_path / 'profile', *size))
        pages[-1].visit(view.stdout.splitlines()[0].removeprefix('view: '))
        return pages[-1], view

    yield begin
    for each in pages:
        each.close()


@pytest.fixture
def device(start, page):
    """Start a simulated device and `view`; return page, device and `view` once it is healthy."""
    def begin(size=DESKTOP, **parameters):
        running = start('master', parameters={
            **SIM, 'sim.trajectory': 'fixed', 'rate': 200.0, 'max_age': 5.0, **parameters})
        shown, view = page(size)
        until(lambda: shown.evaluate(BANNER) == 'healthy', shown)
        until(lambda: shown.evaluate(f'Boolean({BUTTON % "move by itself"})'), shown)
        return shown, running, view
    return begin


def until(condition, shown):
    assert wait_until(condition, PATIENCE), shown.text()


def picture(page):
    """Return the left part of the page, where the device is."""
    x, y, width, height = page.box('document.querySelector("canvas")')
    return page.screenshot((x, y + 0.35 * height, 0.5 * width, 0.6 * height))


def time_until_silent(page, driver):
    """Stop the driver, return the time until the page shows the silence (s), and let it go on."""
    until(lambda: page.evaluate('window.seen[1] == "healthy"'), page)
    begun = page.evaluate('window.clock')
    os.kill(driver.pid, signal.SIGSTOP)
    try:
        until(lambda: page.evaluate('window.seen[1].startsWith("silent")'), page)
        seen = page.evaluate('window.seen[0]')
        assert page.evaluate('document.querySelector(".spm-banner").dataset.alive') == '0'
        # It is grey and stands still.
        until(lambda: picture(page) == picture(page), page)
    finally:
        os.kill(driver.pid, signal.SIGCONT)
    until(lambda: page.banner() == 'healthy', page)
    return 1e-3 * (seen - begun)


def test_it_moves_and_a_silent_driver_is_seen_at_once(start, page):
    driver = start('encoder_driver', parameters={**SIM, 'sim.trajectory': 'sweep'})
    start('fkm', parameters={'max_age': 5.0})
    start('diagnostics')
    shown, _ = page()
    until(lambda: shown.banner() == 'healthy', shown)
    shown.evaluate(WATCH)
    first = picture(shown)
    until(lambda: picture(shown) != first, shown)
    with Disturbance() as machine:
        seen = time_until_silent(shown, driver)
    machine.expect(seen < SEEN_WITHIN, seen)


@pytest.mark.evidence
@pytest.mark.parametrize('size', [DESKTOP, PHONE])
def test_a_collapsed_panel_takes_neither_banner_nor_cover_with_it(device, size):
    """Nor does a notice; of a device that is silent, a program that stands still or ends."""
    shown, running, view = device(size)
    until(lambda: shown.evaluate(CHIP) and shown.evaluate(PLOTS) > 5, shown)
    # Open, it has all of its parts and leaves the picture its place.
    assert shown.evaluate(HIDDEN) == 0
    if size == PHONE:
        assert shown.evaluate(f'{PANEL}.height') <= size[1] / 3 + 1
        assert shown.evaluate(f'{PANEL}.width') == size[0]
    shown.click(COLLAPSE[size])
    shown.evaluate(NOTICE)
    until(lambda: not shown.evaluate(CHIP) and shown.evaluate(BANNER) == 'healthy', shown)
    for process, seen in ((running, lambda: 'no joint_states' in shown.evaluate(BANNER)),
                          (view, lambda: shown.evaluate(COVERED))):
        os.kill(process.pid, signal.SIGSTOP)
        try:
            until(seen, shown)
        finally:
            os.kill(process.pid, signal.SIGCONT)
        until(lambda: not shown.evaluate(COVERED) and shown.banner() == 'healthy', shown)
    os.kill(view.pid, signal.SIGKILL)
    until(lambda: shown.evaluate(COVERED), shown)
    assert not shown.evaluate(CHIP)


@pytest.mark.evidence
def test_a_plot_joins_nothing_over_a_gap(device):
    """Of 30 s that it spans, 5 s without joint angles are a sixth."""
    shown, running, _ = device(**{'sim.trajectory': 'sweep'})

    def widest():
        """Return the widest part of the plot without the quantity between two parts with it."""
        columns = shown.evaluate(COLUMNS)
        return max((later - before for before, later in pairwise(columns)), default=1.0)

    until(lambda: widest() < 0.1, shown)
    os.kill(running.pid, signal.SIGSTOP)
    time.sleep(5.0)
    os.kill(running.pid, signal.SIGCONT)
    until(lambda: shown.evaluate(BANNER) == 'healthy', shown)
    # For as long as the gap is in the plot.
    assert wait_until(lambda: 0.1 < widest() < 0.4, 10.0), shown.evaluate(COLUMNS)


@pytest.mark.evidence
def test_one_of_six_is_unplugged_and_nothing_on_the_page_moves(device):
    shown, _, _ = device(sensors=6)
    until(lambda: list(shown.evaluate(CHIPS)) == ['1A', '1B', '1C', '3A', '3B', '3C'], shown)
    until(lambda: shown.evaluate(CHIPS)['1B'] == 'joint_1b: healthy', shown)
    before = shown.evaluate(PLACES)
    assert len(before) > 30
    shown.click(BUTTON % 'unplug one of six')
    until(lambda: shown.banner() == 'degraded: joint_1b missing', shown)
    until(lambda: shown.evaluate(CHIPS)['1B'] == 'joint_1b: no reading', shown)
    assert shown.evaluate(PLACES) == before
    until(lambda: shown.banner() == 'healthy', shown)
    assert 'degraded: joint_1b missing' in shown.evaluate(LOG)
    assert shown.evaluate(PLACES) == before


@pytest.mark.evidence
def test_pause_scrub_views_picture_and_dark_are_of_this_page_alone(device):
    image = pytest.importorskip('PIL.Image')
    shown, _, _ = device(**{'sim.trajectory': 'tour'})
    until(lambda: shown.evaluate(PLOTS) > 5, shown)
    running = shown.evaluate(PLOT)
    until(lambda: shown.evaluate(PLOT) != running, shown)
    shown.click(BUTTON % 'pause')
    rate, held = shown.evaluate(ROW % 'orientation'), shown.evaluate(PLOT)
    # The figures continue; the plots do not.
    until(lambda: shown.evaluate(ROW % 'orientation') != rate, shown)
    assert shown.evaluate(PLOT) == held
    shown.evaluate('(() => { const e = document.querySelector(".spm-device input[type=range]");'
                   'e.value = -10; e.oninput() })()')
    assert shown.evaluate(PLOT) != held
    shown.click(BUTTON % 'go on')
    until(lambda: shown.evaluate(PLOT) not in (running, held), shown)

    place = 'window.__viserMutable.camera.position.toArray()'
    front = shown.evaluate(place)
    shown.click(BUTTON % 'top')
    # y of the renderer is up.
    until(lambda: shown.evaluate(place)[1] > front[1] + 1.0, shown)

    shown.evaluate('HTMLAnchorElement.prototype.click = function () { window.saved = this.href }')
    shown.click(BUTTON % 'save picture')
    png = base64.b64decode(shown.evaluate('window.saved').partition(',')[2])
    saved = image.open(io.BytesIO(png)).convert('RGB')
    left = saved.crop((0, 0, saved.width // 2, saved.height))
    assert len(left.getcolors(1 << 24)) > 1000

    # The page is not loaded anew: its plots stay.
    behind = (f'(() => {{ let e = {CANVAS}; while (!e.style.backgroundColor) e = e.parentElement;'
              'return getComputedStyle(e).backgroundColor })()')
    for expected, colour in (('dark', 'rgb(20, 20, 20)'), ('light', 'rgb(255, 255, 255)')):
        shown.click(BUTTON % 'dark')
        assert shown.evaluate('document.documentElement.dataset.mantineColorScheme') == expected
        assert shown.evaluate(behind) == colour
        assert shown.evaluate('location.search') == {'dark': '?darkMode=', 'light': ''}[expected]
        assert shown.evaluate('Boolean(window.saved)')
