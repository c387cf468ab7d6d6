# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that publishes the joint angles."""

from __future__ import annotations

from collections.abc import Callable
from math import isnan
import threading
import time

from rclpy.duration import Duration
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.drives.shared_bus import is_shared
from spm_haptic_master.encoders.decoder_factory import unverified_joints
from spm_haptic_master.encoders.single_axis import SingleAxis
from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.exceptions import SettingError, SourceEnded, SpmError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.nodes.axis_outputs import AxisOutputs
from spm_haptic_master.nodes.simulation_control import SimulationControl
from spm_haptic_master.parameters.axes import GRIPPER
from spm_haptic_master.parameters.files import source_defaults
from spm_haptic_master.parameters.geometry import mechanism_checksum
from spm_haptic_master.parameters.nodes import (
    DRIVE_NAMES,
    DRIVE_SETTINGS,
    SOURCE_SETTING,
    SOURCE_SETTINGS,
)
from spm_haptic_master.parameters.resolver import Parameters, resolve, source_of
from spm_haptic_master.parameters.setting import (
    CALIBRATION_SETTING,
    JOINTS_FRAME_SETTING,
    RATE_SETTING,
    Values,
)
from spm_haptic_master.ros import diagnostic_status as entry
from spm_haptic_master.ros import runner
from spm_haptic_master.ros.cdr import JointsFormat
from spm_haptic_master.ros.diagnostic_status import CHECK_PERIOD, ERROR, OK, STEADY, WARN
from spm_haptic_master.ros.duplicate_publishers import Rivals
from spm_haptic_master.ros.overload import Overload
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.simulation.sim_source import SimSource
from spm_haptic_master.simulation.source_factory import make_source, source_text
from spm_haptic_master.timing import RateMeter, SECOND
from std_msgs.msg import String

# Longest time that a read blocks (s), so that the thread notices the end of the process.
READ_TIMEOUT = 0.05
# Time after the start in which a missing first set is a warning, not an error (s).
START_GRACE = 0.5
# Longest time that a recording waits for its first subscriber (s).
LISTENER_TIMEOUT = 5.0
# Pause after which the connection to that subscriber is complete (s).
LISTENER_SETTLE = 0.3
# Period of `readings` (ns): often enough for the eye.
READINGS_PERIOD = SECOND // 20
# Longest wait at the end for subscribers to acknowledge the last sample (s).
ACKNOWLEDGE_TIMEOUT = 2.0
# Rate of the gripper's messages where none is given, as of fkm's (Hz).
CRTK_RATE = 200.0
# Message without fault and caution.
PUBLISHING = 'publishing'


class EncoderDriver(ParameterNode):
    """
    Publishes `measured_js` from a source, one message per set of joint angles.

    `readings` has twenty of them a second for displays: a subscriber of `measured_js` costs the
    driver time at each set. After `start` a thread of its own reads the source and publishes.

    Parameters
    ----------
    parameters : Parameters
        Files and arguments of the process.
    done : Future
        Is completed when the source ends or fails, with SourceEnded or another SpmError.

    Raises
    ------
    SpmError
        A parameter is missing or not valid, or the source cannot be made.

    Attributes
    ----------
    source_name : str
        The source: can, replay or sim.
    source_text : str
        The source with its bus or file, as on the latched topic `source`.
    state : str
        State of the encoders in words, as on /diagnostics, without the source.
    published : RateMeter
        Counts the sets.
    overload : Overload
        Whether this process loses time.
    listener : callable or None
        Is called with stamp, ns, and angles, rad (nan without a reading), before a set is
        published.

    """

    def __init__(self, parameters: Parameters, done: Future) -> None:
        super().__init__('encoder_driver', parameters)
        self._done = done
        # The source: can, replay or sim; with its bus or file, as on the latched topic `source`.
        self.source_name = source_of(self.given)
        settings = (SOURCE_SETTING, *SOURCE_SETTINGS[self.source_name])
        values = self.declare(settings, source_defaults(self.source_name))
        self.source_text = source_text(self.source_name, values)
        self._unverified = unverified_joints(values)
        # Mechanism, and calibration of a source that has one: `fkm` compares them with its own.
        self._identity = {entry.CHECKSUM_KEY: mechanism_checksum(values)}
        if CALIBRATION_SETTING.name in values:
            self._identity[entry.CALIBRATION_KEY] = (
                values[CALIBRATION_SETTING.name] or entry.UNNAMED
            )
        joints = JointsFormat(values['sensors'], values[JOINTS_FRAME_SETTING.name])
        self._write_joints = joints.write
        drives = _drives_beside(parameters, values)
        self._source = make_source(self.source_name, values, drives)
        # Insertion and gripper, where they have an encoder.
        axes = self._source.axes
        rate = _gripper_rate(parameters, axes)
        self._axis_outputs = AxisOutputs(self, axes, self.source_text, rate)
        self._publisher = self.create_publisher(JointState, 'measured_js', SAMPLES)
        self._readings_out = self.create_publisher(JointState, 'readings', SAMPLES)
        # Stamp of the latest set on `readings`, ns.
        self._read_at = 0
        self._simulation: SimulationControl | None = None
        if isinstance(self._source, SimSource):
            self._simulation = SimulationControl(self, self._source)
        self._rivals = Rivals(self, 'measured_js')
        self.overload = Overload(CHECK_PERIOD)
        # Time that the source had lost at the last report, s.
        self._lost = 0.0
        self.published = RateMeter()
        # Joint angles of the latest set, rad; empty before the first.
        self._angles: tuple[float, ...] = ()
        self._status = entry.StatusPublisher(self, entry.ENCODERS, self.source_text)
        # State of the encoders, as on /diagnostics, without the source.
        self.state = ''
        source_out = self.create_publisher(String, 'source', STATE)
        source_out.publish(String(data=self.source_text))
        self._waiting = self._source.waits_for_listener
        self._grace_until = time.monotonic() + START_GRACE
        self.create_timer(CHECK_PERIOD, self._report, clock=STEADY)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='encoders')
        # Called with stamp (ns) and angles (rad, NaN without a reading) before a set is published.
        self.listener: Callable[[int, tuple[float, ...]], None] | None = None

    def start(self) -> None:
        """Begin to read the source."""
        self._thread.start()

    def destroy_node(self) -> None:
        """Stop the thread, close the source and destroy the node."""
        self._stop.set()
        if self._thread.ident is None:  # never started
            self._source.close()
        else:
            self._thread.join()
        super().destroy_node()

    def _run(self) -> None:
        """
        Publish the source's samples until it ends, fails or the node is destroyed.

        Another exception than SpmError is a bug: it ends the process with its traceback.
        """
        try:
            if self._waiting:
                self._wait_for_listener()
            self._publish_samples()
        except SpmError as end:
            if isinstance(end, SourceEnded):
                self._publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_TIMEOUT))
            self._done.set_result(end)
        except Exception as error:  # a bug ends the process with its traceback
            self._done.set_exception(error)
        finally:
            self._source.close()

    def _wait_for_listener(self) -> None:
        """Delay a recording until it has a subscriber, or `LISTENER_TIMEOUT` has passed."""
        deadline = time.monotonic() + LISTENER_TIMEOUT
        while (
            self.listener is None
            and not self._publisher.get_subscription_count()
            and time.monotonic() < deadline
        ):
            if self._stop.wait(READ_TIMEOUT):
                return
        self._stop.wait(LISTENER_SETTLE)
        self._waiting = False

    def _publish_samples(self) -> None:
        """
        Read the source and publish each set, until the node is destroyed.

        The insertion and the gripper follow after each read, with or without a set: they delay no
        orientation.

        Raises
        ------
        SpmError
            The source has ended or failed.

        """
        while not self._stop.is_set():
            sample = self._source.read(READ_TIMEOUT)
            if sample is not None:
                self._publish_sample(sample)
            self._axis_outputs.publish(self._source.take_readings())

    def _publish_sample(self, sample: JointSample) -> None:
        """Publish a set, after whoever listens to it in this process has it."""
        if self.listener is not None:
            self.listener(sample.stamp, sample.angles)
        message = self._write_joints(sample.stamp, sample.angles)
        self._publisher.publish(message)
        # The clock may have been set back.
        if not 0 <= sample.stamp - self._read_at < READINGS_PERIOD:
            self._read_at = sample.stamp
            self._readings_out.publish(message)
        if self._simulation is not None:
            self._simulation.publish_truth(sample.stamp)
        self.published.count += 1
        self._angles = sample.angles

    def _report(self) -> None:
        """
        Publish on /diagnostics whether samples come, and if not, why.

        What the lost time of this process explains is reported as that, not as a fault of the
        encoders.
        """
        self._axis_outputs.report(self._source.axis_time)
        now = time.monotonic()
        before = self._lost
        self._lost = self._source.lost
        self.overload.tick(now, self._lost - before)
        busy = self.overload.words
        # Read once: another thread changes them.
        fault = self._source.fault
        caution = self._source.caution
        if self.overload.explains(fault or caution or ''):
            fault = fault and busy
            caution = caution and busy
        level, text = self._evaluate(fault, caution, now)
        logged = level, f'{text} [{self.source_text}]'
        if busy and busy not in text:
            # The log does not have it: it is no fault of the encoders.
            text = busy if level == OK else f'{text}; {busy}'
            level = max(level, WARN)
        self.state = text
        message = f'{text} [{self.source_text}]'
        if self._status.is_due(level, message):
            self._status.publish(
                level,
                message,
                logged=logged,
                values=self._figures(),
                starting=self._is_starting(now),
            )

    def _is_starting(self, now: float) -> bool:
        """Return whether it waits for its first samples, at a time, s, monotonic."""
        is_within_grace = not self.published.count and now < self._grace_until
        return self._waiting or is_within_grace

    def _figures(self) -> dict[str, object]:
        """Return the values of the entry, by name."""
        return {
            'source': self.source_text,
            'set rate (Hz)': self.published.rate(),
            **self._identity,
            entry.MISSING_KEY: ', '.join(self._missing()) or 'none',
            'directions not verified': ', '.join(self._unverified) or 'none',
            **self._source.statistics(),
        }

    def _missing(self) -> list[str]:
        """Return the joints without a reading in the latest set."""
        joints = zip(ALL_JOINT_NAMES, self._angles, strict=False)
        return [name for name, angle in joints if isnan(angle)]

    def _evaluate(
        self,
        fault: str | None,
        caution: str | None,
        now: float,
    ) -> tuple[bytes, str]:
        """
        Return level and text of what the source reports, and of the topic.

        Parameters
        ----------
        fault, caution : str or None
            What the source reports; None: nothing.
        now : float
            Present time, s, monotonic.

        Returns
        -------
        tuple of bytes and str
            OK, WARN or ERROR, and the words. A second publisher of the topic comes first, then a
            recording that waits, the fault, and the cautions.

        """
        if rivals := self._rivals.found():
            return ERROR, rivals + (f'; {fault}' if fault else '')
        if self._waiting:
            return WARN, 'waiting for a listener'
        if fault:
            starting = self._is_starting(now)
            if starting:
                return (WARN, f'starting: {fault}')
            return (ERROR, fault)
        # What an engineer should investigate although samples come.
        cautions = [caution] if caution else []
        if self._unverified:
            cautions.append(f'direction not verified: {", ".join(self._unverified)}')
        if cautions:
            return (WARN, '; '.join(cautions))
        return (OK, PUBLISHING)


def _drives_beside(parameters: Parameters, values: Values) -> tuple[int, ...]:
    """
    Return the node ids of the drives on the bus of the encoders; none for another source.

    Parameters
    ----------
    parameters : Parameters
        Files and arguments of the process: the drives are settings of `fkm`.
    values : mapping
        Checked settings of the driver.

    Returns
    -------
    tuple of int
        Node ids of the drives, and that of their master.

    """
    if 'can.channel' not in values:
        return ()
    given = {}
    for name, value in parameters.of('fkm').items():
        if name in DRIVE_NAMES:
            given[name] = value
    try:
        _, drives = resolve(given, (*DRIVE_SETTINGS, RATE_SETTING))
    except SettingError:
        return ()  # fkm, which has these settings, refuses them
    if is_shared(drives, values):
        return (*drives['drives.node_id'], drives['drives.master_id'])
    return ()


def _gripper_rate(parameters: Parameters, axes: tuple[SingleAxis, ...]) -> float:
    """
    Return the rate of the gripper's messages, which is that of fkm's.

    Parameters
    ----------
    parameters : Parameters
        Files and arguments of the process.
    axes : tuple of SingleAxis
        Axes that have an encoder.

    Returns
    -------
    float
        Rate, Hz; 0: a message for each reading.

    Raises
    ------
    SettingError
        fkm is told to publish a gripper of its own.

    """
    given = parameters.of('fkm')
    if any(axis.name == GRIPPER for axis in axes):
        for name in ('gripper.axis', 'gripper.position_deg'):
            if name in given:
                raise SettingError(
                    name=name,
                    value=given[name],
                    expected='nothing where the gripper has an encoder',
                )
    return float(given.get('crtk_rate', CRTK_RATE))  # type: ignore[arg-type]


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('encoder_driver', lambda done, add: add(EncoderDriver, done), args)
