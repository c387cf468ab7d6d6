# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The subscriber of the measurement: arrival and sample stamp of each orientation or command."""

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
from sensor_msgs.msg import Joy
from spm_haptic_master.ros import runner
from spm_haptic_master.ros.parameters import ParameterNode, Parameters
from spm_haptic_master.ros.qos import EVENTS, SAMPLES, STATE
from spm_haptic_master.timing import SECOND
from std_msgs.msg import String
from std_srvs.srv import Trigger

# Line on standard output after the first sample.
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
# Time between two attempts to engage the slave (s).
ENGAGE_PERIOD = 0.2
# Time between two poses of the slave that stands in for one (s).
POSE_PERIOD = 0.05


class Observer(ParameterNode):
    """
    Records (arrival, stamp) of each message of a topic, ns, and every status on /diagnostics.

    Its files in the directory grow while it observes. 'observer_of_all' subscribes to the other
    outputs of `fkm` as well; 'observer_of_commands' records `servo_cp` instead of `orientation`,
    and is the surgeon and the slave.
    """

    def __init__(self, parameters: Parameters, name: str, directory: Path) -> None:
        super().__init__('observer', parameters)
        commands = name == 'observer_of_commands'
        self._samples = array('q')
        self._ready = False
        self._written = 0
        self._samples_file = open(directory / SAMPLES_FILE, 'wb', buffering=0)
        self._statuses_file = open(directory / STATUSES_FILE, 'w', encoding='utf-8')
        kind, topic = (PoseStamped, 'servo_cp') if commands else (QuaternionStamped, 'orientation')
        self.create_subscription(kind, topic, self._on_sample, SAMPLES)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 100)
        if name == 'observer_of_all':
            for topic, kind in OTHERS.items():
                self.create_subscription(kind, topic, lambda _: None, SAMPLES)
        if commands:
            self._presence = self.create_publisher(Joy, 'presence', EVENTS)
            self._enable = self.create_client(Trigger, 'enable')
            self._engaged = False
            self.create_subscription(String, 'teleop_state', self._on_state, STATE)
            self.create_timer(ENGAGE_PERIOD, self._engage)
            # The slave stands still: one that followed would be a second reader of the commands.
            self._pose = PoseStamped()
            self._pose.header.frame_id = 'slave_base'
            self._pose_out = self.create_publisher(PoseStamped, 'slave/measured_cp', EVENTS)
            self.create_timer(POSE_PERIOD, lambda: self._pose_out.publish(self._pose))

    def destroy_node(self) -> None:
        """Write the rest, close the files and destroy the node."""
        self._write_samples()
        self._samples_file.close()
        self._statuses_file.close()
        super().destroy_node()

    def _engage(self) -> None:
        self._presence.publish(Joy(buttons=[1]))
        if not self._engaged and self._enable.service_is_ready():
            self._enable.call_async(Trigger.Request())

    def _on_state(self, state: String) -> None:
        self._engaged = state.data == 'engaged'

    def _on_sample(self, message: QuaternionStamped | PoseStamped) -> None:
        now = time.time_ns()
        stamp = message.header.stamp
        if not self._ready:
            self._ready = True
            print(READY, flush=True)
        self._samples.append(now)
        self._samples.append(stamp.sec * SECOND + stamp.nanosec)
        if now - self._written >= WRITE_PERIOD:
            self._written = now
            self._write_samples()

    def _write_samples(self) -> None:
        self._samples_file.write(self._samples.tobytes())
        del self._samples[:]

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        stamp = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
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


def main(name: str, directory: Path, args: list[str]) -> int:
    """Run the observer of a name until a signal; return the exit code."""
    return runner.run('observer', lambda _, add: add(Observer, name, directory), args)
