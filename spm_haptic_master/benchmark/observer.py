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
from rclpy.node import Node
from spm_haptic_master.nodes import runner
from spm_haptic_master.nodes.qos import SAMPLES

# Line on standard output after the first orientation.
READY = 'first orientation'
# Files of the samples (pairs of int64: arrival, stamp, ns) and of the statuses.
SAMPLES_FILE, STATUSES_FILE = 'samples.bin', 'statuses.json'
# Outputs of `fkm` beside the orientation, by topic.
OTHERS = {'measured_cp': PoseStamped, 'pose_with_covariance': PoseWithCovarianceStamped,
          'measured_cv': TwistStamped}


class Observer(Node):
    """
    Records (arrival, stamp) of each `orientation`, ns, and every status on /diagnostics.

    Parameters
    ----------
    directory : Path
        Directory for `SAMPLES_FILE` and `STATUSES_FILE`, written at the end.
    others : bool
        Whether it subscribes to the other outputs of `fkm` too.

    """

    def __init__(self, directory: Path, others: bool) -> None:
        super().__init__('observer')
        self._directory = directory
        self._samples = array('q')
        self._statuses: list[tuple[int, str, dict[str, str]]] = []
        self.create_subscription(QuaternionStamped, 'orientation', self._on_orientation, SAMPLES)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 100)
        if others:
            for topic, kind in OTHERS.items():
                self.create_subscription(kind, topic, lambda _: None, SAMPLES)

    def destroy_node(self) -> None:
        """Write the files and destroy the node."""
        with open(self._directory / SAMPLES_FILE, 'wb') as file:
            self._samples.tofile(file)
        (self._directory / STATUSES_FILE).write_text(json.dumps(self._statuses))
        super().destroy_node()

    def _on_orientation(self, orientation: QuaternionStamped) -> None:
        now = time.time_ns()
        stamp = orientation.header.stamp
        samples = self._samples
        if not samples:
            print(READY, flush=True)
        samples.append(now)
        samples.append(stamp.sec * 1_000_000_000 + stamp.nanosec)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        for status in message.status:
            self._statuses.append((
                stamp, status.name, {entry.key: entry.value for entry in status.values}))


def main(directory: Path, others: bool, args: list[str]) -> int:
    """Observe until a signal, then write into `directory`; return the exit code."""
    return runner.run('observer', lambda _, add: add(Observer(directory, others)), args)
