# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of all devices: which are on it, and what is there without any."""

import gc
from itertools import pairwise
import socket
import weakref

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.view.status import Light
from std_msgs.msg import String

pytest.importorskip('viser', reason='viser is not installed (extra view)')
mechanism_query = pytest.importorskip('spm_haptic_master.view.mechanism_query')
page_module = pytest.importorskip('spm_haptic_master.view.page')
view_node = pytest.importorskip('spm_haptic_master.view.node')


@pytest.fixture(autouse=True)
def collect_often(monkeypatch):
    """Have `view` give back soon what is no longer used."""
    monkeypatch.setattr(view_node, 'COLLECT_PERIOD', 0.5)


class Circle:
    """Refers to itself: only a collection finds that nobody uses it."""

    def __init__(self):
        self.itself = self


def test_what_is_no_longer_used_is_given_back(view):
    gc.disable()
    try:
        dropped = weakref.ref(Circle())
        assert dropped() is not None
        assert view.spin(lambda: dropped() is None)
    finally:
        gc.enable()


def test_a_calibration_is_on_the_page_while_its_program_runs(view, observer):
    """A killed program leaves no last word; its last one is not the present."""
    out = observer.node.create_publisher(String, f'/left/{COVERAGE_TOPIC}', STATE)
    out.publish(String(
        data='{"text": "turn it", "covered": {"precision": 0.4, "tilt": NaN, "turn": 0.9}}'))
    view._server.get_clients = lambda: {0: None}

    def shown():
        return view._page.content.get('left', {}).get('calibration')

    assert view.spin(lambda: '/left' in view._arms)
    made_scenes(view)
    assert view.spin(shown)
    assert shown() == {'text': 'turn it', 'covered': [
        ('precision', 0.4, Light.AMBER.value), ('turn', 0.9, Light.GREEN.value)]}
    # Words of another program are none.
    out.publish(String(data='[1]'))
    out.publish(String(data='turn'))
    assert not view.spin(lambda: shown() is None, 0.2)
    observer.node.destroy_publisher(out)
    assert view.spin(lambda: shown() is None)


@pytest.mark.parametrize('arms', [1, 8])
def test_all_arms_are_in_each_view(view, observer, arms):
    """Of which `front` is the first picture, on a page a fifth wider than high."""
    kept = []
    for number in range(arms):
        kept += [observer.node.create_publisher(kind, f'/arm{number}/{topic}', 1)
                 for kind, topic in ((JointState, 'joint_states'), (String, 'state'))]
    assert view.spin(lambda: len(view._arms) == arms)
    places = [arm._scene._root.position for arm in made_scenes(view)]
    camera, views = view._server.initial_camera, view._page.views
    np.testing.assert_allclose((camera.position, camera.look_at), views['front'])
    assert camera.fov == page_module.VIEW_ANGLE
    half = np.tan(0.5 * camera.fov)
    for name, at in (('front', (0.0, -1.0, 0.0)), ('side', (1.0, 0.0, 0.0)),
                     ('top', (0.0, 0.0, 1.0))):
        position, target = map(np.array, views[name])
        ahead = (target - position) / np.linalg.norm(target - position)
        assert ahead @ at < -0.8
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        for place in places:
            for side in (-1.0, 1.0):
                point = place + [side, 0.0, 0.7] - position
                depth = point @ ahead
                assert abs(point @ right) / depth < 1.2 * half
                assert abs(point @ np.cross(right, ahead)) / depth < half
    # The bases do not stand in each other: each is 1 in radius.
    assert all(np.linalg.norm(here - there) > 2.2
               for here, there in pairwise(places))


def made_scenes(view):
    """Return the arms of a page with their mechanism drawn."""
    for arm in view._arms.values():
        arm._query.take(complete(mechanism_query.SETTINGS, {}))
    return view._arms.values()


def listening(port):
    """Return a socket that has a port."""
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.bind(('127.0.0.1', port))
    made.listen()
    return made


def test_the_next_free_port_is_taken_and_none_beyond_the_last():
    with listening(28580):
        assert page_module.free_port('127.0.0.1', 28580) == 28581
    assert page_module.free_port('127.0.0.1', 28580) == 28580
    with listening(65535), pytest.raises(InputError, match="'view.port' is 65535; expected a po"):
        page_module.free_port('127.0.0.1', 65535)
    with pytest.raises(InputError, match="'view.host' is '192.0.2.1'; expected an address of thi"):
        page_module.free_port('192.0.2.1', 28580)


def test_a_page_without_a_device_says_so(view, observer):
    """It knows that the program is alive, too; the words go when there is a device."""
    buffer = view._server._websock_server.get_message_buffer()

    def news():
        """Return the news that a page to come would have, by their number; one is its script."""
        scripts = {number: message.source for number, message in buffer.message_from_id.items()
                   if isinstance(message, page_module.RunJavascriptMessage)}
        news = {number: source for number, source in scripts.items()
                if source.startswith(page_module.NEWS)}
        assert len(scripts) == len(news) + 1 and min(scripts) not in news
        return news

    first = news()
    assert 'no device found' in ''.join(first.values())
    assert view.spin(lambda: not first.keys() & news().keys())
    # Not one more for each second that it runs.
    assert len(news()) == 1
    kept = [observer.node.create_publisher(kind, f'/left/{topic}', 1)
            for kind, topic in ((JointState, 'joint_states'), (String, 'state'))]
    assert view.spin(lambda: view._arms)
    assert view.spin(lambda: [(name, banner.text) for name, banner in view._page.shown.items()]
                     == [('left', 'waiting for fkm')])
    assert 'left: waiting for fkm' in ''.join(news().values())
    assert len(kept) == 2
