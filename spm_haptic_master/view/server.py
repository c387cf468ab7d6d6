# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The server of the page, which answers requests of its own origin and takes two kinds of messages.

A browser sends any page's requests to this host. They are refused before the upgrade to a
websocket: another page has another Origin, and a foreign name that resolves to this host (DNS
rebinding) is not a name of the page.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import redirect_stdout
import errno
from http import HTTPStatus
from io import StringIO
import ipaddress
import logging
import re
import socket
from typing import Any

import msgspec
from spm_haptic_master.exceptions import InputError, SpmError
from viser import ViserServer
from websockets.asyncio import server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

# Names that no DNS resolves: a request with them comes from this host, or through a tunnel.
LOOPBACK = 'localhost', '127.0.0.1', '[::1]'
# A host with or without a port, as a request has it.
HOST = re.compile(r'(\[[0-9a-f:.]+\]|[^][:/@\s]+)(?::\d{1,5})?')
# Longest quotation of a header (characters).
QUOTED = 80
# Size of the longest message of a client (byte): the pose of its camera takes some 500.
LONGEST_MESSAGE = 65536
# Light from everywhere (unit 1).
AMBIENT = 0.8
# Field of view, from top to bottom (rad).
VIEW_ANGLE = 0.75


def own_names(host: str, further: str) -> frozenset[str]:
    """Return the names of a page at a host address, with further ones separated by commas."""
    names = {*LOOPBACK, in_url(host), *(in_url(name.strip()) for name in further.split(','))}
    try:
        is_local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        is_local = host.lower() == 'localhost'
    if not is_local:
        name = socket.gethostname().lower()
        names |= {name, f'{name}.local'}
    return frozenset(names - {'', '0.0.0.0', '[::]'})


def refusal(headers: Headers, names: frozenset[str]) -> str:
    """
    Return why a request to a page with these names is refused; empty if it is not.

    A browser sends an Origin with every websocket: a request without one is another program's.
    """
    hosts, origins = headers.get_all('Host'), headers.get_all('Origin')
    host = hosts[0].lower() if len(hosts) == 1 else ''
    match = HOST.fullmatch(host)
    if match is None or match[1] not in names:
        return (
            f'Host {_quoted(hosts)} is not a name of this page; '
            '-p view.hosts:=NAME allows one more'
        )
    if origins and [origin.lower() for origin in origins] not in (
        [f'http://{host}'],
        [f'https://{host}'],
    ):
        return f'Origin {_quoted(origins)} is another page than {host}'
    return ''


def is_wanted(message: str | bytes) -> bool:
    """Return whether a client's message is passed on: its camera, or a control's value."""
    if not isinstance(message, bytes):
        return False
    try:
        found = msgspec.msgpack.decode(message)
        return found['type'] == 'ViewerCameraMessage' or (
            found['type'] == 'GuiUpdateMessage' and list(found['updates']) == ['value']
        )
    except (msgspec.MsgspecError, ValueError, TypeError, KeyError):
        return False


class GuardedConnection(ServerConnection):
    """A connection that drops the messages that are not passed on."""

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next message that is passed on."""
        while not is_wanted(message := await super().recv(decode)):
            pass
        return message


def serve(host: str, port: int, names: str, report: Callable[[str], None]) -> ViserServer:
    """
    Return the server of the page at a host and a port, or the next free one.

    `names` are further names of the page, separated by commas; `report` is called, in the server's
    thread, with the reason of a refused request. InputError: the address cannot be used. SpmError:
    the server would not refuse anything.
    """
    # It logs each connection on standard error.
    logging.getLogger('websockets').setLevel(logging.CRITICAL)
    # viser would try ports without end, or beyond the last one.
    port = free_port(host, port)
    # viser passes no options to the server of websockets that it creates.
    unguarded, known, guards = websocket_server.serve, own_names(host, names), []

    def serve_guarded(*args: Any, process_request: Any, **options: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            reason = refusal(request.headers, known | {in_url(connection.local_address[0])})
            if reason:
                report(reason)
                return connection.respond(HTTPStatus.FORBIDDEN, f'{reason}\n')
            response: Response | None = process_request(connection, request)
            if response is not None:
                # No other page has this one in a frame, below its own buttons, to steal clicks;
                # and this page connects to no other server that a link names (?websocket=).
                host = request.headers['Host']
                response.headers['Content-Security-Policy'] = (
                    f"frame-ancestors 'none'; connect-src http://{host} https://{host} "
                    f'ws://{host} wss://{host} data: blob:'
                )
            return response

        guards.append(answer)
        return unguarded(
            *args,
            **options
            | {
                'process_request': answer,
                'max_size': LONGEST_MESSAGE,
                'create_connection': GuardedConnection,
            },
        )

    websocket_server.serve = serve_guarded
    try:
        # viser prints its address in a frame; `view` prints a line of its own.
        with redirect_stdout(StringIO()):
            server = ViserServer(host=host, port=port, label='haptic master', verbose=False)
    finally:
        websocket_server.serve = unguarded
    if not guards:
        raise SpmError('this version of viser makes a server that cannot be guarded')
    server.gui.configure_theme(control_width='large', show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction('+z')
    # Shadows take most of the time where no GPU draws them.
    server.scene.configure_default_lights(cast_shadow=False)
    # So do reflections of surroundings that are not there.
    server.scene.configure_environment_map(hdri=None)
    server.scene.add_light_ambient('/ambient', intensity=AMBIENT)
    server.initial_camera.fov = VIEW_ANGLE
    return server


def free_port(host: str, first: int) -> int:
    """Return the first free port of an address; InputError: there is none."""
    try:
        for port in range(first, 65536):
            try:
                for family, *_, address in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM):
                    socket.create_server(address, family=family).close()
                return port
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
    except OSError as error:
        raise InputError(
            f"parameter 'view.host' is {host!r}; expected an address of this host "
            f'({str(error.strerror).partition(" (while")[0]})'
        ) from error
    raise InputError(
        f"parameter 'view.port' is {first}; expected a port that is free, or has a "
        'free one after it'
    )


def in_url(host: str) -> str:
    """Return a name or address as a URL has it."""
    host = host.lower().partition('%')[0]
    return f'[{host}]' if ':' in host and not host.startswith('[') else host


def _quoted(values: list[str]) -> str:
    return repr(', '.join(values)[:QUOTED])
