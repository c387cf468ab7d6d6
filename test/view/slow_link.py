# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A relay between a browser and the page: as fast as it can, or slow, with or without a queue."""

from queue import Queue
import socket
from threading import Thread
import time

# Bytes that are passed on at once, and size of the sockets' own buffers without a queue.
PIECE = 1024
SMALL = 4096


class SlowLink:
    """
    Relays every connection to a port of this host; `rate` is in bytes a second, None: no limit.

    With a queue it reads all that comes, as `ssh -L` does: whoever sends does not notice that the
    link is slow. Without one the sender has to wait.
    """

    def __init__(self, port: int, has_queue: bool) -> None:
        self._port = port
        self._has_queue = has_queue
        self._connections: list[socket.socket] = []
        self.rate: float | None = None
        self._listener = socket.create_server(('127.0.0.1', 0))
        self.port = self._listener.getsockname()[1]
        Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """Take no further connections, and end those there are: nobody waits for the other end."""
        self._listener.close()
        for each in self._connections:
            each.close()

    def _accept(self) -> None:
        while True:
            try:
                browser, _ = self._listener.accept()
            except OSError:
                return
            server = socket.socket()
            if not self._has_queue:
                server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL)
                browser.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SMALL)
            self._connections += [browser, server]
            server.connect(('127.0.0.1', self._port))
            queue: Queue[bytes] = Queue(maxsize=0 if self._has_queue else 1)
            for work, ends in (
                (self._pass_on, (browser, server)),
                (self._read, (server, queue)),
                (self._write, (browser, queue)),
            ):
                Thread(target=work, args=ends, daemon=True).start()

    def _pass_on(
        self,
        browser: socket.socket,
        server: socket.socket,
    ) -> None:
        """Pass on what the browser sends."""
        try:
            while data := browser.recv(65536):
                server.sendall(data)
            server.shutdown(socket.SHUT_WR)
        except OSError:
            pass

    def _read(self, server: socket.socket, queue: 'Queue[bytes]') -> None:
        """Read what the server sends."""
        try:
            while data := server.recv(PIECE):
                queue.put(data)
        except OSError:
            pass
        queue.put(b'')

    def _write(self, browser: socket.socket, queue: 'Queue[bytes]') -> None:
        """Pass it on at the rate."""
        try:
            while data := queue.get():
                if self.rate is not None:
                    time.sleep(len(data) / self.rate)
                browser.sendall(data)
            browser.shutdown(socket.SHUT_WR)
        except OSError:
            pass
