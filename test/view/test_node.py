# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of all devices: which are on it, and what is there without any."""

import socket

from geometry_msgs.msg import QuaternionStamped
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.view.page import NEWS, place_of, RunJavascriptMessage, views
from spm_haptic_master.view.scene import ARM_DISTANCE
from spm_haptic_master.view.server import free_port, VIEW_ANGLE
from spm_haptic_master.view.settings_client import SETTINGS
from std_msgs.msg import String


def test_a_calibration_alone_is_a_device(view, observer):
    out = observer.node.create_publisher(String, f'/left/{COVERAGE_TOPIC}', STATE)
    out.publish(String(data='{"text": "turn it", "covered": {"precision": 0.4}}'))
    view._server.get_clients = lambda: {0: None}
    assert view.spin(lambda: view._page.content.get('left', {}).get('calibration'))
    assert list(view._page.shown) == ['left']


def extent(camera, at, points):
    """Return how far points are from the middle of a camera's picture, over half its height."""
    position, target = map(np.array, camera)
    ahead = (target - position) / np.linalg.norm(target - position)
    assert ahead @ at < -0.8
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    from_camera = points - position
    rays = from_camera / (from_camera @ ahead)[:, None]
    half = np.tan(0.5 * VIEW_ANGLE)
    return np.abs(rays @ right).max() / half, np.abs(rays @ up).max() / half


@pytest.mark.parametrize('arms', [1, 8])
@pytest.mark.parametrize(
    ('name', 'at'),
    [
        ('front', (0.0, -1.0, 0.0)),
        ('side', (1.0, 0.0, 0.0)),
        ('top', (0.0, 0.0, 1.0)),
    ],
)
def test_all_arms_are_in_each_view(arms, name, at):
    """On a page a fifth wider than high; a device is 1 in radius to each side."""
    last = ARM_DISTANCE * (arms - 1)
    points = np.array([[x, 0.0, 0.7] for x in (-1.0, 1.0, last - 1.0, last + 1.0)])
    wide, high = extent(views(arms)[name], at, points)
    assert wide < 1.2
    assert high < 1.0
    if name == 'front':
        # Nor are they smaller than that needs.
        assert wide > 0.65


def test_the_arms_are_apart():
    assert ARM_DISTANCE > 2.2


def test_the_next_free_port_is_taken_and_none_beyond_the_last():
    with socket.create_server(('127.0.0.1', 28580)):
        assert free_port('127.0.0.1', 28580) == 28581
    assert free_port('127.0.0.1', 28580) == 28580
    with (
        socket.create_server(('127.0.0.1', 65535)),
        pytest.raises(InputError, match="'view.port' is 65535; expected a port that is free"),
    ):
        free_port('127.0.0.1', 65535)
    with pytest.raises(InputError, match="'view.host' is '192.0.2.1'; expected an address of thi"):
        free_port('192.0.2.1', 28580)


def test_a_page_says_that_there_is_no_device_until_there_are_some(view, observer):
    """It knows that the program is alive, too; all devices are in its first picture."""
    buffer = view._server._websock_server.get_message_buffer()

    def news():
        """Return the news that a page to come would have, by their number; one is its script."""
        scripts = {
            number: message.source
            for number, message in buffer.message_from_id.items()
            if isinstance(message, RunJavascriptMessage)
        }
        news = {number: source for number, source in scripts.items() if source.startswith(NEWS)}
        assert len(scripts) == len(news) + 1
        assert min(scripts) not in news
        return news

    first = news()
    assert 'no device found' in ''.join(first.values())
    assert view.spin(lambda: not first.keys() & news().keys())
    # Not one more for each second that it runs.
    assert len(news()) == 1
    kept = [
        observer.node.create_publisher(kind, f'/{name}/{topic}', 1)
        for name in ('a', 'b')
        for kind, topic in ((JointState, 'joint_states'), (String, 'state'))
    ]
    assert view.spin(
        lambda: (
            {name: banner.text for name, banner in view._page.shown.items()}
            == dict.fromkeys('ab', 'waiting for fkm')
        )
    )
    assert 'a: waiting for fkm' in ''.join(news().values())
    camera = view._server.initial_camera
    np.testing.assert_allclose((camera.position, camera.look_at), views(2)['front'])
    for arm in view._arms.values():
        arm.build(complete(SETTINGS, {}))
    here, there = (view._arms[f'/{name}']._scene._fixed.position for name in 'ab')
    np.testing.assert_allclose(there - here, [ARM_DISTANCE, 0.0, 0.0])
    assert len(kept) == 4
    # It ends with the process that it goes with.
    assert not view.has_ended()
    view._process = 2**22 + 1
    assert view.spin(view.has_ended)


def test_a_device_without_diagnostics_is_found_and_another_robot_is_not(view, observer):
    """`fkm` and `encoder_driver` may run by themselves: the page says what else to start."""
    kept = [
        observer.node.create_publisher(String, '/device/state', STATE),
        observer.node.create_publisher(QuaternionStamped, '/device/orientation', 1),
        observer.node.create_publisher(String, '/robot/state', 1),
        observer.node.create_publisher(String, '/robot/orientation', 1),
    ]
    assert view.spin(lambda: list(view._page.shown) == ['device'])
    kept[0].publish(String(data='healthy'))
    expected = 'healthy, but no joint_states (start diagnostics)'
    assert view.spin(lambda: view._page.shown['device'].text == expected)
    assert list(view._arms) == ['/device']


@pytest.fixture(name='two_arms')
def show_two_arms(view, observer):
    """Have the view show a right arm, then a left one as well; return their publishers by name."""
    publishers = {}
    for name in ('right', 'left'):
        publishers[name] = [
            observer.node.create_publisher(kind, f'/{name}/{topic}', 1)
            for kind, topic in ((JointState, 'joint_states'), (String, 'state'))
        ]
        assert view.spin(lambda: len(view._page.shown) == len(publishers))
        view._arms[f'/{name}'].build(complete(SETTINGS, {}))
    return publishers


def place(view, name):
    """Return where an arm stands in the picture, m to the right."""
    return view._arms[f'/{name}']._scene._fixed.position[0]


def test_two_arms_stand_by_their_names_whichever_comes_first(view, two_arms):
    """The left one on the left, in the banners and the panel as in the picture."""
    assert list(two_arms) == ['right', 'left']
    assert (place(view, 'left'), place(view, 'right')) == (0.0, pytest.approx(ARM_DISTANCE))
    news = view._page.news()
    assert [device['name'] for device in news['devices']] == ['left', 'right']
    # The second one is in every view.
    assert news['views'] == views(2)
    folders = [view._arms[f'/{name}']._panel._folder.order for name in ('left', 'right')]
    assert folders == sorted(folders)


def test_an_arm_without_a_publisher_goes_while_another_one_runs(
    view,
    observer,
    two_arms,
    monkeypatch,
):
    """The last one stays."""
    monkeypatch.setattr('spm_haptic_master.view.arm.GONE_AFTER', 0.5)
    for publisher in two_arms['left']:
        observer.node.destroy_publisher(publisher)
    assert view.spin(lambda: list(view._page.shown) == ['right'])
    assert place(view, 'right') == 0.0
    assert view._page.news()['views'] == views(1)
    for publisher in two_arms['right']:
        observer.node.destroy_publisher(publisher)
    view.spin(lambda: False, 1.5)
    assert list(view._page.shown) == ['right']


def test_arms_without_these_names_stand_by_the_alphabet():
    names = ['b', 'right', '/x/left', 'a', '']
    assert sorted(names, key=place_of) == ['/x/left', '', 'a', 'b', 'right']
