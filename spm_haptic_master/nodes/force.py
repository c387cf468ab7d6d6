# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback in the process of the orientation: one call for each sample, and its topics."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from operator import truediv
import threading
import time
from typing import NamedTuple

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from spm_haptic_master.drives.drives import DriveReport, Drives
from spm_haptic_master.force import (
    DrivesState,
    ForceCondition,
    ForceController,
    ForceOutput,
    ForceSample,
    ForceState,
)
from spm_haptic_master.force.joint_motion import VELOCITY_WINDOW
from spm_haptic_master.force.samples import ENGAGED, ForceReason, HOLDING
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import AngularVelocity, rotation_from_quaternion
from spm_haptic_master.kinematics.vectors import transposed_times
from spm_haptic_master.nodes.force_inputs import ForceInputs
from spm_haptic_master.nodes.force_status import drive_fault, ForceStatus
from spm_haptic_master.nodes.wrench_frames import WrenchFrame, WrenchFrames
from spm_haptic_master.parameters.fkm import BY_TELEOP, sigma_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.diagnostic_status import STEADY
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.supervision.supervisor import Supervisor
from spm_haptic_master.teleoperation.engaging import Phase
from spm_haptic_master.timing import SECOND, StampGrid
from std_msgs.msg import String

# Period at which missing samples and changes are noticed (s), and after how many of them without
# a sample force fades out. If the whole process was suspended, only one period counts as missed.
WATCH_PERIOD = 0.005
SILENT_PERIODS = 4


class Surroundings(NamedTuple):
    """
    What the force feedback needs of `fkm`.

    Attributes
    ----------
    frame_id : str
        Frame of `orientation`.
    now : callable
        Returns the time on the clock of the samples, ns.
    is_enabled : callable
        Returns whether the operating state is ENABLED.
    warn : callable
        Publishes CRTK's `warning`.
    lock : threading.Lock
        Guards controller and drives; callers of `take` and `acknowledge` hold it.

    """

    frame_id: str  # of the orientation
    now: Callable[[], int]  # time on the clock of the samples, ns
    is_enabled: Callable[[], bool]  # whether the operating state is ENABLED
    warn: Callable[[str], None]  # publishes CRTK's `warning`
    lock: threading.Lock  # held by callers of `take` and `acknowledge`


class Force:
    """
    The force feedback of `fkm`: controller, drives, inputs and outputs.

    Parameters
    ----------
    node : Node
        Of all topics.
    values : Values
        Settings of `fkm`.
    controller : ForceController
        Makes the torques.
    drives : Drives or None
        Take the torques; None: another motor controller does.
    supervisor : Supervisor
        Knows the noise of the encoders.
    surroundings : Surroundings
        What it needs of `fkm`.

    """

    def __init__(
        self,
        node: Node,
        values: Values,
        controller: ForceController,
        drives: Drives | None,
        supervisor: Supervisor,
        surroundings: Surroundings,
    ) -> None:
        self._controller = controller
        self._drives = drives
        self._supervisor = supervisor
        self._sigma = sigma_from(values)
        self._is_enabled = surroundings.is_enabled
        self._warn = surroundings.warn
        self._lock = surroundings.lock
        self._report: DriveReport | None = None
        self._by_teleop = values['force.engaged_by'] == BY_TELEOP
        self._sensors = values['sensors']
        self._velocity = AngularVelocity(VELOCITY_WINDOW)
        frames = WrenchFrames(values, surroundings.frame_id)
        self._inputs = ForceInputs(
            node, values, frames, surroundings.now, lambda: self._quaternion, self._lock
        )
        # Of the latest sample; None before the first.
        self._stamp: int | None = None
        self._angles: tuple[float, ...] = ()
        self._quaternion: Quaternion[float] | None = None
        # Periods without a sample, and the largest noise of an encoder over its figure (unit 1).
        self._missing = 0
        self._noise = 1.0
        self._output = controller.output
        # States entered since the last look.
        self._changes: list[ForceState] = [self._output.state]
        # Publishers of the rendered torque, whether it has a subscriber, and its grid, which is
        # that of the other CRTK topics.
        self._is_wanted = False
        self._grid = StampGrid(values['crtk_rate'], values['rate'])
        self._outs = [
            MeasuredTorque(node, 'spatial/measured_cf', frames.spatial),
            MeasuredTorque(node, 'body/measured_cf', frames.body),
        ]
        self._state_out = node.create_publisher(String, 'force_state', STATE)
        self._status = ForceStatus(node, controller, self._inputs)
        node.create_timer(WATCH_PERIOD, self._watch, clock=STEADY)

    def take(
        self,
        stamp: int,
        angles: tuple[float, ...],
        quaternion: Quaternion[float] | None,
        level: float,
    ) -> None:
        """
        Command the motor torques of a sample; one that is not newer than the last is ignored.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : tuple of float
            Raw angles of the encoders, rad.
        quaternion : tuple of four float or None
            R_base_platform, x, y, z, w; None where the sample is withheld.
        level : float
            Protection level of the orientation, rad.

        """
        if self._controller.has_seen(stamp):
            return
        self._missing = 0
        before = self._output.state
        output = self._controller.take(self._sample(stamp, angles, quaternion, level))
        self._output = output
        self._stamp = stamp
        self._angles = angles
        self._quaternion = quaternion
        self._command(output)
        if output.state != before:
            self._follow(before, output.state)
        if quaternion is not None and output.rendered is not None:
            self._publish(stamp, output.rendered, quaternion)

    def _sample(
        self,
        stamp: int,
        angles: tuple[float, ...],
        quaternion: Quaternion[float] | None,
        level: float,
    ) -> ForceSample:
        """
        Return a joint sample with its circumstances.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : tuple of float
            Raw angles of the encoders, rad.
        quaternion : tuple of four float or None
            R_base_platform, x, y, z, w; None where the sample is withheld.
        level : float
            Protection level of the orientation, rad.

        Returns
        -------
        ForceSample
            The angular velocity is None without an orientation, and until enough of them have
            come.

        """
        velocity = None
        if quaternion is not None:
            self._velocity.add(stamp, quaternion)
            velocity = self._velocity.value()
        inputs = self._inputs
        teleop = self._inputs.teleop
        is_engaged = teleop.is_absent or teleop.phase is not Phase.DISENGAGED
        return ForceSample(
            stamp=stamp,
            angles=angles,
            quaternion=quaternion,
            velocity=velocity,
            protection_level=level,
            noise=self._noise,
            wrench=inputs.latest_wrench(),
            sources=inputs.sources.count,
            drives=self._drive_state(),
            enabled=self._by_teleop or self._is_enabled(),
            engaged=is_engaged or not self._by_teleop,
            present=not teleop.is_absent,
            clutched=teleop.phase is Phase.CLUTCHED,
            lock=inputs.modes.lock.value,
            weightless=inputs.modes.is_weight_compensated.value,
        )

    def _drive_state(self) -> DrivesState:
        """Return the state of all drives, by their latest report."""
        report = self._report
        if report is None:
            if self._drives is None:
                return DrivesState.OPERATING
            return DrivesState.OFF
        if report.fault is not None:
            return DrivesState.FAULT
        if report.ready:
            return DrivesState.OPERATING
        return DrivesState.OFF

    def _command(self, output: ForceOutput) -> None:
        """Pass the torques to the drives: none after a fault that ends all."""
        if self._drives is None:
            return
        is_dead = output.state.condition is ForceCondition.FAULT and not output.state.has_support
        torques = None if is_dead else output.motor_torque
        self._report = self._drives.step(torques, time.monotonic())

    def _follow(self, before: ForceState, state: ForceState) -> None:
        """
        Note a change of the state, and end the modes that it ends.

        Parameters
        ----------
        before, state : ForceState
            State before and after the change. All modes end when force is off; the lock ends with
            each fault or fading, and when holding becomes engaged.

        """
        self._changes.append(state)
        modes = self._inputs.modes
        if state.condition is ForceCondition.OFF:
            modes.end()
        elif state.why is not None or (before is HOLDING and state is ENGAGED):
            modes.lock.end()

    @property
    def state(self) -> ForceState:
        """State of the force feedback, as on the topic `force_state`."""
        return self._output.state

    def effort(self) -> list[float]:
        """
        Return the torque of each sensed joint, N m: as drives report it, else as commanded.

        Returns
        -------
        list of float
            Torques of the motors, and 0 for each further sensor.

        """
        report = self._report
        if report is None:
            torques = self._output.motor_torque
        else:
            torques = report.torques
        further = self._sensors - len(torques)
        return [*torques, *[0.0] * further]

    def acknowledge(self) -> str:
        """
        End a latched fault, that of the drives too; return what it was, empty if none.

        Returns
        -------
        str
            The fault of the force feedback, or of the drives, or both.

        """
        fault = drive_fault(self._report)
        state = self._output.state
        if self._drives is not None and fault:
            self._drives.acknowledge()
        if self._controller.acknowledge():
            self._output = self._controller.output
            self._follow(state, self._output.state)
            named = 'force feedback: ' + state.text.removeprefix('fault: ')
            return f'{named}; {fault}' if fault else named
        return fault

    def close(self) -> None:
        """End all torque."""
        if self._drives is not None:
            self._drives.close()

    def _publish(
        self,
        stamp: int,
        rendered: Vector[float],
        quaternion: Quaternion[float],
    ) -> None:
        """Publish the rendered torque, N m in the base frame, where it is due and wanted."""
        if self._is_wanted and self._grid.is_due(stamp):
            rotation = rotation_from_quaternion(*quaternion)
            in_handle = transposed_times(rotation, rendered)
            for out in self._outs:
                out.publish(stamp, rendered, in_handle)

    # Watch --------------------------------------------------------------------------------------

    def _watch(self) -> None:
        """Notice samples that do not come, and publish what has changed."""
        self._inputs.poll()
        self._is_wanted = any(out.has_subscriber for out in self._outs)
        with self._lock:
            self._notice_silence()
            noises = self._supervisor.joints.noise()
            self._noise = max(map(truediv, noises, self._sigma))
            changes = self._changes
            self._changes = []
            output = self._output
            quaternion = self._quaternion
            report = self._report
        for state in changes:
            self._announce(state, report)
        self._status.publish(output, quaternion, report)

    def _notice_silence(self) -> None:
        """
        Let force fade out where samples are missing.

        The caller holds the lock. After SILENT_PERIODS the controller gets a sample without
        an orientation in each period.
        """
        missing = self._missing + 1
        if missing >= SILENT_PERIODS and self._stamp is not None:
            stamp = self._stamp + round(SECOND * WATCH_PERIOD)
            self.take(stamp, self._angles, None, inf)
        self._missing = missing

    def _announce(self, state: ForceState, report: DriveReport | None) -> None:
        """Publish a state, and CRTK's `warning` of a fault."""
        self._state_out.publish(String(data=state.text))
        if state.condition is not ForceCondition.FAULT:
            return
        fault = drive_fault(report)
        if state.why is ForceReason.DRIVE and fault:
            detail = f'; {fault}'
        else:
            detail = ''
        self._warn(f'force feedback: {state.text}{detail}')


class MeasuredTorque:
    """
    The topic of the rendered torque in a frame.

    Parameters
    ----------
    node : Node
        Node that publishes.
    topic : str
        Name of the topic.
    frame : WrenchFrame
        Frame of the messages.

    """

    def __init__(
        self,
        node: Node,
        topic: str,
        frame: WrenchFrame,
    ) -> None:
        self._frame = frame
        self._message = WrenchStamped()
        self._out = node.create_publisher(WrenchStamped, topic, SAMPLES)

    @property
    def has_subscriber(self) -> bool:
        """Whether anybody wants it."""
        return bool(self._out.get_subscription_count())

    def publish(
        self,
        stamp: int,
        in_base: Vector[float],
        in_handle: Vector[float],
    ) -> None:
        """
        Publish the torque of a sample, N m in the base and in the platform frame.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        in_base : tuple of 3 float
            Torque in the base frame, N m.
        in_handle : tuple of 3 float
            The same torque in the platform's frame, N m.

        """
        header = self._message.header
        torque = self._message.wrench.torque
        header.stamp.sec, header.stamp.nanosec = divmod(stamp, SECOND)
        header.frame_id = self._frame.name
        given = in_handle if self._frame.in_handle else in_base
        torque.x, torque.y, torque.z = transposed_times(self._frame.rotation, given)
        self._out.publish(self._message)
