# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One process of the benchmark: python -m ... NAME DIRECTORY [--ros-args ...].

NAME is an executable of the package, a bare node with the same messages and no computation, or an
observer, which writes into the directory. `STACKS_SIGNAL` prints the stacks of all threads on
standard error.
"""

from __future__ import annotations

import faulthandler
from importlib import import_module
import json
from pathlib import Path
import signal
from struct import Struct
import sys
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs import msg as geometry
from geometry_msgs.msg import QuaternionStamped
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.executables import EXECUTABLES
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.ros import runner
from spm_haptic_master.ros.diagnostic_status import OK, REPEAT_PERIOD, StatusPublisher
from spm_haptic_master.ros.parameters import ParameterNode, Parameters
from spm_haptic_master.ros.qos import SAMPLES
from spm_haptic_master.timing import DeadlineGrid, SECOND

# Signal at which a process prints the stacks of its threads.
STACKS_SIGNAL = signal.SIGUSR1
# Longest wait for a deadline (s): the thread polls its end after each.
WAIT_TIMEOUT = 0.05
# Frame of the orientations.
FRAME = 'spm_base'
# Four joint angles that are a unit quaternion: the relay copies them.
POSITIONS = [0.5, 0.5, 0.5, 0.5]
# Line on standard output after the first sample.
READY = 'first orientation'
# Files of the samples and of the statuses (JSON, one a line).
SAMPLES_FILE, STATUSES_FILE = 'samples.bin', 'statuses.jsonl'
# A sample in its file: arrival and stamp (ns).
SAMPLE = Struct('=qq')
# Time between two writes of samples (ns).
WRITE_PERIOD = 100_000_000
# Outputs of `fkm` beside the orientation, by topic.
OTHERS = {
    'measured_cp': geometry.PoseStamped,
    'measured_cv': geometry.TwistStamped,
    'pose_with_covariance': geometry.PoseWithCovarianceStamped,
}


class BareDriver(ParameterNode):
    """Publishes `measured_js` on a grid, and its counts on /diagnostics."""

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('bare_driver', parameters)
        self._sets = 0
        self._grid = DeadlineGrid(1.0 / float(str(self.given['rate'])))
        self._publisher = self.create_publisher(JointState, 'measured_js', SAMPLES)
        self._status = StatusPublisher(self, 'encoders', 'bare')
        self.create_timer(REPEAT_PERIOD, self._report)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='driver')
        self._thread.start()

    def destroy_node(self) -> None:
        """Stop the thread and destroy the node."""
        self._stop.set()
        self._thread.join()
        super().destroy_node()

    def _run(self) -> None:
        message = JointState(name=list(JOINT_NAMES), position=POSITIONS)
        stamp = message.header.stamp
        while not self._stop.is_set():
            if not self._grid.wait(WAIT_TIMEOUT):
                continue
            stamp.sec, stamp.nanosec = divmod(time.time_ns(), SECOND)
            self._sets += 1
            self._publisher.publish(message)

    def _report(self) -> None:
        self._status.publish(
            OK, 'publishing', {'sets': self._sets, 'missed deadlines': self._grid.missed}
        )


class BareRelay(ParameterNode):
    """Copies the four positions of each `measured_js` into an `orientation`."""

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('bare_relay', parameters)
        self._message = QuaternionStamped()
        self._message.header.frame_id = FRAME
        self._publisher = self.create_publisher(QuaternionStamped, 'orientation', SAMPLES)
        self.create_subscription(JointState, 'measured_js', self._relay, SAMPLES)

    def _relay(self, joints: JointState) -> None:
        message = self._message
        message.header.stamp = joints.header.stamp
        quaternion = message.quaternion
        quaternion.x, quaternion.y, quaternion.z, quaternion.w = joints.position
        self._publisher.publish(message)


class BareListener(ParameterNode):
    """Subscribes to `orientation`, as `diagnostics` does, and ignores it."""

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('bare_listener', parameters)
        self.create_subscription(QuaternionStamped, 'orientation', lambda _: None, SAMPLES)


class Observer(ParameterNode):
    """
    Records (arrival, stamp) of each `orientation`, ns, and every status on /diagnostics, in files.

    'observer_of_all' subscribes to the other outputs of `fkm` as well.
    """

    def __init__(self, parameters: Parameters, name: str, directory: Path) -> None:
        super().__init__('observer', parameters)
        self._written = 0
        self._samples_file = open(directory / SAMPLES_FILE, 'wb')
        self._statuses_file = open(directory / STATUSES_FILE, 'w', encoding='utf-8')
        self.create_subscription(QuaternionStamped, 'orientation', self._on_sample, SAMPLES)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 100)
        if name == 'observer_of_all':
            for topic, kind in OTHERS.items():
                self.create_subscription(kind, topic, lambda _: None, SAMPLES)

    def destroy_node(self) -> None:
        """Close the files and destroy the node."""
        self._samples_file.close()
        self._statuses_file.close()
        super().destroy_node()

    def _on_sample(self, message: QuaternionStamped) -> None:
        now = time.time_ns()
        stamp = message.header.stamp
        if not self._written:
            print(READY, flush=True)
        self._samples_file.write(SAMPLE.pack(now, stamp.sec * SECOND + stamp.nanosec))
        if now - self._written >= WRITE_PERIOD:
            self._written = now
            self._samples_file.flush()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        stamp = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
        for status in message.status:
            values = {entry.key: entry.value for entry in status.values}
            self._statuses_file.write(json.dumps((stamp, status.name, values)) + '\n')


# The nodes of each process, in the order of `master`.
BARE_NODES: dict[str, tuple[type[ParameterNode], ...]] = {
    'bare_driver': (BareDriver,),
    'bare_relay': (BareRelay,),
    'bare_listener': (BareListener,),
    'bare_master': (BareRelay, BareListener, BareDriver),
}


def main() -> int:
    """Run the program that the command line names; return its exit code."""
    name, directory, *args = sys.argv[1:]
    faulthandler.register(STACKS_SIGNAL)
    if name in EXECUTABLES:
        code: int = import_module(f'spm_haptic_master.{EXECUTABLES[name][0]}').main([name, *args])
        return code

    def compose(_: Future, add: runner.AddNode) -> None:
        for node in BARE_NODES.get(name, ()):
            add(node)
        if name not in BARE_NODES:
            add(Observer, name, Path(directory))

    return runner.run(name if name in BARE_NODES else 'observer', compose, [name, *args])


if __name__ == '__main__':
    sys.exit(main())
