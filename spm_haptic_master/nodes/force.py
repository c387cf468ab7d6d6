# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback in the process of the orientation: one call for each sample, and its topics."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot, inf
import threading
import time

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from spm_haptic_master.drives.drives import DriveReport
from spm_haptic_master.drives.drives import Drives as MotorDrives
from spm_haptic_master.force import (
    Condition,
    Drives,
    ForceController,
    ForceOutput,
    ForceSample,
    ForceState,
)
from spm_haptic_master.force.joint_motion import WINDOW
from spm_haptic_master.force.samples import Reason
from spm_haptic_master.force.vectors import NOTHING
from spm_haptic_master.kinematics.number_backends import Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import (
    AngularVelocity,
    conjugate,
    multiply_quaternions,
    rotation_from_quaternion,
    vector_from_quaternion,
)
from spm_haptic_master.kinematics.vectors import transposed_times
from spm_haptic_master.nodes.force_inputs import ForceInputs, WrenchFrames
from spm_haptic_master.parameters.fkm import BY_TELEOP, sigma_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, StatusPublisher, STEADY, WARN
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.supervision.supervisor import Supervisor
from spm_haptic_master.teleoperation.engaging import Phase
from spm_haptic_master.timing import SECOND, StampGrid
from std_msgs.msg import String

# Period at which missing samples and changes are noticed (s), and after how many of them without
# a sample force fades out. A process that stood still as a whole misses only one.
WATCH_PERIOD = 0.005
SILENT_PERIODS = 4
# Levels of the states; the others are OK.
LEVELS = {Condition.FADING: WARN, Condition.FAULT: ERROR}


class Force:
    """
    The force feedback of `fkm`: controller, drives, inputs and outputs.

    `frame_id` is that of the orientation, `now` returns the time on the clock of the samples, ns,
    `is_enabled` whether the operating state is ENABLED. Callers of `take` and `acknowledge` hold
    `lock`.
    """

    def __init__(
        self,
        node: Node,
        values: Values,
        frame_id: str,
        motors: tuple[ForceController, MotorDrives | None],
        supervisor: Supervisor,
        now: Callable[[], int],
        is_enabled: Callable[[], bool],
        warn: Callable[[str], None],
        lock: threading.Lock,
    ) -> None:
        self._controller, self._drives = motors
        self._supervisor, self._sigma = supervisor, sigma_from(values)
        self._is_enabled, self._warn, self._lock = is_enabled, warn, lock
        self._report: DriveReport | None = None
        self._by_teleop = values['force.engaged_by'] == BY_TELEOP
        self._stiffness = values['force.lock_stiffness']
        self._sensors = values['sensors']
        self._velocity = AngularVelocity(WINDOW)
        frames = WrenchFrames(values, frame_id)
        self._inputs = ForceInputs(node, values, frames, now, lambda: self._quaternion, lock)
        # Of the latest sample; None before the first. Samples have been missing for some periods.
        self._stamp: int | None = None
        self._angles: tuple[float, ...] = ()
        self._quaternion: Quaternion[float] | None = None
        self._missing, self._noise = 0, 1.0
        self._output = ForceOutput(
            ForceState(Condition.OFF),
            (0.0,) * values['force.motors'],
            NOTHING,
            NOTHING,
            None,
            0.0,
            1.0,
        )
        # States entered since the last look.
        self._changes: list[ForceState] = [self._output.state]
        # Publishers of the rendered torque, whether it has a subscriber, and its grid, which is
        # that of the other CRTK topics.
        self._is_wanted, self._grid = False, StampGrid(values['crtk_rate'], values['rate'])
        self._outs = [
            (frame, WrenchStamped(), node.create_publisher(WrenchStamped, topic, SAMPLES))
            for topic, frame in (
                ('spatial/measured_cf', frames.spatial),
                ('body/measured_cf', frames.body),
            )
        ]
        self._state_out = node.create_publisher(String, 'force_state', STATE)
        self._status = StatusPublisher(node, 'force', 'motors')
        node.create_timer(WATCH_PERIOD, self._watch, clock=STEADY)

    def take(
        self,
        stamp: int,
        angles: tuple[float, ...],
        quaternion: Quaternion[float] | None,
        level: float,
    ) -> None:
        """
        Command the motor torques of a sample: `angles` in rad, `level` of protection in rad.

        `quaternion` is R_base_platform, x, y, z, w; None where the sample is withheld.
        """
        self._missing = 0
        inputs, report, before = self._inputs, self._report, self._output.state
        velocity, pull = None, NOTHING
        if quaternion is not None:
            self._velocity.add(stamp, quaternion)
            velocity = self._velocity.value()
            if inputs.target is not None:
                x, y, z = vector_from_quaternion(
                    *multiply_quaternions(inputs.target, conjugate(quaternion))
                )
                pull = self._stiffness * x, self._stiffness * y, self._stiffness * z
        if report is None:
            drives = Drives.OPERATING if self._drives is None else Drives.OFF
        else:
            drives = (
                Drives.FAULT
                if report.fault is not None
                else (Drives.OPERATING if report.ready else Drives.OFF)
            )
        phase, is_absent = inputs.phase, inputs.is_absent
        is_enabled = self._by_teleop or self._is_enabled()
        engaged = not self._by_teleop or is_absent or phase is not Phase.DISENGAGED
        output = self._output = self._controller.take(
            ForceSample(
                stamp,
                angles,
                quaternion,
                velocity,
                level,
                self._noise,
                inputs.take(),
                inputs.sources,
                drives,
                is_enabled,
                engaged,
                not is_absent,
                phase is Phase.CLUTCHED,
                pull,
                inputs.weightless,
            )
        )
        if self._drives is not None:
            is_faulty = output.state.condition is Condition.FAULT
            self._report = self._drives.step(
                None if is_faulty else output.motor_torque, time.monotonic()
            )
        self._stamp, self._angles, self._quaternion = stamp, angles, quaternion
        if output.state != before:
            self._changes.append(output.state)
        if (
            self._is_wanted
            and quaternion is not None
            and output.rendered is not None
            and (self._grid.is_due(stamp))
        ):
            self._publish(stamp, output.rendered, rotation_from_quaternion(*quaternion))

    @property
    def state(self) -> ForceState:
        """State of the force feedback, as on the topic `force_state`."""
        return self._output.state

    def effort(self) -> list[float]:
        """Return the torque of each sensed joint, N m: as drives report it, else as commanded."""
        report = self._report
        torques = self._output.motor_torque if report is None else report.torques
        return [*torques, *[0.0] * (self._sensors - len(torques))]

    def acknowledge(self) -> bool:
        """End a latched fault, that of the drives too; return whether there was one."""
        report = self._report
        is_faulty = report is not None and report.fault is not None
        if self._drives is not None and is_faulty:
            self._drives.acknowledge()
        return self._controller.acknowledge() or is_faulty

    def close(self) -> None:
        """End all torque."""
        if self._drives is not None:
            self._drives.close()

    def _publish(self, stamp: int, rendered: Vector[float], rotation: Rotation[float]) -> None:
        """Publish the rendered torque, N m in the base frame, by R_base_platform."""
        for frame, message, out in self._outs:
            torque, header = message.wrench.torque, message.header
            header.stamp.sec, header.stamp.nanosec = divmod(stamp, SECOND)
            header.frame_id = frame.name
            torque.x, torque.y, torque.z = transposed_times(
                frame.rotation,
                transposed_times(rotation, rendered) if frame.in_handle else rendered,
            )
            out.publish(message)

    # Watch --------------------------------------------------------------------------------------

    def _watch(self) -> None:
        """Notice samples that do not come, and publish what has changed."""
        self._inputs.poll()
        self._is_wanted = any(out.get_subscription_count() for _, _, out in self._outs)
        with self._lock:
            missing = self._missing + 1
            if missing >= SILENT_PERIODS and self._stamp is not None:
                self.take(self._stamp + round(1e9 * WATCH_PERIOD), self._angles, None, inf)
            self._missing = missing
            self._noise = max(
                noise / sigma
                for noise, sigma in zip(self._supervisor.joints.noise(), self._sigma, strict=True)
            )
            changes, self._changes = self._changes, []
            output, quaternion, report = self._output, self._quaternion, self._report
        fault = '' if report is None or report.fault is None else f'; {report.fault}'
        for state in changes:
            self._state_out.publish(String(data=state.text))
            if state.condition is Condition.FAULT:
                self._warn(
                    f'force feedback: {state.text}' + (fault if state.why is Reason.DRIVE else '')
                )
        condition = output.state.condition
        own_level, text = LEVELS.get(condition, OK), output.state.text
        level, summary = own_level, text
        if condition in (Condition.OFF, Condition.READY):
            if output.obstacle is not None:
                summary = f'{text}; {output.obstacle.value}'
            elif condition is Condition.READY:
                summary = f'{text}; waits for wrenches below force.small_torque'
        elif output.state.why is Reason.DRIVE:
            text += fault
        caution = fault.removeprefix('; ') or self._inputs.caution
        if caution:
            level, summary = max(level, WARN), f'{summary}; {caution}'
        if self._status.is_due(level, summary):
            self._status.publish(
                level, summary, self._figures(output, quaternion, report), logged=(own_level, text)
            )

    def _figures(
        self, output: ForceOutput, quaternion: Quaternion[float] | None, report: DriveReport | None
    ) -> dict[str, object]:
        asked, rendered, inputs = hypot(*output.asked), output.rendered, self._inputs
        weakness = None if quaternion is None else self._controller.weakness(quaternion)
        age = inputs.age()
        found: dict[str, object] = {
            'torque asked of the handle (N m)': asked,
            'rendered fraction': 'none'
            if rendered is None or not asked
            else (hypot(*rendered) / asked),
            'motor torque (N m)': ' '.join(f'{torque:.3f}' for torque in output.motor_torque),
            '1 / s_3': 'none' if weakness is None else weakness,
            'energy (mJ)': 1e3 * output.energy,
            'share of the wrench left by the energy': output.share,
            'age of the wrench (s)': 'none' if age is None else age,
            'wrenches too old': inputs.stale,
            'wrenches in an unknown frame': inputs.refused,
            'sources of wrenches': inputs.sources,
            'orientation locked': 'no' if inputs.target is None else 'yes',
        }
        if report is not None:
            found['drives'] = report.fault or (
                'in operation' if report.ready else 'not in operation'
            )
            found['age of their status (s)'] = report.seconds_since_status
        return found
