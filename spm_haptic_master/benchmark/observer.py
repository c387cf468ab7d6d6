# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The subscriber of the measurement: arrival and sample stamp of each orientation."""

from __future__ import annotations

from array import array
import json
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    QuaternionStamped,
    TwistStamped,
)
import numpy as np
from rclpy.node import Node
from spm_haptic_master.nodes import runner
from spm_haptic_master.nodes.qos import SAMPLES

# Line on standard output after the first orientation.
READY = 'first orientation'
# Files of the samples (pairs of int64: arrival, stamp, ns) and of the statuses (JSON, one a line).
SAMPLES_FILE, STATUSES_FILE = 'samples.bin', 'statuses.jsonl'
# Size of a sample in its file (bytes).
SAMPLE_SIZE = 16
# Time between two writes of samples (ns).
WRITE_PERIOD = 100_000_000
# Outputs of `fkm` beside the orientation, by topic.
OTHERS = {'measured_cp': PoseStamped, 'pose_with_covariance': PoseWithCovarianceStamped,
          'measured_cv': TwistStamped}

# A status on /diagnostics: stamp in ns, name, values by key.
Status = tuple[int, str, dict[str, str]]


class Observer(Node):
    """
    Records (arrival, stamp) of each `orientation`, ns, and every status on /diagnostics.

    Parameters
    ----------
    directory : Path
        Directory for `SAMPLES_FILE` and `STATUSES_FILE`; they grow while it observes.
    others : bool
        Whether it subscribes to the other outputs of `fkm` too.

    """

    def __init__(self, directory: Path, others: bool) -> None:
        super().__init__('observer')
        self._samples = array('q')
        self._ready = False
        self._written = 0
        self._samples_file = open(directory / SAMPLES_FILE, 'wb', buffering=0)
        self._statuses_file = open(directory / STATUSES_FILE, 'w', encoding='utf-8')
        self.create_subscription(QuaternionStamped, 'orientation', self._on_orientation, SAMPLES)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 100)
        if others:
            for topic, kind in OTHERS.items():
                self.create_subscription(kind, topic, lambda _: None, SAMPLES)

    def destroy_node(self) -> None:
        """Write the rest, close the files and destroy the node."""
        self._write_samples()
        self._samples_file.close()
        self._statuses_file.close()
        super().destroy_node()

    def _on_orientation(self, orientation: QuaternionStamped) -> None:
        now = time.time_ns()
        stamp = orientation.header.stamp
        samples = self._samples
        if not self._ready:
            self._ready = True
            print(READY, flush=True)
        samples.append(now)
        samples.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
        if now - self._written >= WRITE_PERIOD:
            self._written = now
            self._write_samples()

    def _write_samples(self) -> None:
        self._samples_file.write(self._samples.tobytes())
        del self._samples[:]

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        for status in message.status:
            values = {entry.key: entry.value for entry in status.values}
            self._statuses_file.write(json.dumps((stamp, status.name, values)) + '\n')


def read_samples(directory: Path) -> np.ndarray:
    """Return arrival and stamp of the samples in a directory, ns, shape (2, n)."""
    pairs = np.fromfile(directory / SAMPLES_FILE, np.int64)
    return pairs[:len(pairs) // 2 * 2].reshape(-1, 2).T


def read_statuses(directory: Path) -> list[Status]:
    """Return the statuses in a directory."""
    with open(directory / STATUSES_FILE, encoding='utf-8') as file:
        return [(at, name, values) for at, name, values in map(json.loads, file)]


def main(directory: Path, others: bool, args: list[str]) -> int:
    """Observe until a signal, and write into `directory`; return the exit code."""
    return runner.run('observer', lambda _, add: add(Observer(directory, others)), args)
