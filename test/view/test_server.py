# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Requests and messages to the page as an attacker sends them."""

from http.client import HTTPConnection
import socket

import msgspec
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, STEER_TOPIC
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.view import node as view_node
from spm_haptic_master.view import server as server_module
from std_msgs.msg import Float64MultiArray, String
import viser
from websockets.sync import client

PATIENCE = 20.0
UPGRADE = (
    'Upgrade: websocket',
    'Connection: Upgrade',
    'Sec-WebSocket-Version: 13',
    'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==',
    f'Sec-WebSocket-Protocol: viser-v{viser.__version__}',
)
UPGRADED = 101
SERVED = 200
REFUSED = 403
# A camera as a page sends it when it is open.
CAMERA = {
    'type': 'ViewerCameraMessage',
    'wxyz': (1.0, 0.0, 0.0, 0.0),
    'position': (0.0, 0.0, 1.0),
    'fov': 0.7,
    'near': 0.01,
    'far': 100.0,
    'image_height': 100,
    'image_width': 100,
    'look_at': (0.0, 0.0, 0.0),
    'up_direction': (0.0, 0.0, 1.0),
}


def ask(
    server,
    *headers,
    host='127.0.0.1',
    path='/',
):
    """Send a request with some headers and return the answer; `PORT` in them is the server's."""
    connection = HTTPConnection(host, server.get_port(), timeout=PATIENCE)
    connection.putrequest('GET', path, skip_host=True, skip_accept_encoding=True)
    for header in headers:
        name, _, value = header.replace('PORT', str(server.get_port())).partition(': ')
        connection.putheader(name, value)
    connection.endheaders()
    return connection.getresponse()


OWN = 'Host: 127.0.0.1:PORT'


@pytest.mark.parametrize(
    ('headers', 'allowed'),
    [
        # The page itself, under each of its names, and through a tunnel from another port.
        ((OWN, 'Origin: http://127.0.0.1:PORT'), True),
        (('Host: LOCALHOST:PORT', 'Origin: http://localhost:PORT'), True),
        (('Host: 127.0.0.1:9000', 'Origin: http://127.0.0.1:9000'), True),
        (('Host: localhost', 'Origin: https://localhost'), True),
        # A program that is no browser.
        ((OWN,), True),
        # Another page, of another host, port or scheme, or of none.
        ((OWN, 'Origin: http://evil.example'), False),
        ((OWN, 'Origin: http://127.0.0.1:9000'), False),
        ((OWN, 'Origin: http://localhost:PORT'), False),
        ((OWN, 'Origin: http://127.0.0.1:PORT.evil.example'), False),
        ((OWN, 'Origin: null'), False),
        ((OWN, 'Origin: http://127.0.0.1:PORT', 'Origin: http://evil.example'), False),
        (('Host: 127.0.0.1', 'Origin: http://127.0.0.1:PORT'), False),
        # DNS rebinding: the page and its host are one, and the name is the attacker's.
        (('Host: evil.example:PORT', 'Origin: http://evil.example:PORT'), False),
        (('Host: 127.0.0.1.evil.example:PORT',), False),
        (('Host: 127.0.0.1@evil.example:PORT',), False),
        (('Host: 192.0.2.1:PORT', 'Origin: http://192.0.2.1:PORT'), False),
        (('Host: 127.0.0.1:PORT, evil.example',), False),
        (('Host: evil.example', OWN), False),
        ((), False),
    ],
)
def test_only_the_page_itself_has_an_answer(
    serve,
    headers,
    allowed,
):
    """Before the upgrade to a websocket, and of what is served by HTTP, too."""
    for more, good in ((UPGRADE, UPGRADED), (('Accept: */*',), SERVED)):
        answer = ask(serve(), *headers, *more)
        assert answer.status == (good if allowed else REFUSED)
        assert allowed or b'<html' not in answer.read()


NAME = socket.gethostname().lower()


@pytest.mark.parametrize(
    ('server', 'client', 'hosts', 'good'),
    [
        # The name of this host, and the address that a client connects to, for a page on the
        # network.
        (('0.0.0.0',), '127.0.0.2', (NAME, f'{NAME}.local', '127.0.0.2'), UPGRADED),
        (('0.0.0.0',), '127.0.0.2', ('127.0.0.3', '0.0.0.0', 'evil.example'), REFUSED),
        (('127.0.0.1', 'Rig.lan, fd00::5'), '127.0.0.1', ('rig.lan', '[fd00::5]'), UPGRADED),
        (('127.0.0.1', 'Rig.lan, fd00::5'), '127.0.0.1', ('lan', 'fd00::5', '[fd00::6]'), REFUSED),
        # The name of this host is none of a page for this host alone.
        (('127.0.0.1',), '127.0.0.1', (f'{NAME}.local',), REFUSED),
    ],
)
def test_the_names_of_a_page(
    serve,
    server,
    client,
    hosts,
    good,
):
    for host in hosts:
        assert (
            ask(
                serve(*server),
                f'Host: {host}:PORT',
                f'Origin: http://{host}:PORT',
                *UPGRADE,
                host=client,
            ).status
            == good
        )


def test_no_other_page_has_it_in_a_frame_and_it_connects_to_nobody_else(serve):
    """A link with ?websocket= would have the attacker's server run scripts of this origin."""
    server = serve()
    policy = ask(server, OWN, path='/?websocket=ws://evil.example').getheader(
        'Content-Security-Policy'
    )
    assert "frame-ancestors 'none'" in policy
    sources = policy.partition('connect-src ')[2].split()
    own = f'127.0.0.1:{server.get_port()}'
    assert sources == [
        f'http://{own}',
        f'https://{own}',
        f'ws://{own}',
        f'wss://{own}',
        'data:',
        'blob:',
    ]


def test_a_server_that_cannot_be_guarded_is_none(monkeypatch):
    monkeypatch.setattr(server_module, 'ViserServer', lambda **_: None)
    with pytest.raises(SpmError, match='cannot be guarded'):
        server_module.serve('127.0.0.1', 28820, '', print)


def test_a_page_operates_a_simulated_device_and_no_other(observer, view):
    """Nor does it make fkm compute its covariance; controls that were there are none."""
    *_, source = (
        observer.node.create_publisher(kind, topic, qos)
        for kind, topic, qos in (
            (JointState, '/joint_states', 1),
            (String, '/state', STATE),
            (String, '/source', STATE),
        )
    )
    steered = observer.collect(Float64MultiArray, f'/{STEER_TOPIC}')
    failed = observer.collect(String, f'/{FAULT_TOPIC}')
    source.publish(String(data='sim'))
    assert view.spin(lambda: view._arms and view._arms['/'].simulation.knobs is not None)
    simulation = view._arms['/'].simulation
    gui = view._server.gui
    known = [(uuid, handle.value) for uuid, handle in gui._gui_input_handle_from_uuid.items()]
    with client.connect(
        view.url.replace('http', 'ws'),
        origin=view.url,
        max_size=None,
        subprotocols=[f'viser-v{viser.__version__}'],
    ) as websocket:

        def send(**message):
            websocket.send(msgspec.msgpack.encode(message))

        def operate(handles):
            """Move every slider, press every button and change every other control."""
            for uuid, value in handles:
                changed = {bool: not value, float: 0.5, int: 1}.get(type(value), value)
                send(
                    type='GuiUpdateMessage',
                    uuid=uuid,
                    updates={'value': changed},
                )

        # What is not passed on, first: it changes nothing, and ends nothing.
        websocket.send(b'\xc1')
        sensor = simulation.sensor
        send(
            type='GuiUpdateMessage',
            uuid=sensor._impl.uuid,
            updates={'value': 'th1A', 'disabled': True},
        )
        send(**CAMERA)
        operate(known)
        assert view.spin(lambda: steered and failed)
        assert sensor.value == 'th1B'
        assert not sensor.disabled

        source.publish(String(data='can: can0'))
        assert view.spin(lambda: simulation.knobs is None)
        assert not gui._gui_input_handle_from_uuid
        view.spin(lambda: False, 0.2)
        steered.clear()
        failed.clear()
        operate(known)
        operate((uuid, True) for uuid in gui._container_handle_from_uuid)
        view.spin(lambda: False, 0.5)
        assert not steered
        assert not failed
        assert observer.node.count_subscribers('/pose_with_covariance') == 0


@pytest.mark.parametrize(
    ('message', 'wanted'),
    [
        (CAMERA, True),
        ({'type': 'GuiUpdateMessage', 'uuid': '1', 'updates': {'value': 7}}, True),
        # No tunnel to the world, no command, no file, no other property than a value.
        ({'type': 'ShareUrlRequest'}, False),
        ({'type': 'CommandTriggerMessage', 'uuid': '1'}, False),
        (
            {
                'type': 'FileTransferStartUpload',
                'source_component_uuid': '1',
                'transfer_uuid': '2',
                'filename': 'x',
                'mime_type': 'y',
                'part_count': 1,
                'size_bytes': 10**9,
            },
            False,
        ),
        *(
            ({'type': 'GuiUpdateMessage', 'uuid': '1', 'updates': updates}, False)
            for updates in ({'disabled': True}, {'value': 'joint_1a', 'update_cb': []}, {}, None)
        ),
        ({'updates': {'value': 7}}, False),
        ([1, 2], False),
        (b'', False),
        (b'\xc1', False),
        ('a text', False),
    ],
)
def test_of_a_clients_messages_two_kinds_are_passed_on(message, wanted):
    if isinstance(message, (bytes, str)):
        sent = message
    else:
        sent = msgspec.msgpack.encode(message)
    assert server_module.is_wanted(sent) is wanted


def test_a_refusal_is_in_the_log_with_its_reason_and_many_are_not(
    view,
    monkeypatch,
    caplog,
):
    caplog.set_level('INFO')
    logged = []
    monkeypatch.setattr(view_node.node_log, 'warning', lambda node, text: logged.append(text))
    for _ in range(20):
        ask(view._server, OWN, 'Origin: http://evil.example', *UPGRADE)
    assert 1 <= len(logged) < 10
    assert logged[0] == (
        "a request is refused: Origin 'http://evil.example' is another page than "
        f'127.0.0.1:{view._server.get_port()}'
    )
    assert not caplog.records
