# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What must not happen on the page, in a real Chromium."""

from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
import os
import signal
import socket
from threading import Thread
import time

from benchmarks import browser_process
from harness import SIM
import pytest
from spm_haptic_master.benchmark.child_process import wait_until

viser = pytest.importorskip('viser', reason='viser is not installed (extra view)')
pytest.importorskip('websockets', reason='websockets is not installed (extra test)')
browser = pytest.importorskip('browser')

pytestmark = [
    pytest.mark.process, pytest.mark.alone, pytest.mark.evidence,
    pytest.mark.skipif(browser_process.browser() is None, reason='no Chromium is installed')]
PATIENCE = 240.0
# Desktop and phone, and what collapses the panel there: the arrow at its top, and its title.
DESKTOP, PHONE = (1280, 800), (390, 844)
COLLAPSE = {
    DESKTOP: 'document.querySelector("[aria-label=\'Collapse panel area\']")',
    PHONE: '[...document.querySelectorAll("div")].filter(e => e.innerText?.trim() == '
           '"haptic master").at(-1)'}
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
    return front && b.left >= 0 && b.right <= innerWidth && b.top >= 0 ? e.innerText : "" })()"""
# Whether the page is covered, all of it and above all else.
COVERED = """(() => { const e = document.querySelector(".spm-lost");
    if (!e) return false;
    const b = e.getBoundingClientRect();
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
# Opens a websocket as any page can, and returns whether it was opened.
OPEN = """new Promise(done => { const socket = new WebSocket("ws://127.0.0.1:%s", ["viser-v%s"]);
    socket.onopen = () => done(true); socket.onerror = () => done(false) })"""


@pytest.fixture
def page(start, tmp_path):
    """Start a simulated device and `view`; return its page, the device and `view`."""
    pages = []

    def begin(size=DESKTOP):
        device = start('master', parameters={**SIM, 'sim.trajectory': 'sweep', 'rate': 200.0})
        view = start('view', parameters={'view.port': 18580})
        assert wait_until(lambda: '\n' in view.stdout, PATIENCE), view.stderr
        pages.append(browser.Browser(tmp_path / 'profile', *size))
        pages[-1].visit(view.stdout.splitlines()[0].removeprefix('view: '))
        assert wait_until(lambda: pages[-1].evaluate(BANNER) == 'healthy', PATIENCE)
        return pages[-1], device, view

    yield begin
    for each in pages:
        each.close()


@pytest.mark.parametrize('size', [DESKTOP, PHONE])
def test_a_collapsed_panel_takes_neither_banner_nor_cover_with_it(page, size):
    """Of a device that is silent, and of a program that stands still or ends."""
    shown, device, view = page(size)
    assert wait_until(lambda: shown.evaluate(CHIP), PATIENCE)
    shown.click(COLLAPSE[size])
    assert wait_until(lambda: not shown.evaluate(CHIP), PATIENCE)
    assert wait_until(lambda: shown.evaluate(BANNER) == 'healthy', PATIENCE)
    os.kill(device.pid, signal.SIGSTOP)
    try:
        assert wait_until(lambda: 'no joint_states' in shown.evaluate(BANNER), PATIENCE)
    finally:
        os.kill(device.pid, signal.SIGCONT)
    assert wait_until(lambda: shown.evaluate(BANNER) == 'healthy', PATIENCE)
    assert not shown.evaluate(COVERED)
    os.kill(view.pid, signal.SIGSTOP)
    try:
        assert wait_until(lambda: shown.evaluate(COVERED), PATIENCE)
    finally:
        os.kill(view.pid, signal.SIGCONT)
    assert wait_until(lambda: not shown.evaluate(COVERED), PATIENCE)
    os.kill(view.pid, signal.SIGKILL)
    assert wait_until(lambda: shown.evaluate(COVERED), PATIENCE)
    assert not shown.evaluate(CHIP)


def test_a_plot_joins_nothing_over_a_gap(page):
    """Of 30 s that it spans, 5 s without joint angles are a sixth."""
    shown, device, _ = page()

    def widest():
        """Return the widest part of the plot without the quantity between two parts with it."""
        columns = shown.evaluate(COLUMNS)
        return max((later - before for before, later in zip(columns, columns[1:], strict=False)),
                   default=1.0)

    assert wait_until(lambda: widest() < 0.1, PATIENCE)
    os.kill(device.pid, signal.SIGSTOP)
    time.sleep(5.0)
    os.kill(device.pid, signal.SIGCONT)
    assert wait_until(lambda: shown.evaluate(BANNER) == 'healthy', PATIENCE)
    # For as long as the gap is in the plot.
    assert wait_until(lambda: 0.1 < widest() < 0.4, 10.0), shown.evaluate(COLUMNS)


def test_no_other_page_has_a_connection_and_the_page_has_no_other(page):
    shown, _, view = page()
    port = view.stdout.split()[1].rpartition(':')[2]
    opened = OPEN % (port, viser.__version__)
    assert shown.evaluate(opened)
    with socket.create_server(('127.0.0.1', 0)) as foreign:
        # As in a link of an attacker, whose server would have this origin run scripts.
        shown.visit(f'http://127.0.0.1:{port}/'
                    f'?websocket=ws://127.0.0.1:{foreign.getsockname()[1]}')
        assert wait_until(lambda: shown.evaluate('Boolean(document.querySelector("canvas"))'),
                          PATIENCE)
        foreign.settimeout(5.0)
        with pytest.raises(TimeoutError):
            foreign.accept()
    with ThreadingHTTPServer(('127.0.0.1', 0), SimpleHTTPRequestHandler) as other:
        Thread(target=other.serve_forever).start()
        address = f'http://127.0.0.1:{other.server_port}'
        shown.visit(f'{address}/')
        assert wait_until(lambda: shown.evaluate('location.origin') == address, PATIENCE)
        assert not shown.evaluate(opened)
        other.shutdown()
    assert wait_until(lambda: f"Origin '{address}' is another page" in view.stderr, 20.0), \
        view.stderr
