# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Child processes of a measurement or a test, on a DDS domain and a CAN bus of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
import json
import os
from pathlib import Path
import signal
import socket
import subprocess
import sys
import tempfile
import time
from typing import IO

from spm_haptic_master.ros import runner

# DDS domains to choose from: their ports are below the ephemeral ports of Linux, and domain 0 is
# the default one of every other program.
DOMAINS = range(1, 102)
# Lowest UDP port of the simulated CAN buses, one for each domain: a socket on Linux receives the
# datagrams of every multicast group on its port.
FIRST_BUS_PORT = 20_000
# Time between two evaluations of a condition that is waited for (s).
POLL_PERIOD = 0.05
# Time that a program gets to end after a signal (s).
STOP_TIMEOUT = 15.0


@cache
def _domain() -> tuple[int, socket.socket]:
    """Return this process's DDS domain, and the socket that reserves it until the process ends."""
    # An abstract Unix socket is unique within a network namespace, as DDS and multicast on
    # localhost are. A run begins at another domain than the last one.
    first = os.getpid() % len(DOMAINS)
    for domain in (*DOMAINS[first:], *DOMAINS[:first]):
        if os.environ.get('ROS_DOMAIN_ID') == str(domain):
            continue  # that of other nodes of this user, or of the parent process
        reservation = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            reservation.bind(f'\0spm_haptic_master/domain/{domain}')
        except OSError:
            reservation.close()
        else:
            return domain, reservation
    raise RuntimeError(
        f'all DDS domains from {DOMAINS[0]} to {DOMAINS[-1]} are reserved by other '
        'runs on this host'
    )


def private_environment() -> dict[str, str]:
    """
    Return this process's environment with a DDS domain and a CAN bus port of its own.

    They differ from those of other processes on the host. RuntimeError: all are reserved.
    """
    domain, _ = _domain()
    local = {**os.environ, runner.RANGE: 'LOCALHOST'}
    return {
        **local,
        **runner.dds_profile(local),
        'ROS_DOMAIN_ID': str(domain),
        'CAN_CONFIG': json.dumps({'port': FIRST_BUS_PORT + domain}),
        'PYTHONUNBUFFERED': '1',
    }


def bus_channel() -> str:
    """Return the channel of this process's own CAN bus, of python-can's udp_multicast."""
    domain, _ = _domain()
    return f'239.74.0.{domain}'


def executable(name: str, *args: str, parameters: Mapping[str, object] | None = None) -> list[str]:
    """Return the command line of an executable of the package, with ROS parameters by name."""
    given = ['--ros-args', *parameter_arguments(parameters)] if parameters else []
    return [sys.executable, '-m', 'spm_haptic_master', name, *args, *given]


def parameter_arguments(parameters: Mapping[str, object]) -> list[str]:
    """Return `-p name:=value` of each parameter."""
    return [
        word
        for name, value in parameters.items()
        for word in ('-p', f'{name}:={str(value).lower() if isinstance(value, bool) else value}')
    ]


def wait_until(condition: Callable[[], object], seconds: float) -> bool:
    """Evaluate a condition until it holds; False if it did not within that time, s."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(POLL_PERIOD)
    return True


class Program:
    """
    A child process; what it prints is kept in files without a name.

    A `with` block stops it at its end. `environment` is `private_environment()` by default;
    `error_to` is a file descriptor for its standard error.
    """

    def __init__(
        self,
        command: Sequence[str],
        *,
        environment: Mapping[str, str] | None = None,
        directory: Path | None = None,
        new_session: bool = False,
        error_to: int | None = None,
    ):
        self.command = tuple(command)
        self._out, self._err = tempfile.TemporaryFile(), tempfile.TemporaryFile()
        self._process = process = subprocess.Popen(
            self.command,
            cwd=directory,
            stdin=subprocess.DEVNULL,
            stdout=self._out,
            stderr=self._err if error_to is None else error_to,
            start_new_session=new_session,
            env=private_environment() if environment is None else environment,
        )
        self.pid, self.poll, self.send_signal = process.pid, process.poll, process.send_signal

    def __enter__(self) -> Program:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def stdout(self) -> str:
        """Return the standard output so far."""
        return _content(self._out)

    @property
    def stderr(self) -> str:
        """Return the standard error so far."""
        return _content(self._err)

    def kill(self) -> None:
        """End it at once, by SIGKILL."""
        self._process.kill()
        self._process.wait()

    def stop(self, number: int = signal.SIGTERM, timeout: float = STOP_TIMEOUT) -> int:
        """Send a signal if it still runs, and `wait`."""
        self.send_signal(number)
        return self.wait(timeout)

    def wait(self, timeout: float = STOP_TIMEOUT) -> int:
        """Return the exit code; TimeoutError if it did not end in time, s, and was killed."""
        try:
            return self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            self.kill()
            raise TimeoutError(
                f'{" ".join(self.command)}: did not end within {timeout:g} s and was killed'
            ) from None


def _content(file: IO[bytes]) -> str:
    # The child writes at an offset that both processes share: reading must not move it.
    size = os.fstat(file.fileno()).st_size
    return os.pread(file.fileno(), size, 0).decode(errors='replace')
