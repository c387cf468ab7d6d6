# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node by which one slave follows the master: it feeds the machine and publishes the rest."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from math import degrees, isfinite, radians
import threading
import time
from typing import Any

from geometry_msgs.msg import PoseStamped, QuaternionStamped, WrenchStamped
from sensor_msgs.msg import Joy
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.nodes.factories import make_teleoperation
from spm_haptic_master.nodes.teleop_outputs import SLAVE_TOPIC, SlaveTorque, TwistOutput
from spm_haptic_master.parameters.nodes import TELEOP_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros import node_log, runner
from spm_haptic_master.ros.cdr import OrientationReader, PoseWriter
from spm_haptic_master.ros.diagnostic_status import OK, StatusPublisher, STEADY, WARN
from spm_haptic_master.ros.duplicate_publishers import Rivals
from spm_haptic_master.ros.inputs import Inputs
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.ros.qos import COMMANDS, EVENTS, SAMPLES, STATE, WRENCHES
from spm_haptic_master.supervision.orientation_state import received_state
from spm_haptic_master.teleoperation.engaging import Phase
from spm_haptic_master.timing import LatencyMeter, RateMeter, SECOND
from std_msgs.msg import Float64MultiArray, String, UInt64
from std_srvs.srv import Trigger

# Period at which time passes without an input (s): the delay of `teleop_state`, not of commands.
WATCH_PERIOD = 0.01
# Time between two messages of an unchanged `teleop_state` (s): one older than three of them is
# no longer valid.
STATE_PERIOD = 0.2
# Time without a command after which the twist fades (command periods).
FADE_PERIODS = 2.5
# First button of a pedal that is pressed (0: released, 2: tapped), and of one without a button.
PRESSED, NO_BUTTON = array('i', [1]), array('i')


class Teleop(ParameterNode):
    """
    Publishes `servo_cp` for one slave while it is engaged, and nothing while it is not.

    It takes `orientation` and `state` of the master, `slave/measured_cp` of the slave, and the
    pedals `presence` and `clutch`. `servo_cp` has the position of the slave at engaging.
    `delta_twist_cmds` has the rate of the commands, which fades to zero at the end. An `fkm` in
    the same process passes orientations to `take`; after `subscribe` they come from the topic.
    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('teleop', parameters)
        values = self.declare(TELEOP_SETTINGS)
        self._machine = make_teleoperation(values)
        self._timeout: float = values['teleop.orientation_timeout']
        self._max_age = round(self._timeout * SECOND)
        self._has_limit = values['teleop.protection_limit_deg'] > 0.0
        rate = min(values['teleop.command_rate'], values['rate']) or values['rate']
        self._period = 1.0 / rate
        # Guards all below: shared by the thread of the orientations and the executor.
        self._lock = threading.Lock()
        self._passed = self._commanded_at = time.monotonic()
        self._now = self.clock_reader()
        self._read = OrientationReader().read
        self._takes_frame = not values['teleop.frame_id']
        # Frame and stamp of the slave's last pose; None before the first.
        self._slave_frame: str | None = None
        self._slave_stamp: tuple[int, int] | None = None
        # Position of the slave, and that of the commands since the start of this number, m.
        self._position: Vector[float] = (0.0, 0.0, 0.0)
        self._held, self._start = self._position, 0
        self._make_outputs(values['teleop.acceleration_limit'])
        self._use_frame(values['teleop.frame_id'])
        self._inputs = Inputs(self)
        subscribe = self._inputs.subscribe
        subscribe(PoseStamped, 'slave/measured_cp', self._on_slave, EVENTS)
        machine = self._machine
        subscribe(
            Joy,
            'presence',
            lambda message: self._take(machine.take_presence, message.buttons[:1] == PRESSED),
            EVENTS,
            gone=lambda: self._take(machine.take_presence, False),
        )
        # A message without a button is no release.
        subscribe(
            Joy,
            'clutch',
            lambda message: self._take(
                machine.take_clutch, message.buttons[:1] in (PRESSED, NO_BUTTON)
            ),
            EVENTS,
            gone=lambda: self._take(machine.take_clutch, None),
        )
        subscribe(
            String,
            'state',
            lambda message: self._take(machine.take_state, received_state(message.data)),
            STATE,
        )
        subscribe(UInt64, 'enabled_at', self._on_enabled_at, STATE)
        topics = ['servo_cp', 'orientation', 'state', 'enabled_at', 'slave/measured_cp']
        # None where the hand feels nothing of the slave.
        self._torque = SlaveTorque(self, values) if values['teleop.force_scale'] else None
        if self._torque is not None:
            topics.append(SLAVE_TOPIC)
            subscribe(WrenchStamped, SLAVE_TOPIC, self._on_torque, WRENCHES)
        self._rivals = Rivals(self, *topics)
        self.create_service(Trigger, '~/enable', self._enable)
        self.create_service(Trigger, '~/disable', self._disable)
        self.create_timer(WATCH_PERIOD, self._watch, clock=STEADY)

    def _make_outputs(self, acceleration: float) -> None:
        self._out = self.create_publisher(PoseStamped, 'servo_cp', COMMANDS)
        self._twist = TwistOutput(self, acceleration, self._period, self._passed)
        self._state_out = self.create_publisher(String, 'teleop_state', STATE)
        self._state = ''
        self._stated_at = 0.0
        self._phase = Phase.DISENGAGED
        self._latency, self._commands = LatencyMeter(), RateMeter()
        self._stale = 0
        self._status = StatusPublisher(self, 'teleop', 'slave', logs=False)

    def _use_frame(self, frame: str) -> None:
        """Use a frame_id in the commands."""
        self._write = PoseWriter(frame).write
        self._twist.set_frame(frame)

    def subscribe(self) -> None:
        """Take orientations from the topic `orientation`."""
        self._inputs.subscribe(
            QuaternionStamped,
            'orientation',
            lambda data: self.take(*self._read(data)),
            SAMPLES,
            raw=True,
        )
        if self._has_limit:
            self._inputs.subscribe(Float64MultiArray, 'protection_level', self._on_level, SAMPLES)

    def take(self, stamp: int, quaternion: Quaternion[float], level: float | None = None) -> None:
        """Take an orientation of a stamp (ns) and its level (rad), and publish the command."""
        with self._lock:
            self._pass_time()
            if not -self._max_age <= self._now() - stamp <= self._max_age:
                self._stale += 1
                return
            if level is not None and self._has_limit:
                self._machine.take_level(level)
            command = self._machine.take_master(stamp, quaternion)
            if command is not None:
                self._publish(stamp, command)
            if self._machine.phase is not self._phase:
                self._publish_state()

    def _publish(self, stamp: int, command: Quaternion[float]) -> None:
        # This process may have been stopped since the time passed.
        if time.monotonic() - self._passed > self._timeout:
            self._pass_time()
            return
        if self._machine.starts != self._start:
            self._start, self._held = self._machine.starts, self._position
        self._out.publish(self._write(stamp, self._held, command))
        self._commanded_at = self._passed
        self._commands.count += 1
        self._latency.add(time.time_ns() - stamp)
        self._twist.follow(stamp, self._machine.velocity, self._passed)

    def _pass_time(self) -> None:
        """Let the time pass since the last input, before each input: it must hide no silence."""
        now = time.monotonic()
        self._machine.pass_time(now - self._passed)
        self._passed = now

    def _watch(self) -> None:
        """Detect missing inputs, and let the twist fade."""
        # One assignment: another thread may read the time meanwhile.
        self._now = self.clock_reader()
        external_block = self._rivals.found() or self._inputs.unheard()
        with self._lock:
            self._machine.external_block = external_block
            self._pass_time()
            if (
                self._phase is not Phase.ENGAGED
                or self._passed - self._commanded_at > FADE_PERIODS * self._period
            ):
                self._twist.fade(self._now(), self._passed)
            self._publish_state(repeats=self._passed - self._stated_at >= STATE_PERIOD)
            self._report()

    def _on_slave(self, message: PoseStamped) -> None:
        p, q = message.pose.position, message.pose.orientation
        position = p.x, p.y, p.z
        # The position is commanded, too: without one the pose is not usable.
        usable = all(map(isfinite, position))
        frame, at = message.header.frame_id, message.header.stamp
        stamp = at.sec, at.nanosec
        with self._lock:
            self._pass_time()
            # A bridge may repeat its last pose; a pose without a stamp counts as new.
            if stamp == self._slave_stamp and any(stamp):
                return
            self._slave_stamp = stamp
            if frame != self._slave_frame:
                self._machine.disengage('another frame of the slave')
                self._slave_frame = frame
                if self._takes_frame:
                    self._use_frame(frame)
            self._position = position
            self._machine.take_slave((q.x, q.y, q.z, q.w) if usable else (0.0,) * 4)

    def _on_torque(self, message: WrenchStamped) -> None:
        with self._lock:
            self._pass_time()
            if self._torque is not None and self._machine.phase is Phase.ENGAGED:
                self._torque.forward(message, self._slave_frame)

    def _on_enabled_at(self, message: UInt64) -> None:
        # System time, whatever the clock of the orientations is: a person gives it.
        age = (time.time_ns() - message.data) / SECOND
        self._take(lambda number: self._machine.take_enabling(number, age), message.data)

    def _on_level(self, message: Float64MultiArray) -> None:
        if message.data:
            self._take(self._machine.take_level, radians(message.data[0]))

    def _take(self, take: Callable[[Any], None], value: object) -> None:
        with self._lock:
            self._pass_time()
            take(value)
            self._publish_state()

    def _enable(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._lock:
            self._pass_time()
            obstacle = self._machine.enable()
            response.success = not obstacle
            response.message = obstacle or self._machine.state
        return response

    def _disable(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._take(lambda _: self._machine.disengage(), None)
        response.success, response.message = True, self._machine.state
        return response

    def _publish_state(self, repeats: bool = False) -> None:
        """Publish the state where it has changed, or again; log a change."""
        state = self._machine.state
        if state == self._state and not repeats:
            return
        self._state, self._stated_at = state, time.monotonic()
        self._state_out.publish(String(data=state))
        before, self._phase = self._phase, self._machine.phase
        if before is self._phase:
            return
        if self._phase is Phase.DISENGAGED:
            node_log.warning(self, f'disengaged: {self._machine.last_disengage_reason}')
        else:
            node_log.info(self, state)

    def _report(self) -> None:
        """Publish the entry on /diagnostics."""
        level = WARN if self._machine.is_blocked else OK
        if not self._status.is_due(level, self._state):
            return
        offset = self._machine.offset
        p50, p99 = self._latency.percentiles(0.5, 0.99) or ('none', 'none')
        self._status.publish(
            level,
            self._state,
            {
                'command rate (Hz)': self._commands.rate(),
                'latency p50 (us)': p50,
                'latency p99 (us)': p99,
                'engaged or clutched off (times)': self._machine.starts,
                'disengaged last by': self._machine.last_disengage_reason or 'nothing',
                'angle from master to slave (deg)': 'none' if offset is None else degrees(offset),
                'stale orientations': self._stale,
                **(
                    {}
                    if self._torque is None
                    else {
                        'torques to the hand': self._torque.count,
                        'torques in another frame': self._torque.refused,
                    }
                ),
            },
        )


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('teleop', lambda _, add: add(Teleop).subscribe(), args)
