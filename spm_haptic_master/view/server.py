# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The server of the page, which answers requests of its own origin and takes two kinds of messages.

A browser sends any page's requests to this host. They are refused before the upgrade to a
websocket: another page has another Origin, and a foreign name that resolves to this host (DNS
rebinding) is not a name of the page.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import redirect_stdout
import errno
import fcntl
from functools import partial
from http import HTTPStatus
from io import StringIO
import ipaddress
import logging
import re
import socket
import sys
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
# Last port of TCP.
LAST_PORT = 65535
# Request of Linux (linux/sockios.h) for the bytes of a socket that have not been sent, and the
# period of asking for it (s).
SIOCOUTQNSD = 0x894B
POLL_PERIOD = 0.005
# A server's answer to a request, as websockets asks for it.
Answer = Callable[[ServerConnection, Request], 'Response | None']
# The server of websockets as it is without a guard.
UNGUARDED_SERVE = websocket_server.serve


def own_names(host: str, further: str) -> frozenset[str]:
    """
    Return the names of a page at a host address, with further ones separated by commas.

    Parameters
    ----------
    host : str
        Address or name that the server is bound to.
    further : str
        Names that a user allows, separated by commas; empty: none.

    Returns
    -------
    frozenset of str
        Lower-case names as a URL has them. The names of this computer are among them unless the
        host is a loopback address.

    """
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

    Parameters
    ----------
    headers : Headers
        Headers of the request.
    names : frozenset of str
        Names of the page, as of `own_names`.

    Returns
    -------
    str
        Reason in one line, with what was given and, where that helps, the parameter to set.

    """
    hosts = headers.get_all('Host')
    origins = headers.get_all('Origin')
    if len(hosts) == 1:
        host = hosts[0].lower()
    else:
        host = ''
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
    """
    Return whether a client's message is passed on: its camera, or a control's value.

    Parameters
    ----------
    message : str or bytes
        A message of a browser: msgpack, as viser has it.

    Returns
    -------
    bool
        False as well for what cannot be decoded.

    """
    if not isinstance(message, bytes):
        return False
    try:
        found = msgspec.msgpack.decode(message)
        if found['type'] == 'GuiUpdateMessage':
            return list(found['updates']) == ['value']
        return bool(found['type'] == 'ViewerCameraMessage')
    except (msgspec.MsgspecError, ValueError, TypeError, KeyError):
        return False


class GuardedConnection(ServerConnection):
    """
    A connection that drops messages that are not passed on, and sends no faster than it can.

    What a client has not received yet waits with viser, which replaces an old pose by a new one,
    and not in a queue of this host, which would send each of them, later and later.
    """

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next message that is passed on."""
        while not is_wanted(message := await super().recv(decode)):
            pass
        return message

    async def send(
        self,
        message: Any,
        text: bool | None = None,
    ) -> None:
        """Send a message, and return when nothing of it waits on this host any more."""
        await super().send(message, text)
        while unsent_bytes(self.transport):
            await asyncio.sleep(POLL_PERIOD)


def unsent_bytes(transport: asyncio.Transport) -> int:
    """
    Return the number of bytes that wait on this host; 0 of a closed connection.

    Parameters
    ----------
    transport : asyncio.Transport
        Transport of a connection.

    Returns
    -------
    int
        Bytes in the transport's buffer, and in the socket's that have not been sent.

    """
    connection = transport.get_extra_info('socket')
    if transport.is_closing() or connection is None:
        return 0
    answer = bytearray(4)
    try:
        fcntl.ioctl(connection.fileno(), SIOCOUTQNSD, answer)
    except OSError:
        return 0
    return transport.get_write_buffer_size() + int.from_bytes(answer, sys.byteorder)


class Guard:
    """
    Answers the requests to a page by its names, and passes on those that it does not refuse.

    Parameters
    ----------
    names : frozenset of str
        Names of the page, as of `own_names`.
    report : callable
        Is called with the reason of a refused request.

    Attributes
    ----------
    is_used : bool
        Whether `serve` has been called.

    """

    def __init__(
        self,
        names: frozenset[str],
        report: Callable[[str], None],
    ) -> None:
        self._names = names
        self._report = report
        # Whether a server of viser has got the guard.
        self.is_used = False

    def serve(self, *args: Any, process_request: Answer, **options: Any) -> Any:
        """Create the server of websockets in viser's place, with its arguments."""
        self.is_used = True
        guarded = {
            'process_request': partial(self._answer, process_request),
            'max_size': LONGEST_MESSAGE,
            'create_connection': GuardedConnection,
        }
        return UNGUARDED_SERVE(*args, **options | guarded)

    def _answer(
        self,
        answer: Answer,
        connection: ServerConnection,
        request: Request,
    ) -> Response | None:
        """
        Return the answer to a request; None lets it become a websocket.

        Parameters
        ----------
        answer : callable
            viser's own answer to a request.
        connection : ServerConnection
            Connection of the request.
        request : Request
            The request, before the upgrade to a websocket.

        Returns
        -------
        Response or None
            403 with the reason of a refusal, or viser's answer with a policy for the browser.

        """
        own_address = in_url(connection.local_address[0])
        reason = refusal(request.headers, self._names | {own_address})
        if reason:
            self._report(reason)
            return connection.respond(HTTPStatus.FORBIDDEN, f'{reason}\n')
        response = answer(connection, request)
        if response is not None:
            response.headers['Content-Security-Policy'] = _policy(request.headers['Host'])
        return response


def _policy(host: str) -> str:
    """
    Return what a browser may do with the page of a host.

    No other page has this one in a frame, below its own buttons, to steal clicks; and this page
    connects to no other server that a link names (?websocket=).
    """
    return (
        f"frame-ancestors 'none'; connect-src http://{host} https://{host} "
        f'ws://{host} wss://{host} data: blob:'
    )


def serve(
    host: str,
    port: int,
    names: str,
    report: Callable[[str], None],
) -> ViserServer:
    """
    Return the server of the page.

    Parameters
    ----------
    host, port : str, int
        its address; if the port is not free, the next one that is
    names : str
        further names of the page, separated by commas
    report : callable
        is called, in the server's thread, with the reason of a refused request

    Raises
    ------
    InputError
        the address cannot be used
    SpmError
        the server would not refuse anything

    """
    # It logs each connection on standard error.
    logging.getLogger('websockets').setLevel(logging.CRITICAL)
    # viser would try ports without end, or beyond the last one.
    port = free_port(host, port)
    guard = Guard(own_names(host, names), report)
    # viser passes no options to the server of websockets that it creates.
    websocket_server.serve = guard.serve
    try:
        # viser prints its address in a frame; `view` prints a line of its own.
        with redirect_stdout(StringIO()):
            server = ViserServer(
                host=host,
                port=port,
                label='haptic master',
                verbose=False,
            )
    finally:
        websocket_server.serve = UNGUARDED_SERVE
    if not guard.is_used:
        raise SpmError('this version of viser makes a server that cannot be guarded')
    _light(server)
    return server


def _light(server: ViserServer) -> None:
    """Set up panel, light and camera of a server."""
    server.gui.configure_theme(control_width='large', show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction('+z')
    # Shadows take most of the time where no GPU draws them.
    server.scene.configure_default_lights(cast_shadow=False)
    # So do reflections of surroundings that are not there.
    server.scene.configure_environment_map(hdri=None)
    server.scene.add_light_ambient('/ambient', intensity=AMBIENT)
    server.initial_camera.fov = VIEW_ANGLE


def free_port(host: str, first: int) -> int:
    """
    Return the first free port of an address.

    Parameters
    ----------
    host : str
        Address or name of this host.
    first : int
        Port with which the search begins; it ends with the last port of TCP.

    Returns
    -------
    int
        Port that is free on all addresses of the host.

    Raises
    ------
    InputError
        No port is free, or the address is not one of this host.

    """
    try:
        for port in range(first, LAST_PORT + 1):
            if _is_free(host, port):
                return port
    except OSError as error:
        raise InputError(
            f"parameter 'view.host' is {host!r}; expected an address of this host "
            f'({str(error.strerror).partition(" (while")[0]})'
        ) from error
    raise InputError(
        f"parameter 'view.port' is {first}; expected a port that is free, or has a "
        'free one after it'
    )


def _is_free(host: str, port: int) -> bool:
    """
    Return whether a port of all addresses of a host is free.

    Raises
    ------
    OSError
        The addresses cannot be used, for another reason than that the port is taken.

    """
    try:
        for family, *_, address in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM):
            socket.create_server(address, family=family).close()
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        return False
    return True


def in_url(host: str) -> str:
    """
    Return a name or address as a URL has it.

    Parameters
    ----------
    host : str
        Name or address, IPv6 with or without brackets.

    Returns
    -------
    str
        In lower case, IPv6 in brackets and without a zone.

    """
    host = host.lower().partition('%')[0]
    if ':' in host and not host.startswith('['):
        return f'[{host}]'
    return host


def _quoted(values: list[str]) -> str:
    """Return the values of a header for a line of the log."""
    return repr(', '.join(values)[:QUOTED])
