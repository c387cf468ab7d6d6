# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node by which one slave follows the master: it feeds the machine and publishes the rest."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from math import radians
import threading
import time
from typing import Any

from geometry_msgs.msg import QuaternionStamped, WrenchStamped
from sensor_msgs.msg import JointState, Joy
from spm_haptic_master.force import ForceCondition
from spm_haptic_master.nodes.joint_reader import JointReader
from spm_haptic_master.nodes.slave_inputs import POSE_TOPIC, SlaveInputs, TROCAR_TOPIC
from spm_haptic_master.nodes.slave_torque import SLAVE_TOPIC, SlaveTorque
from spm_haptic_master.nodes.teleop_factory import make_teleoperation
from spm_haptic_master.nodes.teleop_outputs import CommandOutput, JawOutput
from spm_haptic_master.nodes.teleop_status import TeleopStatus
from spm_haptic_master.parameters.nodes import TELEOP_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import runner
from spm_haptic_master.ros.cdr import OrientationReader
from spm_haptic_master.ros.diagnostic_status import STEADY
from spm_haptic_master.ros.duplicate_publishers import Rivals
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.ros.qos import EVENTS, SAMPLES, STATE, WRENCHES
from spm_haptic_master.supervision.orientation_state import received_state
from spm_haptic_master.teleoperation.command import Command
from spm_haptic_master.teleoperation.engaging import Phase
from spm_haptic_master.teleoperation.vectors import FloatQuaternion
from spm_haptic_master.timing import SECOND
from std_msgs.msg import Float64MultiArray, String, UInt64
from std_srvs.srv import Trigger

# Period at which time passes without an input (s): the delay of `teleop_state`, not of commands.
WATCH_PERIOD = 0.01
# First button of a pedal that is pressed (0: released, 2: tapped), and of one without a button.
PRESSED = array('i', [1])
NO_BUTTON = array('i')
INSERTION_TOPIC = 'insertion/measured_js'
INSERTION_JOINT = 'insertion'
# Topics that may have one publisher only.
SINGLE = (
    'servo_cp',
    'orientation',
    'state',
    'enabled_at',
    POSE_TOPIC,
    TROCAR_TOPIC,
)


class Teleop(ParameterNode):
    """
    Publishes `servo_cp` for one slave while it is engaged, and nothing while it is not.

    It takes `orientation`, `state` and `insertion/measured_js` of the master, what the slave
    publishes, and the pedals `presence` and `clutch`. The commanded position is that of the slave
    at engaging, or pivots about its trocar. `delta_twist_cmds` has the rate of the commands, which
    fades to zero at the end. An `fkm` in the same process passes orientations to `take`; after
    `subscribe` they come from the topic.

    Parameters
    ----------
    parameters : Parameters
        Values from files and arguments; SettingError if one is invalid.

    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('teleop', parameters)
        values = self.declare(TELEOP_SETTINGS)
        self._machine = make_teleoperation(values)
        self._timeout: float = values['teleop.orientation_timeout']
        self._max_age = round(self._timeout * SECOND)
        self._has_limit = values['teleop.protection_limit_deg'] > 0.0
        # Guards all below: shared by the thread of the orientations and the executor.
        self._lock = threading.Lock()
        self._passed = time.monotonic()
        self._now = self.clock_reader()
        self._read_orientation = OrientationReader().read
        self._read_insertion = JointReader(INSERTION_JOINT).read
        self._insertion_stamp = 0
        # Word of the last `force_state`; empty before the first.
        self._force_word = ''
        self._output = CommandOutput(self, values, self._passed)
        use_frame: Callable[[str], None] = self._output.set_frame
        if values['teleop.frame_id']:
            use_frame = _ignore
        self._slave = SlaveInputs(self, values, self._machine, self._take, use_frame)
        self._inputs = self._slave.inputs
        self._jaw = JawOutput(self, values, self._inputs)
        # None where the hand feels nothing of the slave.
        self._torque: SlaveTorque | None = None
        if values['teleop.force_scale']:
            self._torque = SlaveTorque(self, values)
        self._status = TeleopStatus(self, self._machine, self._torque)
        self._subscribe_pedals()
        self._subscribe_master(values)
        single = [*SINGLE, INSERTION_TOPIC]
        if self._torque is not None:
            single.append(SLAVE_TOPIC)
            self._inputs.subscribe(WrenchStamped, SLAVE_TOPIC, self._on_torque, WRENCHES)
        self._rivals = Rivals(self, *single)
        self.create_service(Trigger, '~/enable', self._enable)
        self.create_service(Trigger, '~/disable', self._disable)
        self.create_timer(WATCH_PERIOD, self._watch, clock=STEADY)

    def _subscribe_pedals(self) -> None:
        """
        Subscribe to presence and clutch; a pedal whose publisher has gone is released.

        The pedals are the first buttons of `presence` and `clutch`.
        """
        subscribe = self._inputs.subscribe
        subscribe(Joy, 'presence', self._on_presence, EVENTS, gone=self._lose_presence)
        subscribe(Joy, 'clutch', self._on_clutch, EVENTS, gone=self._lose_clutch)

    def _on_presence(self, message: Joy) -> None:
        """Take whether the hand is present."""
        is_pressed = message.buttons[:1] == PRESSED
        self._take(self._machine.take_presence, is_pressed)

    def _lose_presence(self) -> None:
        """Take the hand for absent: nobody publishes the pedal."""
        self._take(self._machine.take_presence, False)

    def _on_clutch(self, message: Joy) -> None:
        """Take whether the clutch is pressed; a message without a button is no release."""
        is_pressed = message.buttons[:1] in (PRESSED, NO_BUTTON)
        self._take(self._machine.take_clutch, is_pressed)

    def _lose_clutch(self) -> None:
        """Take the clutch for unknown: nobody publishes the pedal."""
        self._take(self._machine.take_clutch, None)

    def _subscribe_master(self, values: Values) -> None:
        """Subscribe to what the master publishes beside its orientations."""
        subscribe = self._inputs.subscribe
        subscribe(String, 'state', self._on_state, STATE)
        subscribe(UInt64, 'enabled_at', self._on_enabled_at, STATE)
        subscribe(JointState, INSERTION_TOPIC, self._on_insertion, SAMPLES, raw=True)
        if values['teleop.force_loss'] == 'hold':
            subscribe(String, 'force_state', self._on_force_state, STATE)

    def _on_state(self, message: String) -> None:
        """Take the state of the orientation."""
        state = received_state(message.data)
        self._take(self._machine.take_state, state)

    def _on_force_state(self, message: String) -> None:
        """Take the state of the force feedback."""
        self._take(self._take_force_state, message.data)

    def subscribe(self) -> None:
        """Take orientations from the topic `orientation`."""
        self._inputs.subscribe(
            QuaternionStamped, 'orientation', self._on_orientation, SAMPLES, raw=True
        )
        if self._has_limit:
            self._inputs.subscribe(Float64MultiArray, 'protection_level', self._on_level, SAMPLES)

    def _on_orientation(self, data: bytes) -> None:
        """Take a serialized orientation from the topic."""
        self.take(*self._read_orientation(data))

    def take(
        self,
        stamp: int,
        quaternion: FloatQuaternion,
        level: float | None = None,
    ) -> None:
        """
        Take an orientation, and publish the command that follows from it.

        Parameters
        ----------
        stamp
            When the joints were sampled, ns.
        quaternion
            Orientation as published, x, y, z, w.
        level
            Its protection level, rad; None where that comes on a topic of its own.

        """
        with self._lock:
            self._pass_time()
            if not self._is_fresh(stamp):
                self._status.stale_orientations += 1
                return
            if level is not None and self._has_limit:
                self._machine.take_level(level)
            command = self._machine.take_master(stamp, quaternion)
            if command is not None:
                self._publish(stamp, command)
            self._status.publish_phase()

    def _is_fresh(self, stamp: int) -> bool:
        """
        Return whether a sample of the master, of a stamp in ns, is neither old nor to come.

        Parameters
        ----------
        stamp : int
            Time of the sample on the clock of the orientations.

        Returns
        -------
        bool
            Whether it is at most `teleop.orientation_timeout` before or after the present.

        """
        age: int = self._now() - stamp
        return bool(abs(age) <= self._max_age)

    def _publish(self, stamp: int, command: Command) -> None:
        """
        Publish a command of the slave and its jaw, unless it has become too old meanwhile.

        Parameters
        ----------
        stamp : int
            Time of the orientation that the command follows from, ns.
        command : Command
            Pose of the slave.

        """
        # This process may have been stopped since the time passed.
        if time.monotonic() - self._passed > self._timeout:
            self._pass_time()
            return
        self._output.publish(stamp, command, self._passed)
        self._status.count_command(stamp)
        self._jaw.follow(stamp, self._machine.starts, self._passed)

    def _pass_time(self) -> None:
        """Let the time pass since the last input, before each input: it must hide no silence."""
        now = time.monotonic()
        self._machine.pass_time(now - self._passed)
        self._passed = now

    def _watch(self) -> None:
        """
        Detect missing inputs, and let the twist fade.

        It runs every WATCH_PERIOD, also while nothing comes.
        """
        # One assignment: another thread may read the time meanwhile.
        self._now = self.clock_reader()
        external_block = self._rivals.found() or self._slave.obstacle()
        with self._lock:
            self._machine.external_block = external_block
            self._pass_time()
            is_engaged = self._machine.phase is Phase.ENGAGED
            self._output.fade(self._now(), self._passed, is_engaged)
            self._status.repeat()

    def _on_insertion(self, data: bytes) -> None:
        """
        Take an insertion of the master, from a serialized JointState.

        Parameters
        ----------
        data : bytes
            A serialized JointState with the insertion, m.

        """
        found = self._read_insertion(data)
        if found is None:
            return
        stamp, insertion = found
        with self._lock:
            self._pass_time()
            # One that is repeated, or that has waited, is none.
            if stamp > self._insertion_stamp and self._is_fresh(stamp):
                self._machine.take_insertion(insertion)
            self._insertion_stamp = stamp
            self._status.publish_phase()

    def _on_torque(self, message: WrenchStamped) -> None:
        """
        Forward the slave's torque to the hand while the slave follows.

        Parameters
        ----------
        message : WrenchStamped
            Force, N, and torque, N m, that the slave measures.

        """
        with self._lock:
            self._pass_time()
            pose = self._slave.pose
            is_engaged = self._machine.phase is Phase.ENGAGED
            if self._torque is not None and is_engaged and pose is not None:
                self._torque.forward(message, self._slave.frame, pose)

    def _on_enabled_at(self, message: UInt64) -> None:
        """Take the time of the master's enable, ns."""
        # System time, whatever the clock of the orientations is: a person gives it.
        age = (time.time_ns() - message.data) / SECOND
        self._take(lambda number: self._machine.take_enabling(number, age), message.data)

    def _on_level(self, message: Float64MultiArray) -> None:
        """Take the protection level, deg, which is the first number of its message."""
        if message.data:
            self._take(self._machine.take_level, radians(message.data[0]))

    def _take_force_state(self, text: str) -> None:
        """
        Hold the slave where the force has been lost: a fault, or switched off meanwhile.

        Parameters
        ----------
        text : str
            Words of `force_state`: a word, and the reason after a colon.

        """
        before = self._force_word
        self._force_word = text.partition(':')[0]
        is_fault = self._force_word == ForceCondition.FAULT.value
        self._machine.take_force_fault(f'force: {text}' if is_fault else '')
        is_off = self._force_word == ForceCondition.OFF.value
        if is_off and before not in ('', self._force_word):
            self._machine.disengage(f'force: {text}')

    def _take(self, take: Callable[[Any], None], value: object) -> None:
        """
        Let the time pass, pass a value to the machine, and publish what changes.

        Parameters
        ----------
        take : callable
            A method of the machine, which is called with the value.
        value : object
            What a message says.

        """
        with self._lock:
            self._pass_time()
            take(value)
            self._status.publish_state()

    def _enable(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Enable the tele-operation; the answer is its state, or what is in the way."""
        with self._lock:
            self._pass_time()
            obstacle = self._machine.enable()
            response.success = not obstacle
            response.message = obstacle or self._machine.state
        return response

    def _disable(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Disengage; the answer is always a success."""
        self._take(lambda _: self._machine.disengage(), None)
        response.success = True
        response.message = self._machine.state
        return response


def _ignore(_: str) -> None:
    """Ignore the frame of the slave's pose: another one is set."""


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('teleop', lambda _, add: add(Teleop).subscribe(), args)
