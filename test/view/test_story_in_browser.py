# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the page tells, in a real Chromium: stories, encoders, plots, and a layout that stays."""

import base64
import io

from benchmarks import browser_process
from harness import SIM
import pytest
from spm_haptic_master.benchmark.child_process import wait_until

pytest.importorskip('viser', reason='viser is not installed (extra view)')
pytest.importorskip('websockets', reason='websockets is not installed (extra test)')
browser = pytest.importorskip('browser')
image = pytest.importorskip('PIL.Image')

pytestmark = [
    pytest.mark.process, pytest.mark.evidence,
    pytest.mark.skipif(browser_process.browser() is None, reason='no Chromium is installed')]
PATIENCE = 240.0
DESKTOP, PHONE = (1280, 800), (390, 844)
BUTTON = '[...document.querySelectorAll("button")].find(e => e.innerText.trim() == "%s")'
NOTE = 'document.querySelector(".spm-note").innerText'
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
# The pixels of a plot.
PLOT = 'document.querySelector(".spm-plot").toDataURL()'


@pytest.fixture
def page(start, tmp_path):
    """Start a simulated device and `view`; return its page once it is healthy."""
    pages = []

    def begin(size=DESKTOP, **parameters):
        start('master', parameters={
            **SIM, 'sim.trajectory': 'fixed', 'rate': 200.0, 'max_age': 5.0, **parameters})
        view = start('view', parameters={'view.port': 18680})
        assert wait_until(lambda: '\n' in view.stdout, PATIENCE), view.stderr
        pages.append(browser.Browser(tmp_path / 'profile', *size))
        shown = pages[-1]
        shown.visit(view.stdout.splitlines()[0].removeprefix('view: '))
        assert wait_until(lambda: shown.banner() == 'healthy', PATIENCE)
        assert wait_until(lambda: shown.evaluate(
            f'Boolean({BUTTON % "move by itself"})'), PATIENCE)
        return shown

    yield begin
    for each in pages:
        each.close()


def test_the_singularity_is_crossed_and_explained(page):
    """Three encoders are lost there, in the figures; the device is not."""
    shown = page()
    assert wait_until(lambda: 'Three encoders determine' in shown.evaluate(NOTE), PATIENCE)
    worst = []

    def off():
        text = shown.evaluate(ROW % 'three encoders')
        if text.endswith('off'):
            worst.append(float(text.partition('\u00b0')[0]))
        return max(worst, default=0.0)

    assert wait_until(lambda: off() > 0.0, PATIENCE)
    shown.click(BUTTON % 'cross the singularity')
    assert wait_until(lambda: 'violet ghost' in shown.evaluate(NOTE), PATIENCE)
    assert wait_until(lambda: off() > 1.0, PATIENCE), worst
    assert wait_until(lambda: 'violet ghost' not in shown.evaluate(NOTE), PATIENCE)


def test_one_of_six_is_unplugged_and_nothing_on_the_page_moves(page):
    shown = page(sensors=6)
    assert wait_until(lambda: list(shown.evaluate(CHIPS)) == ['1A', '1B', '1C', '3A', '3B', '3C'],
                      PATIENCE)
    assert wait_until(lambda: shown.evaluate(CHIPS)['1B'] == 'joint_1b: healthy', PATIENCE)
    before = shown.evaluate(PLACES)
    assert len(before) > 30
    shown.click(BUTTON % 'unplug one of six')
    assert wait_until(lambda: shown.banner() == 'degraded: joint_1b missing', PATIENCE)
    assert wait_until(lambda: shown.evaluate(CHIPS)['1B'] == 'joint_1b: no reading', PATIENCE)
    assert shown.evaluate(PLACES) == before
    assert wait_until(lambda: shown.banner() == 'healthy', PATIENCE)
    log = 'document.querySelector(".spm-log").innerText'
    assert 'degraded: joint_1b missing' in shown.evaluate(log)
    assert 'faults: dropout:joint_1b' in shown.evaluate(log)
    assert shown.evaluate(PLACES) == before


@pytest.mark.parametrize('size', [DESKTOP, PHONE])
def test_the_panel_leaves_the_picture_its_place(page, size):
    shown = page(size)
    assert wait_until(lambda: shown.evaluate('document.querySelectorAll(".spm-plot").length') > 5,
                      PATIENCE)
    assert shown.evaluate(HIDDEN) == 0
    if size == PHONE:
        panel = ('document.querySelector(\'.mantine-Paper-root[style*="max-height: 60%"]\')'
                 '.getBoundingClientRect()')
        assert shown.evaluate(f'{panel}.height') <= size[1] / 3 + 1
        assert shown.evaluate(f'{panel}.width') == size[0]


def test_pause_scrub_views_picture_and_dark_are_of_this_page_alone(page):
    shown = page(**{'sim.trajectory': 'tour'})
    assert wait_until(lambda: shown.evaluate('document.querySelectorAll(".spm-plot").length') > 5,
                      PATIENCE)
    running = shown.evaluate(PLOT)
    assert wait_until(lambda: shown.evaluate(PLOT) != running, PATIENCE)
    shown.click(BUTTON % 'pause')
    rate = shown.evaluate(ROW % 'orientation')
    held = shown.evaluate(PLOT)
    # Figures go on; the plots do not.
    assert wait_until(lambda: shown.evaluate(ROW % 'orientation') != rate, PATIENCE)
    assert shown.evaluate(PLOT) == held
    shown.evaluate('(() => { const e = document.querySelector(".spm-device input[type=range]");'
                   'e.value = -10; e.oninput() })()')
    assert shown.evaluate(PLOT) != held
    shown.click(BUTTON % 'go on')
    assert wait_until(lambda: shown.evaluate(PLOT) not in (running, held), PATIENCE)

    place = 'window.__viserMutable.camera.position.toArray()'
    front = shown.evaluate(place)
    shown.click(BUTTON % 'top')
    # y of the renderer is up.
    assert wait_until(lambda: shown.evaluate(place)[1] > front[1] + 1.0, PATIENCE)

    shown.evaluate('HTMLAnchorElement.prototype.click = function () { window.saved = this.href }')
    shown.click(BUTTON % 'save picture')
    png = base64.b64decode(shown.evaluate('window.saved').partition(',')[2])
    picture = image.open(io.BytesIO(png)).convert('RGB')
    device = picture.crop((0, 0, picture.width // 2, picture.height))
    assert len(device.getcolors(1 << 24)) > 1000

    def scheme():
        """Return whether the page is dark or light; None while it is loaded anew."""
        try:
            return shown.evaluate('document.documentElement?.dataset.mantineColorScheme')
        except AssertionError:
            return None

    shown.click(BUTTON % 'dark')
    assert wait_until(lambda: scheme() == 'dark', PATIENCE)
    assert wait_until(lambda: shown.banner() == 'healthy', PATIENCE)
    shown.click(BUTTON % 'dark')
    assert wait_until(lambda: scheme() == 'light', PATIENCE)
