"""Who listens to the pipeline under measurement: arrival and sample stamp of each orientation."""

from __future__ import annotations

from array import array
import json
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    PoseStamped, PoseWithCovarianceStamped, QuaternionStamped, TwistStamped)
from rclpy.node import Node

from spm_haptic_master.nodes import process
from spm_haptic_master.nodes.qos import SAMPLES

# What it says on standard output once orientations arrive.
READY = 'first orientation'
SAMPLES_FILE, STATUSES_FILE = 'samples.bin', 'statuses.json'
OTHERS = {'measured_cp': PoseStamped, 'pose_with_covariance': PoseWithCovarianceStamped,
          'measured_cv': TwistStamped}


class Observer(Node):
    """
    Keeps (arrival, stamp) of each `orientation`, ns, and every status on /diagnostics.

    Parameters
    ----------
    others : bool
        Whether it listens to the other outputs of `fkm` too.

    """

    def __init__(self, others: bool):
        super().__init__('observer')
        self._samples = array('q')
        self._statuses: list[tuple[int, str, dict[str, str]]] = []
        self.create_subscription(QuaternionStamped, 'orientation', self._on_orientation, SAMPLES)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 100)
        if others:
            for topic, kind in OTHERS.items():
                self.create_subscription(kind, topic, lambda _: None, SAMPLES)

    def write(self, directory: Path) -> None:
        """Write what was kept into `SAMPLES_FILE` and `STATUSES_FILE`."""
        with open(directory / SAMPLES_FILE, 'wb') as file:
            self._samples.tofile(file)
        (directory / STATUSES_FILE).write_text(json.dumps(self._statuses))

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
    """Observe until told to stop, then write into `directory`."""
    observers: list[Observer] = []
    code = process.run(
        'observer', lambda _, add: observers.append(add(Observer(others))), args)
    for observer in observers:
        observer.write(directory)
    return code
