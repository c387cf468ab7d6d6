# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Real processes and a real observer for the tests: the package's executables on a private DDS."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.qos import QoSProfile

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / 'test' / 'data'
# Deep enough that a busy machine loses nothing on the observer's side.
OBSERVER_DEPTH = 2000


def environment() -> dict[str, str]:
    """Return what a child process gets: this one's environment, and checked message fields."""
    return {**os.environ, 'ROS_PYTHON_CHECK_FIELDS': '1', 'PYTHONUNBUFFERED': '1'}


class Program:
    """
    A running executable of the package.

    Parameters
    ----------
    name : str
        As in `python -m spm_haptic_master NAME`.
    args : str
        Further command-line arguments.
    parameters : dict
        ROS parameters, given as `-p name:=value`.

    """

    def __init__(self, name: str, *args: str, parameters: dict[str, object] | None = None):
        command = [sys.executable, '-m', 'spm_haptic_master', name, *args]
        if parameters:
            command.append('--ros-args')
            for key, value in parameters.items():
                text = str(value).lower() if isinstance(value, bool) else str(value)
                command += ['-p', f'{key}:={text}']
        self._out = tempfile.TemporaryFile('w+')
        self._err = tempfile.TemporaryFile('w+')
        self.process = subprocess.Popen(
            command, cwd=ROOT, env=environment(), stdin=subprocess.DEVNULL,
            stdout=self._out, stderr=self._err)

    def stop(self, number: int = signal.SIGTERM, timeout: float = 15.0) -> int:
        """Send a signal, wait for the end and return the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.wait(timeout)

    def wait(self, timeout: float = 15.0) -> int:
        """Wait for the end and return the exit code."""
        try:
            return self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise

    @property
    def stdout(self) -> str:
        """What it printed so far."""
        self._out.seek(0)
        return self._out.read()

    @property
    def stderr(self) -> str:
        """What it complained of so far."""
        self._err.seek(0)
        return self._err.read()


class Observer:
    """A node of the test's own: collects what arrives on topics, with the time of arrival."""

    def __init__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('observer', context=self.context)
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)

    def collect(self, message_type: type, topic: str,
                qos: QoSProfile | None = None) -> list[tuple[int, object]]:
        """Return a list that fills with (time of arrival in ns, message) while spinning."""
        arrived = []
        self.node.create_subscription(
            message_type, topic, lambda message: arrived.append((time.time_ns(), message)),
            qos or QoSProfile(depth=OBSERVER_DEPTH))
        return arrived

    def spin(self, seconds: float) -> None:
        """Let messages in for some seconds."""
        self.spin_until(lambda: False, seconds)

    def spin_until(self, condition, seconds: float) -> bool:
        """Let messages in until the condition holds; False if it never did in that time."""
        end = time.monotonic() + seconds
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self._executor.spin_once(timeout_sec=min(left, 0.05))
        return True

    def close(self) -> None:
        """Leave the DDS domain."""
        self.node.destroy_node()
        self._executor.shutdown()
        rclpy.shutdown(context=self.context)


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
