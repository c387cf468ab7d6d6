# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that publishes the four joint angles."""

from __future__ import annotations

from collections.abc import Callable
import threading
import time

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState

from spm_haptic_master.exceptions import SourceEnded, SpmError
from spm_haptic_master.meters import RateMeter
from spm_haptic_master.nodes import runner
from spm_haptic_master.nodes.cdr import write_joints
from spm_haptic_master.nodes.diagnostic_status import ERROR, Health, OK, STEADY, WARN
from spm_haptic_master.nodes.parameters import declare, SOURCE_SETTING
from spm_haptic_master.nodes.qos import SAMPLES
from spm_haptic_master.parameter_files import source_defaults
from spm_haptic_master.source_factory import make_source, SOURCE_SETTINGS

# s; how long a read may block, so that the thread sees the end.
READ_TIMEOUT = 0.05
# s; how often the state is looked at for /diagnostics.
HEALTH_PERIOD = 0.02
# s from the start; until the first set within it, silence is no error.
START_GRACE = 0.5
# s; a recording waits so long for its first listener, then so long for the connection to settle.
LISTENER_TIMEOUT = 5.0
LISTENER_SETTLE = 0.3
# s; how long the end waits for listeners to have got the last sample.
ACKNOWLEDGE_TIMEOUT = 2.0


class EncoderDriver(Node):
    """
    Publishes `measured_js` from a source, one message a set, in a thread of its own.

    That thread begins with `start`.

    Parameters
    ----------
    done : Future
        Completed with SourceEnded or another SpmError when the source gives no more.

    Raises
    ------
    SettingError
        For a wrong parameter.

    Attributes
    ----------
    listener : callable or None
        Called with stamp (ns) and angles (rad) of each set, before that is published.

    """

    def __init__(self, done: Future):
        super().__init__('encoder_driver')
        self._done = done
        self.source_name = declare(self, (SOURCE_SETTING,))['source']
        values = declare(self, SOURCE_SETTINGS[self.source_name],
                         source_defaults(self.source_name))
        self._source = make_source(self.source_name, values)
        self._publisher = self.create_publisher(JointState, 'measured_js', SAMPLES)
        self._published = RateMeter()
        self._health = Health(self, 'encoders', self.source_name)
        self._waiting = self._source.waits_for_listener
        self._grace_until = time.monotonic() + START_GRACE
        self.create_timer(HEALTH_PERIOD, self._report, clock=STEADY)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='encoders')
        self.listener: Callable[[int, tuple[float, float, float, float]], None] | None = None

    def start(self) -> None:
        """Begin to read the source."""
        self._thread.start()

    @property
    def rate(self) -> float:
        """Sets published a second."""
        return self._published.rate()

    @property
    def state(self) -> str:
        """What /diagnostics says of the encoders."""
        return self._health.message

    def destroy_node(self):
        """Stop the thread, leave the bus or file, and go."""
        self._stop.set()
        if self._thread.ident is None:  # never started
            self._source.close()
        else:
            self._thread.join()
        super().destroy_node()

    def _run(self) -> None:
        """Carry samples from the source to the topic until told to stop."""
        try:
            if self._source.waits_for_listener:
                self._wait_for_listener()
            self._carry()
        except SpmError as end:
            if isinstance(end, SourceEnded):
                self._publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_TIMEOUT))
            self._done.set_result(end)
        except Exception as error:
            # A bug: the process ends with it, rather than to go on without a driver.
            self._done.set_exception(error)
        finally:
            self._source.close()

    def _wait_for_listener(self) -> None:
        """Hold a recording back until somebody hears it, or nobody came for a while."""
        deadline = time.monotonic() + LISTENER_TIMEOUT
        while not self._heard() and time.monotonic() < deadline:
            if self._stop.wait(READ_TIMEOUT):
                return
        self._stop.wait(LISTENER_SETTLE)
        self._waiting = False

    def _heard(self) -> bool:
        return self.listener is not None or self._publisher.get_subscription_count() > 0

    def _carry(self) -> None:
        while not self._stop.is_set():
            sample = self._source.read(READ_TIMEOUT)
            if sample is None:
                continue
            if self.listener is not None:
                self.listener(sample.stamp, sample.angles)
            self._publisher.publish(write_joints(sample.stamp, sample.angles))
            self._published.count += 1

    def _report(self) -> None:
        fault = self._source.fault
        if self._waiting:
            level, text = WARN, 'waiting for a listener'
        elif fault is not None:
            starting = not self._published.count and time.monotonic() < self._grace_until
            level, text = (WARN, f'starting: {fault}') if starting else (ERROR, fault)
        elif (caution := self._source.caution) is not None:
            level, text = WARN, caution
        else:
            level, text = OK, 'publishing'
        if self._health.due(level, text):
            self._health.say(level, text, {
                'source': self.source_name, 'set rate (Hz)': self.rate,
                **self._source.statistics()})


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('encoder_driver', lambda done, add: add(EncoderDriver(done)), args)
