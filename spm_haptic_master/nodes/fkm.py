# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that turns each joint sample into the platform's orientation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, radians
import threading
import time

from geometry_msgs.msg import QuaternionStamped
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.force import ForceState
from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.nodes.crtk_state import CrtkState
from spm_haptic_master.nodes.factories import make_motors
from spm_haptic_master.nodes.force import Force, Surroundings
from spm_haptic_master.nodes.orientation_outputs import OrientationOutputs, publish_mounting
from spm_haptic_master.nodes.orientation_status import LatencyStatus, OrientationStatus
from spm_haptic_master.nodes.sample_origin import SampleOrigin
from spm_haptic_master.parameters.geometry import mechanism_checksum, mounting_from
from spm_haptic_master.parameters.nodes import NODE_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.parameters.setting import CALIBRATION_SETTING, Values
from spm_haptic_master.ros import diagnostic_status, runner
from spm_haptic_master.ros.cdr import JointsFormat, OrientationWriter
from spm_haptic_master.ros.diagnostic_status import CHECK_PERIOD, REPEAT_PERIOD, STEADY
from spm_haptic_master.ros.overload import Overload, TOO_BUSY
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.supervision.checkability import unchecked_anywhere
from spm_haptic_master.supervision.orientation_state import (
    Condition,
    OrientationState,
    silent,
    STARTING,
)
from spm_haptic_master.supervision.supervisor import make_supervisor
from spm_haptic_master.teleoperation.operating_state import ENABLED
from spm_haptic_master.timing import SECOND
from std_msgs.msg import String
from std_srvs.srv import Trigger

# States without samples, and on a machine that is too busy.
NO_SAMPLES = silent('no joint samples')
BUSY = silent(TOO_BUSY)


class Fkm(ParameterNode):
    """
    Publishes `orientation` for each joint sample that passes the supervision.

    Nothing is published for a sample that is incomplete, misnamed, not finite, stale, out of
    order or inconsistent. `state` is published when it changes; the operating state follows it. A
    driver in the same process passes samples to `take`; after `subscribe` they come from the
    topic `measured_js`.

    Parameters
    ----------
    parameters : Parameters
        Files and arguments of the process.

    Raises
    ------
    SettingError
        A parameter is missing or not valid, or two of them contradict each other.

    Attributes
    ----------
    driver_overload : callable
        Returns the words of a driver in this process that loses time, else an empty text.
    followers : list of callable
        Are called with stamp (ns), quaternion x, y, z, w and protection level (rad) of each
        `orientation` after it is published, before any other output.
    quaternion : tuple of 4 float, or None
        Orientation published last, x, y, z, w, as mounted; None before the first.
    protection_level : float or None
        Protection level of that orientation, rad.
    state : OrientationState
        As on the topic `state`.
    status : OrientationStatus
        The entry `orientation` on /diagnostics, with its cautions.
    latency_status : LatencyStatus
        The entry `timing` on /diagnostics, with rate and latency.

    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('fkm', parameters)
        values = self.declare(NODE_SETTINGS['fkm'])
        self._supervisor = make_supervisor(values)
        self._warn_of_unchecked(values)
        self._mounting = mounting_from(values)
        frame, frames = publish_mounting(self, values)
        mechanism = mechanism_checksum(values)
        self._origin = SampleOrigin(self, mechanism, values[CALIBRATION_SETTING.name])
        self._overload = Overload(CHECK_PERIOD)
        # Returns the words of a driver in this process that loses time; else empty.
        self.driver_overload: Callable[[], str] = str
        self._read_joints = JointsFormat(values['sensors']).read
        self._max_age = round(values['max_age'] * SECOND)
        self._sample_timeout = values['sample_timeout']
        self._now = self.clock_reader()
        # Called with stamp (ns), quaternion and protection level (rad) of each `orientation` after
        # it is published, before any other output.
        self.followers: list[Callable[[int, Quaternion[float], float], None]] = []
        # Guards all below: shared by the thread of the samples and the timers.
        self._lock = threading.Lock()
        # Orientation published last, as mounted, and its level, rad; None before the first.
        self.quaternion: Quaternion[float] | None = None
        self.protection_level: float | None = None
        self.latency_status = LatencyStatus(self, values['rate'], values['latency_limit'])
        constants = {diagnostic_status.CHECKSUM_KEY: mechanism}
        if frames:
            constants['mounting'] = frames
        self.status = OrientationStatus(self, values, self._supervisor, constants)
        # Reason and detail of what forbids any orientation; None if nothing does.
        self._obstacle: tuple[str, str] | None = None
        # States of the samples since the last poll that reached the supervision.
        self._changes: list[OrientationState] = []
        # Samples received until the last poll, and when one last came (s, monotonic).
        self._polled = 0
        self._last_received: float | None = None
        # As on the topic `state`.
        self.state = STARTING
        self._is_announced = False
        self._state_out = self.create_publisher(String, 'state', STATE)
        self._write_orientation = OrientationWriter(frame).write
        self._orientation_out = self.create_publisher(QuaternionStamped, 'orientation', SAMPLES)
        self._outputs = OrientationOutputs(self, values, frame, self._supervisor)
        self._crtk = CrtkState(self, frame)
        self._force = self._make_force(values, frame)
        self.create_service(Trigger, '~/acknowledge', self._acknowledge)
        self.on_change(('alert_limit_deg',), self._apply)
        self.create_timer(CHECK_PERIOD, self._poll, clock=STEADY)
        self.create_timer(REPEAT_PERIOD, self._publish_latency, clock=STEADY)

    def _warn_of_unchecked(self, values: Values) -> None:
        """Log which sensors the others can check nowhere with these settings."""
        unchecked = unchecked_anywhere(values)
        if unchecked:
            self.get_logger().warning(unchecked)

    def _make_force(self, values: Values, frame: str) -> Force | None:
        """
        Return the force feedback behind each orientation; None where it is not enabled.

        Raises
        ------
        SettingError
            Two settings of the force feedback contradict each other.

        """
        if not values['force.enabled']:
            return None
        surroundings = Surroundings(
            frame_id=frame,
            now=lambda: self._now(),
            is_enabled=lambda: self._crtk.name == ENABLED,
            warn=self._crtk.warn,
            lock=self._lock,
        )
        force = Force(self, values, *make_motors(values), self._supervisor, surroundings)
        self._outputs.effort = force.effort
        return force

    @property
    def force_state(self) -> ForceState | None:
        """State of the force feedback, as on the topic `force_state`; None without."""
        if self._force is None:
            return None
        return self._force.state

    def destroy_node(self) -> None:
        """
        End the torque, publish the end to what drives a slave, and destroy the node.

        The end is published before the topics go.
        """
        if self._force is not None:
            with self._lock:
                self._force.close()
        self._crtk.end()
        super().destroy_node()

    def subscribe(self) -> None:
        """Take samples from the topic `measured_js`."""
        self._origin.watch()
        self.create_subscription(JointState, 'measured_js', self._on_joints, SAMPLES, raw=True)

    def _apply(self, changed: Values) -> None:
        """
        Use changed settings from the next sample on.

        Parameters
        ----------
        changed : mapping
            Checked values of the live settings that have changed, by name.

        """
        if 'alert_limit_deg' in changed:
            with self._lock:
                self._supervisor.alert_limit = radians(changed['alert_limit_deg'])

    def _acknowledge(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """
        Clear one fault that waits for a person, and name it: of the sensors, then of force.

        One call clears one fault, so that each is read before it is cleared. The answer is a
        failure if no fault waits.
        """
        with self._lock:
            of_sensors = self._supervisor.acknowledge()
            named = f'sensors: {of_sensors.ended}' if of_sensors.ended else ''
            if not named and self._force is not None:
                named = self._force.acknowledge()
        response.success = bool(named)
        words = [f'acknowledged: {named}' if named else 'no fault waits for an acknowledgement']
        if of_sensors.waits:
            words.append(f'the sensors wait for {of_sensors.waits}')
        response.message = '; '.join(words)
        return response

    def _on_joints(self, joints: bytes) -> None:
        """
        Take a serialized sample from the topic; one that is none is counted as rejected.

        Parameters
        ----------
        joints : bytes
            A serialized JointState.

        """
        try:
            stamp, angles = self._read_joints(joints)
        except RejectedError as rejection:
            with self._lock:
                self.status.received.count += 1
                self.status.reject(rejection)
            return
        self.take(stamp, angles)

    def take(self, stamp: int, angles: tuple[float, ...]) -> None:
        """
        Publish the orientation of a sample, if it passes the supervision.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : tuple of float
            The sensors' angles, rad; NaN is a joint without a reading.

        """
        with self._lock:
            self.status.received.count += 1
            if self._obstacle is not None:
                self.status.reject(RejectedError(*self._obstacle))
                return
            age = self._now() - stamp
            if not -self._max_age <= age <= self._max_age:
                self.status.reject(self._origin.rejection(age, self._max_age))
                return
            verdict = self._supervisor.take(stamp, angles)
            if not self._changes or verdict.announced is not self._changes[-1]:
                self._changes.append(verdict.announced)
            if verdict.estimate is not None:
                self._publish(stamp, angles, verdict.estimate, verdict.protection_level)
                return
            if verdict.cause is not None:
                self.status.reject(RejectedError(verdict.cause.words, verdict.cause.detail))
            if self._force is not None:
                self._force.take(stamp, angles, None, inf)

    def _publish(
        self,
        stamp: int,
        angles: tuple[float, ...],
        estimate: SampleEstimate,
        level: float,
    ) -> None:
        """
        Publish the orientation of a sample, then everything that follows it.

        The order matters: the orientation first, then the torque, the followers, and the outputs
        that have a subscriber.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : tuple of float
            The sensors' angles, rad; NaN is a joint without a reading.
        estimate : SampleEstimate
            R_base_platform with its covariance; it is published as mounted.
        level : float
            Protection level, rad.

        """
        measured = estimate.quaternion
        if self._mounting is not None:
            estimate = self._mounting.applied(estimate)
        self.quaternion = estimate.quaternion
        self.protection_level = level
        self._orientation_out.publish(self._write_orientation(stamp, estimate.quaternion))
        published = time.time_ns()
        if self._force is not None:
            self._force.take(stamp, angles, measured, level)
        for follow in self.followers:
            follow(stamp, estimate.quaternion, level)
        # The supervisor has a parity since the first sample that it has not rejected.
        self.latency_status.add(stamp, published, self._supervisor.parity or 0.0)
        if self._outputs.wanted:
            self._outputs.publish(stamp, angles, estimate, level)

    def _poll(self) -> None:
        """Update the clock and the subscribed outputs, and evaluate the samples since then."""
        # One assignment: another thread may read the time meanwhile.
        self._now = self.clock_reader()
        self._outputs.count_subscribers()
        self._overload.tick(time.monotonic(), reported=self.driver_overload())
        self.latency_status.busy = self._overload.words or self.latency_status.busy
        obstacle = self._origin.obstacle()
        with self._lock:
            self._obstacle = obstacle
            self._evaluate()

    def _publish_latency(self) -> None:
        """Publish the entry `timing`, and show the calibration watch the latest sample."""
        with self._lock:
            self.latency_status.publish()
            self.status.watch_calibration()

    def _evaluate(self) -> None:
        """Derive the state from the samples since the last poll, and publish what changed."""
        count = self.status.received.count
        received = count - self._polled
        self._polled = count
        changes = self._changes
        self._changes = []
        found = self._state_now(received, changes)
        if found is None:
            return  # a pause shorter than the time-out changes nothing
        state, text = self._explained(found)
        self.status.publish(state, text, self.protection_level)
        # Each state between two polls is announced, but where overload explains the last one.
        if changes and state is changes[-1]:
            announced = changes
        else:
            announced = [state]
        for each in announced:
            self._announce(each)

    def _state_now(
        self,
        received: int,
        changes: Sequence[OrientationState],
    ) -> OrientationState | None:
        """
        Return the state by the samples since the last poll; None where it stays as it is.

        Parameters
        ----------
        received : int
            Number of samples since the last poll.
        changes : sequence of OrientationState
            States since then of samples that reached the supervision, each once in a row.

        Returns
        -------
        OrientationState or None
            Silent with a reason if there is an obstacle, if no sample came for `sample_timeout`,
            or if all were rejected before the supervision; starting before the first sample; else
            the last of `changes`.

        """
        now = time.monotonic()
        if received:
            self._last_received = now
        if self._obstacle is not None:
            reason, _ = self._obstacle
            return silent(reason)
        if self._last_received is None:
            return STARTING
        if now - self._last_received > self._sample_timeout:
            return NO_SAMPLES
        if not received:
            return None
        if changes:
            return changes[-1]
        rejection = self.status.rejection
        return silent('' if rejection is None else rejection.reason)

    def _announce(self, state: OrientationState) -> None:
        """Publish the state on `state` and on CRTK's topics, if it is another one."""
        if state == self.state and self._is_announced:
            return
        self.state = state
        self._is_announced = True
        self._state_out.publish(String(data=state.text))
        self._crtk.take(state)

    def _explained(self, state: OrientationState) -> tuple[OrientationState, str]:
        """
        Return state and message; overload, if it explains the silence.

        Parameters
        ----------
        state : OrientationState
            State by the samples.

        Returns
        -------
        tuple of OrientationState and str
            BUSY in place of a silence that the lost time of this process explains, and the words
            for /diagnostics.

        """
        symptom = ''
        if state.condition is Condition.SILENT and self._obstacle is None:
            symptom = state.text
        if self._overload.explains(symptom):
            return BUSY, silent(self._overload.words).text
        if state == BUSY:
            return state, silent(str(self.status.rejection)).text
        return state, state.text


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('fkm', lambda _, add: add(Fkm).subscribe(), args)
