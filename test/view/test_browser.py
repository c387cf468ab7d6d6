# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of `view` in a real Chromium: it moves, says what is, and operates the device."""

import base64
import io
import os
from pathlib import Path
import signal
import time

from benchmarks import browser_process
from benchmarks.pipeline.child_process import wait_until
from disturbance import Disturbance
from harness import SIM
import pytest
from spm_haptic_master.view.page import CAMERAS

pytestmark = [
    pytest.mark.process,
    pytest.mark.alone,
    pytest.mark.skipif(browser_process.browser() is None, reason='no Chromium is installed'),
]
PATIENCE = 240.0
# Longest time from the end of the samples to the words on the page (s).
SEEN_WITHIN = 0.5
DESKTOP = (1280, 800)
PHONE = (390, 844)
# Time after which a page that opens moves its camera no more by itself (ms).
SETTLED = 6500.0
# Script that gives the page the functions `probes`.
PROBES = Path(__file__).with_name('probes.js').read_text()


class Page(browser_process.Browser):
    """The page, and what is asked of it by the functions `probes`."""

    def ask(self, call):
        return self.evaluate(f'probes.{call}')

    def press(self, button):
        self.click(f'probes.button("{button}")')


@pytest.fixture
def open_page(tmp_path):
    """Open pages of a `view`, each in a browser of its own."""
    pages = []

    def open_one(view, size):
        pages.append(Page(tmp_path / f'profile_{len(pages)}', *size))
        pages[-1].call('Page.addScriptToEvaluateOnNewDocument', source=PROBES)
        pages[-1].visit(view.stdout.splitlines()[0].removeprefix('view: '))
        return pages[-1]

    yield open_one
    for each in pages:
        each.close()


@pytest.fixture
def page(start, open_page):
    """Start `view` beside what runs; return its page and the program."""

    def begin(size=(720, 480)):
        view = start('view', parameters={'view.port': 18180})
        assert wait_until(lambda: '\n' in view.stdout, PATIENCE), view.stderr
        return open_page(view, size), view

    return begin


@pytest.fixture
def device(start, page):
    """Start a simulated device and `view`; return page, device and `view` once it is healthy."""

    def begin(size=DESKTOP, **parameters):
        running = start(
            'master',
            parameters={
                **SIM,
                'sim.trajectory': 'fixed',
                'rate': 200.0,
                'max_age': 5.0,
                **parameters,
            },
        )
        shown, view = page(size)
        until(lambda: shown.ask('banner()') == 'healthy' and shown.ask('hasKnobs()'), shown)
        return shown, running, view

    return begin


def until(condition, shown):
    assert wait_until(condition, PATIENCE), shown.text()


def picture(page):
    """Return the left part of the page, where the device is, above how old a paused one is."""
    x, y, width, height = page.box('document.querySelector("canvas")')
    return page.screenshot((x, y + 0.35 * height, 0.5 * width, 0.5 * height))


def still_picture(page):
    """Return the picture, as soon as all of it is drawn."""
    latest = [b'']

    def is_still():
        before = latest[0]
        time.sleep(1.0)
        latest[0] = picture(page)
        return latest[0] == before

    until(is_still, page)
    return latest[0]


def test_it_moves_and_a_silent_driver_is_seen_at_once(start, page):
    driver = start('encoder_driver', parameters={**SIM, 'sim.trajectory': 'sweep'})
    start('fkm', parameters={'max_age': 5.0})
    start('diagnostics')
    shown, _ = page()
    until(lambda: shown.banner() == 'healthy', shown)
    shown.ask('watch()')
    first = picture(shown)
    until(lambda: picture(shown) != first, shown)
    with Disturbance() as machine:
        until(lambda: shown.evaluate('window.seen[1] == "healthy"'), shown)
        begun = shown.evaluate('window.clock')
        os.kill(driver.pid, signal.SIGSTOP)
        try:
            until(lambda: shown.evaluate('window.seen[1].startsWith("silent")'), shown)
            seen = 1e-3 * (shown.evaluate('window.seen[0]') - begun)
            assert shown.evaluate('document.querySelector(".spm-banner").dataset.alive') == '0'
            # It is grey and stands still.
            until(lambda: picture(shown) == picture(shown), shown)
        finally:
            os.kill(driver.pid, signal.SIGCONT)
        until(lambda: shown.banner() == 'healthy', shown)
    machine.expect(seen < SEEN_WITHIN, seen)


@pytest.mark.evidence
@pytest.mark.parametrize('size', [DESKTOP, PHONE])
def test_a_collapsed_panel_takes_neither_banner_nor_cover_with_it(device, size):
    """Nor does a notice; of a device that is silent, a program that stands still or ends."""
    shown, running, view = device(size)
    until(lambda: shown.ask('hasChip()') and shown.ask('plots()') > 5, shown)
    # Open, it has all of its parts and leaves the picture its place.
    assert shown.ask('hidden()') == 0
    if size == PHONE:
        assert shown.ask('panel().height') <= size[1] / 3 + 1
        assert shown.ask('panel().width') == size[0]
    shown.click('probes.title()' if size == PHONE else 'probes.arrow()')
    shown.ask('notice()')
    until(lambda: not shown.ask('hasChip()') and shown.ask('banner()') == 'healthy', shown)
    for process, seen in (
        (running, lambda: 'no joint_states' in shown.ask('banner()')),
        (view, lambda: shown.ask('isCovered()')),
    ):
        os.kill(process.pid, signal.SIGSTOP)
        try:
            until(seen, shown)
        finally:
            os.kill(process.pid, signal.SIGCONT)
        until(lambda: not shown.ask('isCovered()') and shown.banner() == 'healthy', shown)
    os.kill(view.pid, signal.SIGKILL)
    until(lambda: shown.ask('isCovered()'), shown)
    assert not shown.ask('hasChip()')


@pytest.mark.evidence
def test_a_page_that_nobody_clicks_returns_with_view(device, start):
    """A page on a wall, or beside the window that has the focus."""
    shown, _, view = device()
    shown.call('Emulation.setFocusEmulationEnabled', enabled=False)
    assert not shown.evaluate('Document.prototype.hasFocus.call(document)')
    os.kill(view.pid, signal.SIGKILL)
    until(lambda: shown.ask('isCovered()'), shown)
    start('view', parameters={'view.port': 18180})
    until(lambda: not shown.ask('isCovered()') and shown.ask('banner()') == 'healthy', shown)


@pytest.mark.evidence
def test_a_plot_joins_nothing_over_a_gap(device):
    """Of 30 s that it spans, 5 s without joint angles are a sixth."""
    shown, running, _ = device(**{'sim.trajectory': 'sweep'})
    until(lambda: shown.ask('widestGap()') < 0.1, shown)
    os.kill(running.pid, signal.SIGSTOP)
    time.sleep(5.0)
    os.kill(running.pid, signal.SIGCONT)
    until(lambda: shown.ask('banner()') == 'healthy', shown)
    # For as long as the gap is in the plot.
    assert wait_until(lambda: 0.1 < shown.ask('widestGap()') < 0.4, 10.0)


@pytest.mark.evidence
def test_one_of_six_is_unplugged_and_nothing_on_the_page_moves(device):
    shown, _, _ = device(sensors=6)
    until(
        lambda: (
            list(shown.ask('chips()'))
            == [f'th{name} \u2713' for name in ('1A', '1B', '1C', '3A', '3B', '3C')]
        ),
        shown,
    )
    assert shown.ask('cutTitles()') == []
    before = shown.ask('places()')
    assert len(before) > 30
    shown.press('unplug one of six')
    until(lambda: shown.banner() == 'degraded: th1B missing', shown)
    until(lambda: shown.ask('chips()').get('th1B \u2205') == 'th1B (joint_1b): no reading', shown)
    assert shown.ask('places()') == before
    until(lambda: shown.banner() == 'healthy', shown)
    assert 'degraded: th1B missing' in shown.ask('log()')
    assert shown.ask('places()') == before


@pytest.mark.evidence
def test_pause_scrub_views_picture_and_dark_are_of_this_page_alone(device):
    image = pytest.importorskip('PIL.Image')
    shown, _, _ = device(**{'sim.trajectory': 'tour'})
    until(lambda: shown.ask('plots()') > 5, shown)
    running = shown.ask('plot()')
    until(lambda: shown.ask('plot()') != running, shown)
    shown.press('pause')
    rate = shown.ask('row("orientation")')
    held = shown.ask('plot()')
    # The figures continue; the plots do not.
    until(lambda: shown.ask('row("orientation")') != rate, shown)
    assert shown.ask('plot()') == held
    shown.ask('scrub(-10)')
    assert shown.ask('plot()') != held
    shown.press('go on')
    until(lambda: shown.ask('plot()') not in (running, held), shown)

    front = shown.ask('camera()')
    shown.press('top')
    # y of the renderer is up.
    until(lambda: shown.ask('camera()')[1] > front[1] + 1.0, shown)

    shown.ask('keepDownloads()')
    shown.press('save picture')
    png = base64.b64decode(shown.evaluate('window.saved').partition(',')[2])
    saved = image.open(io.BytesIO(png)).convert('RGB')
    left = saved.crop((0, 0, saved.width // 2, saved.height))
    assert len(left.getcolors(1 << 24)) > 1000
    # No title or name of its plots is cut.
    assert shown.evaluate('window.cutBy') < 1.0

    # The page is not loaded anew: its plots stay.
    for expected, colour in (('dark', 'rgb(20, 20, 20)'), ('light', 'rgb(255, 255, 255)')):
        shown.press('dark')
        assert shown.evaluate('document.documentElement.dataset.mantineColorScheme') == expected
        assert shown.ask('background()') == colour
        assert shown.evaluate('location.search') == {'dark': '?darkMode=', 'light': ''}[expected]
        assert shown.evaluate('Boolean(window.saved)')


@pytest.mark.evidence
def test_paused_the_picture_is_that_of_then_and_says_so(device):
    """It stands still while the device moves on, and another time has another picture."""
    shown, _, _ = device(**{'sim.trajectory': 'tour'})
    until(lambda: shown.ask('plots()') > 5, shown)
    # Long enough for two different poses.
    time.sleep(8.0)
    shown.press('pause')
    shown.ask('scrub(-5)')
    then = still_picture(shown)
    assert 'paused: the picture of' in shown.text()
    time.sleep(2.0)
    assert picture(shown) == then
    shown.ask('scrub(-1)')
    until(lambda: picture(shown) != then, shown)
    shown.press('go on')
    until(lambda: 'paused: the picture of' not in shown.text(), shown)
    now = picture(shown)
    until(lambda: picture(shown) != now, shown)


@pytest.mark.evidence
def test_whoever_hears_or_types_has_what_others_see(device):
    """Names of controls, states as status or alert, and chips that the keyboard reaches."""
    shown, running, _ = device()
    until(lambda: shown.ask('plots()') > 5, shown)
    until(
        lambda: (
            shown.ask('names()')['sliders'] == ['tilt, deg', 'azimuth, deg', 'self-rotation, deg']
        ),
        shown,
    )
    names = shown.ask('names()')
    chips = zip(names['chips'], names['joints'], strict=True)
    assert all(chip.startswith(f'{joint}: ') for chip, joint in chips)
    assert all(name.startswith('plot: ') for name in names['plots'])
    assert names['banner'] == 'status'
    assert names['note'] == 'status'
    assert names['title'] == 'haptic master'
    os.kill(running.pid, signal.SIGSTOP)
    try:
        until(lambda: shown.ask('names()')['banner'] == 'alert', shown)
    finally:
        os.kill(running.pid, signal.SIGCONT)
    shown.press('legend')
    assert 'Protection level: bound' in shown.text()
    shown.press('close')
    assert 'Protection level: bound' not in shown.text()


def check_camera(shown):
    """Check that the camera is that of the view `front`, and stays there."""
    until(lambda: shown.ask('banner()') == 'healthy', shown)
    # As far away as the shape of the picture needs.
    _, _, width, height = shown.box('document.querySelector("canvas")')
    back = max(1.0, height / width)
    x, y, z = CAMERAS['front']
    expected = (x * x + y * y + z * z) ** 0.5 * back
    until(lambda: abs(shown.ask('distance()') - expected) < 0.05 * expected, shown)
    # And it is so after the renderer, too, has set its camera.
    until(lambda: shown.evaluate('performance.now()') > SETTLED, shown)
    assert abs(shown.ask('distance()') - expected) < 0.05 * expected


@pytest.mark.parametrize(
    'sizes', [(PHONE, DESKTOP), pytest.param(((820, 1180),), marks=pytest.mark.evidence)]
)
def test_a_page_opens_with_the_device_in_the_picture(device, open_page, sizes):
    """Upright as well, without a click; two of one device at once."""
    first, *others = sizes
    shown, _, view = device(first)
    for each in (shown, *[open_page(view, size) for size in others]):
        check_camera(each)


@pytest.mark.evidence
@pytest.mark.parametrize('size', [PHONE, DESKTOP])
def test_every_line_of_the_legend_can_be_read(device, size):
    """Also on a phone: it is in front of the panel."""
    shown, _, _ = device(size)
    shown.press('legend')
    assert shown.evaluate('document.querySelectorAll(".spm-entry").length') > 10
    assert shown.ask('isLegendReachable()')


@pytest.mark.evidence
def test_no_name_in_the_picture_is_cut_at_an_edge(device):
    """On a phone, wherever the camera is: a name whose point is in the picture is all there."""
    shown, _, _ = device(PHONE)
    until(lambda: len(shown.ask('pictureNames()')) >= 8, shown)
    # After that the page does not move the camera by itself.
    time.sleep(7.0)
    edges = []
    for right, up in ((0.0, 0.0), (1.3, 0.0), (-2.6, 0.0), (1.3, 2.0), (0.0, -4.0)):
        shown.ask(f'moveCamera({right}, {up})')
        time.sleep(1.0)
        found = shown.ask('pictureNames()')
        edges += [text for text, out in found if out > -20.0]
        assert [name for name in found if name[1] > 0.0] == []
    # There were names at the edges.
    assert len(edges) > 3


@pytest.mark.evidence
@pytest.mark.parametrize('size', [PHONE, DESKTOP])
def test_what_the_introduction_says_to_try_is_a_button_in_view(device, size):
    """Neither scrolled for nor searched: one click on it plays the story."""
    shown, _, _ = device(size)
    attempt = 'Try: cross the singularity'
    until(lambda: shown.ask(f'button("{attempt}")?.offsetWidth > 0'), shown)
    assert shown.ask(f'button("{attempt}").getBoundingClientRect().bottom') < size[1]
    shown.press(attempt)
    until(lambda: 'Three encoders: up to' in shown.text(), shown)
