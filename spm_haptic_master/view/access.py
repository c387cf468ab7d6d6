# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Access to the page: requests of its own origin alone, and two kinds of messages.

A browser sends any page's requests to this host. They are refused before the upgrade to a
websocket: another page has another Origin, and a foreign name that resolves to this host (DNS
rebinding) is not a name of the page.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
import ipaddress
import re
import socket
from typing import Any

import msgspec
from spm_haptic_master.exceptions import SpmError
from websockets.asyncio import server as websocket_server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

# Names that no DNS resolves: a request with them comes from this host, or through a tunnel.
LOOPBACK = ('localhost', '127.0.0.1', '[::1]')
# A host with or without a port, as a request has it.
HOST = re.compile(r'(\[[0-9a-f:.]+\]|[^][:/@\s]+)(?::\d{1,5})?')
# Longest quotation of a header (characters).
QUOTED = 80
# Size of the longest message of a client (byte): the pose of its camera takes some 500.
LONGEST_MESSAGE = 65536


def own_names(host: str, further: str) -> frozenset[str]:
    """Return the names of a page at a host address, with further ones separated by commas."""
    names = {*LOOPBACK, _in_url(host), *(_in_url(name.strip()) for name in further.split(','))}
    if not _is_loopback(host):
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
        return (f'Host {_quoted(hosts)} is not a name of this page; '
                '-p view.hosts:=NAME allows one more')
    if origins and (len(origins) > 1 or origins[0].lower() not in (
            f'http://{host}', f'https://{host}')):
        return f'Origin {_quoted(origins)} is another page than {host}'
    return ''


def is_wanted(message: str | bytes) -> bool:
    """Return whether a client's message is passed on: its camera, or a control's value."""
    if not isinstance(message, bytes):
        return False
    try:
        found = msgspec.msgpack.decode(message)
        return found['type'] == 'ViewerCameraMessage' or (
            found['type'] == 'GuiUpdateMessage' and list(found['updates']) == ['value'])
    except (msgspec.MsgspecError, ValueError, TypeError, KeyError):
        return False


class GuardedConnection(websocket_server.ServerConnection):
    """A connection to a page with some names; `report` is called with the reason of a refusal."""

    def __init__(self, *args: Any, names: frozenset[str], report: Callable[[str], None],
                 **options: Any) -> None:
        super().__init__(*args, **options)
        self._names, self._report = names, report

    async def handshake(self, process_request: Any = None, *args: Any, **options: Any) -> None:
        """Answer the request, if it is one of the page's own."""
        def answer(connection: websocket_server.ServerConnection,
                   request: Request) -> Response | None:
            reason = refusal(request.headers,
                             self._names | {_in_url(str(self.local_address[0]))})
            if reason:
                self._report(reason)
                return self.respond(HTTPStatus.FORBIDDEN, f'{reason}\n')
            response: Response | None = process_request(connection, request)
            if response is not None:
                # No other page has this one in a frame, below its own buttons, to steal clicks;
                # and this page connects to no other server that a link names (?websocket=).
                host = request.headers['Host']
                response.headers['Content-Security-Policy'] = (
                    f"frame-ancestors 'none'; connect-src http://{host} https://{host} "
                    f'ws://{host} wss://{host} data: blob:')
            return response

        await super().handshake(answer, *args, **options)

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next message that is passed on."""
        while not is_wanted(message := await super().recv(decode)):
            pass
        return message


@contextmanager
def guarded(host: str, further: str, report: Callable[[str], None]) -> Iterator[None]:
    """
    Make the server that viser creates in this context refuse requests of other pages.

    viser has no option for that; websockets has `create_connection`. `report` is called in the
    server's thread. SpmError: no server was created in this way, so that it would be open.
    """
    serve, served = websocket_server.serve, []

    def serve_guarded(*args: Any, **options: Any) -> Any:
        served.append(True)
        return serve(*args, **{
            **options, 'max_size': LONGEST_MESSAGE, 'create_connection': partial(
                GuardedConnection, names=own_names(host, further), report=report)})

    websocket_server.serve = serve_guarded
    try:
        yield
    finally:
        websocket_server.serve = serve
    if not served:
        raise SpmError('this version of viser makes a server that cannot be guarded')


def _in_url(host: str) -> str:
    """Return a name or address as a URL has it."""
    host = host.lower().partition('%')[0]
    return f'[{host}]' if ':' in host and not host.startswith('[') else host


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == 'localhost'


def _quoted(values: list[str]) -> str:
    return repr(', '.join(values)[:QUOTED])
