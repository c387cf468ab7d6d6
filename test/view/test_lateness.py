# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A picture that is late is covered, on slow networks and behind a relay with a queue."""

import socket
from threading import Event, Thread
import time

from benchmarks import browser_process
from benchmarks.pipeline.child_process import wait_until
import msgspec
import numpy as np
import pytest
from slow_link import SlowLink
from spm_haptic_master.view.page import LATEST, Page
from spm_haptic_master.view.status import Banner, Light
import viser
from websockets.sync import client
import zstandard

PATIENCE = 120.0
# Longest time for which a pose of that age may stand uncovered (s).
COVERED_WITHIN = 1.0
# Periods of a device's poses, of its figures, and of the news (s).
POSE_PERIOD = 1.0 / 60.0
FIGURES_PERIOD = 0.1
NEWS_PERIOD = 0.25
# Times for which the link is slow, and for which samples are taken before (s).
SLOW_FOR = 6.0
FAST_FOR = 1.0
# Keeps when it is, how late the newest drawn change is, and whether the page is covered, every
# 50 ms. The change is a text with the time at which the server made it.
WATCH = """
window.samples = [];
setInterval(() => {
    const made = Number(window.__viserSceneTree.getState()['/clock']?.message.props.text);
    const now = Date.now() / 1000;
    const cover = document.querySelector('.spm-lost');
    window.samples.push([now, now - made, getComputedStyle(cover).visibility == 'visible']);
}, 50);
"""


class Sender:
    """Sends poses, figures and news as a device at 60 Hz does, until it is closed."""

    def __init__(self, server):
        self.page = Page(server)
        self.page.show(
            '',
            Banner(
                light=Light.GREEN,
                text='healthy',
                alive=True,
                event='healthy',
            ),
        )
        self._clock = server.scene.add_label('/clock', '0')
        self._pose = server.scene.add_frame('/pose')
        points = np.zeros((1000, 3), np.float32)
        self._figures = server.scene.add_point_cloud('/figures', points, (0, 0, 0))
        self._ended = Event()
        self._thread = Thread(target=self._run)
        self._thread.start()

    def _run(self):
        rng = np.random.default_rng(1)
        due = dict.fromkeys((FIGURES_PERIOD, NEWS_PERIOD), 0.0)
        while not self._ended.wait(POSE_PERIOD):
            now = time.monotonic()
            self._clock.text = f'{time.time():.3f}'
            self._pose.wxyz = rng.standard_normal(4)
            if now >= due[FIGURES_PERIOD]:
                due[FIGURES_PERIOD] = now + FIGURES_PERIOD
                self._figures.points = rng.standard_normal((1000, 3)).astype(np.float32)
            if now >= due[NEWS_PERIOD]:
                due[NEWS_PERIOD] = now + NEWS_PERIOD
                self.page.refresh()

    def close(self):
        self._ended.set()
        self._thread.join()


@pytest.fixture
def sender(serve):
    """Give a device's sender on a server of its own."""
    server = serve(names='late')
    server.scene.reset()
    made = Sender(server)
    yield made
    made.close()


@pytest.fixture
def watched(sender, tmp_path):
    """Open the page through a link; return it once it is in time."""
    opened = []

    def open_page(link):
        page = browser_process.Browser(tmp_path / 'profile', 720, 480)
        opened.append(page)
        page.visit(f'http://127.0.0.1:{link.port}')
        assert wait_until(lambda: page.banner() == 'healthy', PATIENCE), page.text()
        assert wait_until(lambda: page.evaluate('Boolean(window.__viserSceneTree)'), PATIENCE)
        page.evaluate(WATCH)
        assert wait_until(lambda: is_in_time(page), PATIENCE), page.evaluate('samples.slice(-5)')
        return page

    yield open_page
    for page in opened:
        page.close()


def is_in_time(page):
    """Return whether the latest samples are neither late nor covered."""
    latest = page.evaluate('samples.slice(-20)')
    return len(latest) == 20 and not any(late > 0.3 or covered for _, late, covered in latest)


def uncovered_for(samples):
    """Return the longest time for which a pose that is too late was not covered, s."""
    longest = 0.0
    since = None
    for now, late, is_covered in samples:
        if late <= LATEST or is_covered:
            since = None
            continue
        since = now if since is None else since
        longest = max(longest, now - since)
    return longest


@pytest.mark.process
@pytest.mark.alone
@pytest.mark.skipif(browser_process.browser() is None, reason='no Chromium is installed')
@pytest.mark.parametrize(
    ('rate', 'has_queue'),
    [
        pytest.param(25_000.0, False, id='200 kbit/s'),
        pytest.param(50_000.0, False, id='400 kbit/s', marks=pytest.mark.evidence),
        pytest.param(40_000.0, True, id='a relay of 40 kB/s with a queue'),
    ],
)
def test_a_pose_that_is_half_a_second_late_is_covered_within_a_second(
    sender,
    watched,
    rate,
    has_queue,
):
    """And not longer than it is late: afterwards the page is as before."""
    link = SlowLink(sender.page.server.get_port(), has_queue)
    try:
        page = watched(link)
        time.sleep(FAST_FOR)
        link.rate = rate
        time.sleep(SLOW_FOR)
        samples = page.evaluate('samples')
        link.rate = None
        assert uncovered_for(samples) < COVERED_WITHIN
        # The link is slow indeed: with a queue the picture is later and later.
        lates = [late for _, late, _ in samples]
        print(f'late by {max(lates):.1f} s at most, {np.median(lates):.2f} s in the middle')
        if has_queue:
            assert max(lates) > 2.0
            assert any(covered for *_, covered in samples)
        assert wait_until(lambda: is_in_time(page), PATIENCE), page.evaluate('samples.slice(-5)')
    finally:
        link.close()


def test_what_a_client_has_not_received_is_replaced_and_not_queued(sender):
    """A client that does not read for 3 s, and then does, gets the present, not 180 poses."""
    server = sender.page.server
    with client.connect(
        f'ws://127.0.0.1:{server.get_port()}',
        origin=f'http://127.0.0.1:{server.get_port()}',
        max_size=None,
        max_queue=1,
        subprotocols=[f'viser-v{viser.__version__}'],
        sock=small_socket(server.get_port()),
    ) as websocket:
        websocket.recv()
        time.sleep(3.0)
        begun = time.monotonic()
        clocks = []
        while time.monotonic() < begun + 0.5:
            clocks += clocks_of(websocket.recv())
    # Of the time in which it did not read there is what its own buffers have, and no more.
    late = [clock for clock in clocks if clock < time.time() - 1.0]
    assert len(late) < 60
    assert clocks[-1] > time.time() - 0.5


def small_socket(port):
    """Return a connection that receives little before it is read."""
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.connect(('127.0.0.1', port))
    return made


def clocks_of(window):
    """Return the times of the changes of the clock in a window of viser's messages."""
    size = int.from_bytes(window[8:16], 'little')
    content = msgspec.msgpack.decode(
        zstandard.ZstdDecompressor().decompress(window[16 : 16 + size])
    )
    return [
        float(message['updates']['text'])
        for message in content['messages']
        if message['type'] == 'SceneNodeUpdateMessage' and 'text' in message['updates']
    ]
