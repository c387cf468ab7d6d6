# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What disturbs a soak: a bus that fails, subscribers that come and go."""

from __future__ import annotations

from dataclasses import dataclass
import json
from pathlib import Path
import re
import signal
import socket
import tempfile
import time

from benchmarks.pipeline.child_process import (
    bus_channel,
    executable,
    private_environment,
    Program,
    wait_until,
)
from benchmarks.pipeline.measured_process import READY
from benchmarks.pipeline.run import PipelineError, start_process

# Time between two packets that are no CAN frame (s).
GARBAGE_PERIOD = 0.3
# Time for the simulated encoders to start (s).
START_TIMEOUT = 30.0
# Subscriber of all outputs that comes and goes, and the end of every other one: an orderly end,
# and one after which the middleware has to find out by itself.
VISITOR, VISITOR_ENDS = 'observer_of_all', (signal.SIGINT, signal.SIGKILL)
# Line of `sim_bus` on the beginning or the end of a bus-off, with its time (s).
_BUS_OFF = re.compile(r'^([\d.]+) busoff@\S+ (begins|ends)$', re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Schedule:
    """Times of a soak, s."""

    minute: float = 60.0  # length of a minute
    failure_period: float = 300.0  # from one failure of the bus to the next
    failure: float = 5.0  # length of one: longer than the driver waits before it reopens the bus
    visit_period: float = 30.0  # from the start of one visitor to the next
    visit: float = 15.0  # that each stays


class FailingBus:
    """
    Four simulated encoders, at a rate of SYNC in Hz, on a bus that fails again and again.

    Every other failure is a bus-off. In the others the encoders lose their power and boot again,
    and what comes meanwhile is no CAN frame: whoever reads the bus gets an error. `alive` are the
    times from which and until which the bus was alive, s since the Unix epoch.
    """

    def __init__(self, rate: float, schedule: Schedule) -> None:
        self.alive: list[tuple[float, float]] = []
        self._command = executable(
            'sim_bus',
            '--sync',
            '--fault',
            f'busoff@{schedule.failure_period:g}+{schedule.failure:g}',
            '-p',
            'can.interface:=udp_multicast',
            '-p',
            f'can.channel:={bus_channel()}',
            '-p',
            f'rate:={rate:g}',
        )
        self._schedule = schedule
        self._program: Program | None = None
        self._started = self._ended = self._garbage_at = 0.0

    def start(self) -> None:
        """Switch the encoders on and wait until they have booted."""
        self._program = Program(self._command, environment=private_environment())
        if not wait_until(lambda: 'four encoders' in self._output, START_TIMEOUT):
            raise PipelineError(f'sim_bus did not start: {self._program.stderr}')
        self._started = time.time()

    def tend(self) -> None:
        """Switch the encoders off or on, if that is due."""
        now = time.time()
        if self._program is None:
            if now - self._ended >= self._schedule.failure:
                self.start()
            elif now >= self._garbage_at:
                self._garbage_at = now + GARBAGE_PERIOD
                _send_garbage()
        elif self._program.poll() is not None:
            raise PipelineError(f'sim_bus ended by itself: {self._program.stderr}')
        elif now - self._started >= 2.0 * self._schedule.failure_period:
            self.stop()

    def stop(self) -> None:
        """Switch the encoders off, and note when they were alive."""
        if self._program is not None:
            self.alive += self._alive_until(time.time())
            self._program.kill()
            self._ended = time.time()
            self._program = None

    @property
    def alive_since(self) -> float | None:
        """Time since which the bus is alive, s since the Unix epoch; None while it is not."""
        if self._program is None:
            return None
        since, until = self._alive_until(float('inf'))[-1]
        return since if until == float('inf') else None

    @property
    def _output(self) -> str:
        return '' if self._program is None else self._program.stdout

    def _alive_until(self, end: float) -> list[tuple[float, float]]:
        """Return from when until when the encoders that run now were alive."""
        found, since = [], self._started
        for at, event in _BUS_OFF.findall(self._output):
            if event == 'begins':
                found.append((since, float(at)))
                since = float('inf')
            else:
                since = float(at)
        return [*found, (since, end)] if since < end else found


def _send_garbage() -> None:
    """Send a packet that is no CAN frame to the bus of this process."""
    port = json.loads(private_environment()['CAN_CONFIG'])['port']
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b'no frame', (bus_channel(), port))


class Visitors:
    """
    Subscribers that come and go.

    `came` have left; of these `without` received no orientation although the bus was alive all the
    time, and `stuck` did not end by themselves after Ctrl-C.
    """

    def __init__(self, schedule: Schedule) -> None:
        self._schedule = schedule
        self.came = self.without = self.stuck = 0
        self._directory = tempfile.TemporaryDirectory(prefix='visitor_')
        self._program: Program | None = None
        self._began = self._next = time.time()

    def tend(self, alive_since: float | None) -> None:
        """Start or end a visitor, if that is due, on a bus alive since then, s, or not alive."""
        now = time.time()
        if self._program is None:
            if now >= self._next:
                self._program = start_process(VISITOR, Path(self._directory.name), {})
                self._began, self._next = now, now + self._schedule.visit_period
        elif now - self._began >= self._schedule.visit:
            alive = alive_since is not None and alive_since < self._began
            self.without += alive and READY not in self._program.stdout
            self._leave()

    def end(self) -> None:
        """End the present visitor."""
        self._leave()
        self._directory.cleanup()

    def _leave(self) -> None:
        if self._program is not None:
            self._program.send_signal(VISITOR_ENDS[self.came % len(VISITOR_ENDS)])
            try:
                self._program.wait()
            except TimeoutError:  # and was killed
                self.stuck += 1
            self._program = None
            self.came += 1
