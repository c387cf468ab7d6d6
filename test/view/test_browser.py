# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of `view` in a real Chromium: it moves, says what is, and steers the simulation."""

from itertools import pairwise
from math import degrees
import os
import signal

from benchmarks import browser_process
from disturbance import Disturbance
from geometry_msgs.msg import QuaternionStamped
from harness import DATA, SIM, SIMULATED
import pytest
from spm_haptic_master.benchmark.child_process import parameter_arguments, wait_until
from spm_haptic_master.kinematics import matrix_from_quaternion, zxz_from_matrix
from spm_haptic_master.nodes.guidance_publisher import published
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

pytest.importorskip('viser', reason='viser is not installed (extra view)')
pytest.importorskip('websockets', reason='websockets is not installed (extra test)')
browser = pytest.importorskip('browser')

pytestmark = [
    pytest.mark.process, pytest.mark.alone,
    pytest.mark.skipif(browser_process.browser() is None, reason='no Chromium is installed')]
PATIENCE = 240.0
# Longest time from the end of the samples to the words on the page (s).
SEEN_WITHIN = 0.5
# Becomes a list of the banner's texts with their times (ms) while the page is open, and a list of
# the times at which the page did run.
WATCH = """(() => { window.seen = []; window.ran = []; let last = '';
setInterval(() => { const b = document.querySelector('.spm-banner'); window.ran.push(Date.now());
const text = b ? b.innerText : '';
if (text != last) { last = text; window.seen.push([Date.now(), text]); } }, 10); })()"""
BUTTON = '[...document.querySelectorAll("button")].find(e => e.innerText.trim() == "%s")'


@pytest.fixture
def page(start, tmp_path):
    """Start `view` beside what runs; return its page and the program."""
    pages = []

    def begin():
        view = start('view', parameters={'view.port': 18180})
        assert wait_until(lambda: '\n' in view.stdout, PATIENCE), view.stderr
        page = browser.Browser(tmp_path / 'profile')
        pages.append(page)
        page.visit(view.stdout.splitlines()[0].removeprefix('view: '))
        return page, view

    yield begin
    for each in pages:
        each.close()


@pytest.fixture
def device(start, page):
    """Start the three nodes and `view`; return page, driver and `view` once it is healthy."""
    def begin(**parameters):
        driver = start('encoder_driver', parameters={**SIM, **parameters})
        start('fkm', parameters={'max_age': 5.0})
        start('diagnostics')
        shown, view = page()
        assert wait_until(lambda: shown.banner() == 'healthy', PATIENCE), shown.text()
        shown.evaluate(WATCH)
        return shown, driver, view
    return begin


def picture(page):
    """Return the left part of the page, where the device is."""
    x, y, width, height = page.box('document.querySelector("canvas")')
    return page.screenshot((x, y + 0.35 * height, 0.5 * width, 0.6 * height))


def time_until_silent(page, driver):
    """
    Stop the driver, return the time until the page shows the silence (s), and let it go on.

    A page that gets no time of the processor cannot show anything meanwhile: that is left out.
    """
    begun = []

    def healthy():
        # What is on the page and what was noticed of it are one: the silence is the next to come.
        begun.append(page.evaluate('window.seen.at(-1)?.[1] == "healthy" && '
                                   'document.querySelector(".spm-banner").innerText == "healthy" '
                                   '&& Date.now()'))
        return begun[-1]

    silent = 'window.seen.filter(([time, text]) => time >= %f && text.startsWith("silent"))'
    assert wait_until(healthy, PATIENCE)
    os.kill(driver.pid, signal.SIGSTOP)
    try:
        assert wait_until(lambda: page.evaluate(silent % begun[-1]), PATIENCE), page.text()
        seen = page.evaluate(silent % begun[-1])[0][0]
        ran = page.evaluate(f'window.ran.filter(e => e > {begun[-1]} && e <= {seen})')
        stalled = max(later - before for before, later in pairwise([begun[-1], *ran]))
        assert page.evaluate('document.querySelector(".spm-banner").dataset.alive') == '0'
        # It is grey and stands still.
        assert wait_until(lambda: picture(page) == picture(page), PATIENCE)
    finally:
        os.kill(driver.pid, signal.SIGCONT)
    assert wait_until(lambda: page.banner() == 'healthy', PATIENCE)
    return 1e-3 * (seen - begun[-1] - stalled)


def test_it_moves_and_a_silent_driver_is_seen_at_once(device):
    shown, driver, _ = device(**{'sim.trajectory': 'sweep'})
    first = picture(shown)
    assert wait_until(lambda: picture(shown) != first, PATIENCE)
    with Disturbance() as machine:
        seen = time_until_silent(shown, driver)
    machine.expect(seen < SEEN_WITHIN, seen)


@pytest.mark.evidence
def test_a_slider_moves_the_orientation_and_a_button_breaks_an_encoder(device, observer):
    orientations = observer.collect(QuaternionStamped, 'orientation')
    states = observer.collect(String, 'state', STATE)
    shown, _, _ = device(**{'sim.trajectory': 'fixed'})

    def phi():
        observer.spin(0.2)
        q = orientations[-1][1].quaternion
        return float(zxz_from_matrix(matrix_from_quaternion((q.x, q.y, q.z, q.w)))[2])

    before = phi()
    thumb = '[...document.querySelectorAll(".mantine-Slider-thumb")].at(-1)'
    track = '[...document.querySelectorAll(".mantine-Slider-track")].at(-1)'

    def value():
        return float(shown.evaluate(f'{thumb}.getAttribute("aria-valuenow")'))

    # It follows the device until it is touched.
    assert wait_until(lambda: abs(value() - degrees(phi())) <= 0.5, PATIENCE)
    left, _, width, _ = shown.box(track)
    x, y, w, h = shown.box(thumb)
    shown.mouse('mouseMoved', x + 0.5 * w, y + 0.5 * h)
    shown.mouse('mousePressed', x + 0.5 * w, y + 0.5 * h)
    for part in (0.5, 0.3, 0.2):
        shown.mouse('mouseMoved', left + part * width, y + 0.5 * h)
    shown.mouse('mouseReleased', left + 0.2 * width, y + 0.5 * h)
    assert wait_until(lambda: value() < -10.0, PATIENCE)
    assert wait_until(lambda: abs(degrees(phi()) - value()) < 1.0, PATIENCE)
    assert abs(degrees(before - phi())) > 10.0
    assert observer.spin_until(lambda: states[-1][1].data == 'healthy', PATIENCE)

    shown.click(BUTTON % 'dropout')
    assert observer.spin_until(lambda: states[-1][1].data.startswith('silent'), PATIENCE)
    assert wait_until(lambda: shown.banner() == 'silent: no joint samples', PATIENCE)
    assert 'dropout:joint_1b' in shown.text()
    shown.click(BUTTON % 'no fault')
    assert observer.spin_until(lambda: states[-1][1].data == 'healthy', PATIENCE)
    assert wait_until(lambda: shown.banner() == 'healthy', PATIENCE)
    shown.click(BUTTON % 'offset')
    assert observer.spin_until(lambda: states[-1][1].data != 'healthy', PATIENCE)
    assert wait_until(lambda: shown.banner() == states[-1][1].data, PATIENCE)
    shown.click(BUTTON % 'no fault')
    assert observer.spin_until(lambda: states[-1][1].data == 'healthy', PATIENCE)
    # An encoder that is stuck shows when the device moves.
    shown.click(BUTTON % 'move by itself')
    shown.click(BUTTON % 'stuck')
    assert observer.spin_until(lambda: states[-1][1].data != 'healthy', PATIENCE)
    assert wait_until(lambda: 'stuck:joint_1b' in shown.text(), PATIENCE)
    assert wait_until(lambda: observer.spin(0.1) or shown.banner() == states[-1][1].data,
                      PATIENCE)


@pytest.mark.evidence
def test_the_program_that_stands_still_itself_is_seen(device):
    """The page says so without it: a picture of the past does not look alive."""
    shown, _, view = device()
    lost = 'getComputedStyle(document.querySelector(".spm-lost")).visibility'
    assert wait_until(lambda: shown.evaluate(lost) == 'hidden', PATIENCE)
    os.kill(view.pid, signal.SIGSTOP)
    try:
        assert wait_until(lambda: shown.evaluate(lost) == 'visible', PATIENCE)
    finally:
        os.kill(view.pid, signal.SIGCONT)
    assert wait_until(lambda: shown.evaluate(lost) == 'hidden', PATIENCE)
    os.kill(view.pid, signal.SIGKILL)
    assert wait_until(lambda: shown.evaluate(lost) == 'visible', PATIENCE)


@pytest.mark.evidence
def test_a_calibration_says_what_to_do_next(page):
    with published([]) as publish:
        publish('tilt the handle farther', {'precision': 0.25, 'turn the handle': 0.95})
        shown, _ = page()
        assert wait_until(lambda: 'tilt the handle farther' in shown.text(), PATIENCE)
        assert 'precision' in shown.text() and 'turn the handle' in shown.text()
    assert wait_until(lambda: 'tilt the handle' not in shown.text(), PATIENCE)


@pytest.mark.evidence
def test_no_notice_covers_the_banner_and_it_is_within_the_page(device):
    """A browser without a GPU has a notice where the banner is."""
    shown, _, _ = device()
    uncovered = """(() => {
        const banner = document.querySelector(".spm-banner"), b = banner.getBoundingClientRect();
        const notice = document.createElement("div");
        notice.style = "width: 100vw; height: 100vh; pointer-events: auto";
        document.querySelector(".mantine-Notifications-root").append(notice);
        return [0.02, 0.5, 0.98].every(part =>
            document.elementFromPoint(b.x + part * b.width, b.y + 0.5 * b.height) == banner)
        })()"""
    inside = """(() => { const b = document.querySelector(".spm-banner").getBoundingClientRect();
        return innerWidth == %d && b.left >= 0 && b.right <= innerWidth && b.top >= 0
            && b.width >= 60 && b.height < 80 })()"""
    assert shown.evaluate(uncovered)
    for width in (400, 700, 1280):
        shown.call('Emulation.setDeviceMetricsOverride', width=width, height=700,
                   deviceScaleFactor=1, mobile=False)
        assert wait_until(lambda: shown.evaluate(inside % width), 20.0)  # noqa: B023
        assert shown.evaluate(uncovered)


@pytest.mark.evidence
def test_a_motion_that_is_recorded_is_on_the_page(start, page, bus_channel, tmp_path):
    """By the program itself, from encoders on a bus, until it ends."""
    bus = [*parameter_arguments({'can.interface': 'udp_multicast', 'can.channel': bus_channel}),
           *parameter_arguments({'rate': 200.0, 'can.timeout': 0.5})]
    start('sim_bus', *bus, *parameter_arguments({'sim.trajectory': 'hand'}))
    calibrate = start('calibrate', '--motion', *bus, *parameter_arguments(
        {'can.sync': 'produce'}), '-o', str(tmp_path / 'calibration.yaml'))
    shown, _ = page()
    assert wait_until(lambda: ' sets: ' in shown.text(), PATIENCE), calibrate.stderr
    assert 'precision' in shown.text()
    calibrate.send_signal(signal.SIGINT)
    assert wait_until(lambda: ' sets: ' not in shown.text(), PATIENCE)


@pytest.mark.evidence
def test_two_arms_have_a_banner_each_and_a_replay_has_no_knobs(start, page):
    start('master', '--ros-args', '-r', '__ns:=/left', parameters={**SIM, 'rate': 200.0})
    start('master', '--ros-args', '-r', '__ns:=/right', *SIMULATED, parameters={
        'source': 'replay', 'replay.path': str(DATA / 'fig9_canopen.log.gz'),
        'replay.loop': True})
    shown, _ = page()
    banners = '[...document.querySelectorAll(".spm-banner")].map(e => e.innerText)'
    assert wait_until(lambda: {text.partition(' ')[0] for text in shown.evaluate(banners)} == {
        'left:', 'right:'}, PATIENCE)
    assert wait_until(lambda: 'left: healthy' in shown.evaluate(banners), PATIENCE)
    assert wait_until(lambda: 'right: healthy' in shown.evaluate(banners), PATIENCE)
    assert wait_until(lambda: 'replay: fig9_canopen.log.gz' in shown.text(), PATIENCE)
    # One of them is simulated.
    assert shown.text().count('move by itself') == 1
