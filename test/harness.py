# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executables of the package as child processes, and an observer of what they publish."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import re
import time

from benchmarks.pipeline.child_process import executable, Program
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from spm_haptic_master.nodes.crtk_state import ABSENT
from spm_haptic_master.ros.overload import TOO_BUSY

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / 'test' / 'data'
# Parameters of a simulation: the source has no default.
SIM = {'source': 'sim'}
# The passed force_check of simulated drives.
SIMULATED_CHECK = ROOT / 'config' / 'simulated_check.json'
# Arguments of a driver on simulated encoders: their zero counts and directions.
SIMULATED = ('--params-file', str(ROOT / 'config' / 'simulated_rig.yaml'))
# A line of fkm's log that a pause in the samples explains.
PAUSE_LOG = re.compile(
    r'^\[\w+\] \[[\d.]+\] \[[\w.]+\]: '
    r'(silent: (no joint samples|stale sample)|starting|healthy|samples missing|'
    rf'(silent: )?{TOO_BUSY}: [^;\n]*?( \[.*\])?)( \(\d+ more times? in \d+ s\))?\n',
    re.MULTILINE,
)
# The line of fkm where crtk_msgs is not installed.
ABSENT_LOG = re.compile(rf'^\[INFO\] \[[\d.]+\] \[[\w.]+\]: {re.escape(ABSENT)}\n', re.MULTILINE)
# Depth of the observer's queues (messages): a busy machine loses none on the observer's side.
OBSERVER_DEPTH = 2000
# Time between two looks into them at most (s).
TAKEN_EACH = 0.005


def environment(**changes: str) -> dict[str, str]:
    """Return the environment of a child process: this run's, and checked message fields."""
    return {
        **os.environ,
        'ROS_PYTHON_CHECK_FIELDS': '1',
        'PYTHONUNBUFFERED': '1',
        **changes,
    }


def start_program(
    name: str,
    *args: str,
    parameters: dict[str, object] | None = None,
    error_to: int | None = None,
    **changes: str,
) -> Program:
    """Start an executable with ROS parameters and changed environment variables."""
    return start_command(
        executable(name, *args, parameters=parameters), error_to=error_to, **changes
    )


def start_command(
    command: list[str], new_session: bool = False, error_to: int | None = None, **changes: str
) -> Program:
    """Start any command at the repository's root; further arguments are environment variables."""
    return Program(
        command,
        environment=environment(**changes),
        directory=ROOT,
        new_session=new_session,
        error_to=error_to,
    )


@contextmanager
def full_pipe() -> Iterator[tuple[int, int]]:
    """Yield the ends of a pipe that nobody has read until it was full: to read, to write."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    try:
        for size in (4096, 1):
            with suppress(BlockingIOError):
                while True:
                    os.write(writing, b'.' * size)
        os.set_blocking(writing, True)
        yield reading, writing
    finally:
        os.close(reading)
        os.close(writing)


class Observer:
    """
    A node of the test: collects messages with their times of publication.

    Those are the times of the publisher's DDS: how late this process reads does not matter. An
    EventsExecutor passes none of them on (rclpy 7.1.6), so the messages are taken beside it.
    """

    def __init__(self, name: str = 'observer') -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(name, context=self.context)
        self._reader = rclpy.create_node(f'{name}_reader', context=self.context)
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._collected: list[tuple[Subscription, list[tuple[int, object]]]] = []

    def collect(
        self, message_type: type, topic: str, qos: QoSProfile | None = None
    ) -> list[tuple[int, object]]:
        """Return a list that fills with (time of publication in ns, message) while spinning."""
        collected: list[tuple[int, object]] = []
        subscription = self._reader.create_subscription(
            message_type, topic, collected.append, qos or QoSProfile(depth=OBSERVER_DEPTH)
        )
        self._collected.append((subscription, collected))
        return collected

    def _take(self) -> None:
        """Take what has arrived."""
        for subscription, collected in self._collected:
            with subscription.handle:
                while taken := subscription.handle.take_message(subscription.msg_type, False):
                    message, info = taken
                    collected.append((info['source_timestamp'], message))

    def spin(self, seconds: float) -> None:
        """Receive messages for some seconds."""
        self.spin_until(lambda: False, seconds)

    def spin_until(self, condition: Callable[[], object], seconds: float) -> bool:
        """Receive messages until a condition holds; False if it did not within that time, s."""
        end = time.monotonic() + seconds
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self._executor.spin_once(timeout_sec=min(left, TAKEN_EACH))
            self._take()
        return True

    def close(self) -> None:
        """Leave the DDS domain."""
        self.node.destroy_node()
        self._reader.destroy_node()
        self._executor.shutdown()
        rclpy.shutdown(context=self.context)


def complaints(program: Program) -> str:
    """Return a program's stderr without the log of pauses in the samples, as of a busy machine."""
    return PAUSE_LOG.sub('', ABSENT_LOG.sub('', program.stderr))


def stamp(message) -> int:
    """Return a message's header stamp in ns."""
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def status(arrived, name: str):
    """Return the newest status of that name among collected DiagnosticArrays, or None."""
    for _, array in reversed(arrived):
        for entry in array.status:
            if entry.name == name:
                return entry
    return None
