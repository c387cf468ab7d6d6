# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback: motor torques for each joint sample."""

from __future__ import annotations

from operator import sub

from spm_haptic_master.exceptions import InputError, quoted, SpmError
from spm_haptic_master.force.energy import EnergyBudget, HANDLE_DAMPING, JOINT_DAMPING
from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.force_state import (
    Condition,
    DRIVE_FADE,
    ENGAGED,
    FADE,
    ForceState,
    HOLDING,
    LATCHED,
    OFF,
    READY,
    Reason,
)
from spm_haptic_master.force.gravity import Gravity
from spm_haptic_master.force.joint_motion import JointMotion
from spm_haptic_master.force.motor_rates import (
    FOUR,
    motor_rates,
    rate_constants,
    THREE,
)
from spm_haptic_master.force.obstacles import Obstacles, SmallForce
from spm_haptic_master.force.samples import Drives, ForceOutput, ForceSample
from spm_haptic_master.force.shaping import clipped, NOTHING, Shaper
from spm_haptic_master.force.statics import smallest_singular_value, statics_of
from spm_haptic_master.kinematics.checks import check_working_mode, WorkingMode
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.number_backends import Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion

# Longest time between two samples after which the torque goes on (s).
GAP = 0.01
# Time without torque between off and ready (s).
IDLE = 0.1


class ForceController:
    """
    Motor torques for each joint sample, by the state of the force feedback.

    Parameters
    ----------
    geometry : Geometry
        Link angles and axes.
    working_mode : tuple of three int
        Signs of B_kk, legs A, B, C.
    motors : {3, 4}
        3: on th1A, th1B, th1C; 4: on th3A as well.
    limits : ForceLimits
        Limits.
    gravity : Gravity, optional
        What is compensated; nothing by default.

    Raises
    ------
    InputError
        An argument has a wrong type or value.

    """

    def __init__(self, geometry: Geometry = PAPER_GEOMETRY,
                 working_mode: WorkingMode = RIG_WORKING_MODE, motors: int = THREE,
                 limits: ForceLimits | None = None, gravity: Gravity | None = None) -> None:
        if motors not in (THREE, FOUR):
            raise InputError(f'motors = {quoted(motors)}: expected 3, or 4 (with th3A)')
        self._legs = rate_constants(check_geometry(geometry), check_working_mode(working_mode))
        self._motors = motors
        self._weight = None if gravity is None else gravity.on(self._legs)
        self._limits = limits = ForceLimits() if limits is None else limits
        self._obstacles = Obstacles(limits)
        self._small = SmallForce(limits)
        self._shaper = Shaper(limits.torque, limits.slew)
        self._energy = EnergyBudget()
        self._motion = JointMotion(motors)
        self._zero = (0.0,) * motors
        # Commands of the last two samples: whole, and without gravity.
        self._last = self._before = self._last_counted = self._counted = self._zero
        # Torques from which a fade began.
        self._from = self._zero
        self._stamp: int | None = None
        # Times since torque came up, since the wrench did, and without torque, s; share of the
        # torque that the fade has left, and of the weight that is compensated.
        self._powered_time = self._wrench_time = self._idle = self._left = self._borne = 0.0
        self._state = OFF

    def acknowledge(self) -> bool:
        """End a latched fault; return whether there was one."""
        if self._state.condition is not Condition.FAULT:
            return False
        self._enter(OFF)
        return True

    def weakness(self, quaternion: Quaternion[float]) -> float | None:
        """
        Return 1 / s_3 of a pose: the worst motor torque for a torque on the handle (unit 1).

        None beyond the reach of a leg, and at the parallel singularity of three motors.
        """
        try:
            rows, _ = motor_rates(rotation_from_quaternion(*quaternion), self._legs, self._motors)
        except SpmError:
            return None
        smallest = smallest_singular_value(rows)
        return 1.0 / smallest if smallest else None

    def take(self, sample: ForceSample) -> ForceOutput:
        """Return the motor torques for a sample: once for each, in the order of their stamps."""
        stamp, motion = sample.stamp, self._motion
        dt = 0.0 if self._stamp is None else 1e-9 * (stamp - self._stamp)
        self._stamp = stamp
        if not 0.0 < dt <= GAP:
            # The drives may have dropped the torque meanwhile: it begins from zero.
            motion.restart()
            self._shaper.restart()
            dt = 0.0
        motion.take(stamp, sample.angles)
        energy, state = self._energy, self._state
        turned, generated = motion.turned, False
        if turned is not None and (state is ENGAGED or state is HOLDING):
            generated = energy.take(self._counted, turned, dt)
        obstacle = self._obstacles.take(
            sample, motion.is_missing, self._before, dt, generated, state is HOLDING)
        if obstacle is not None or state is not ENGAGED or sample.clutched:
            self._change(sample, obstacle, dt)
            state = self._state
        torques = counted = self._zero
        rendered: Vector[float] | None = NOTHING
        if state is ENGAGED or state is HOLDING:
            torques, counted, rendered = self._powered(sample, dt)
            state = self._state
        if state.condition is Condition.FADING:
            torques, rendered = self._faded(dt), None
            state = self._state
        self._before, self._counted = self._last, self._last_counted
        self._last, self._last_counted = torques, counted
        # As ForceOutput(...) does, without its call.
        return tuple.__new__(ForceOutput, (state, torques, self._shaper.torque, rendered, obstacle,
                                           energy.energy, energy.share))

    # State --------------------------------------------------------------------------------------

    def _change(self, sample: ForceSample, obstacle: Reason | None, dt: float) -> None:
        """Change the state where a sample asks for it."""
        condition = self._state.condition
        may_begin = self._small.take(sample.wrench, sample.stamp) and not sample.clutched
        wanted = sample.enabled and sample.drives is Drives.OPERATING
        if condition is Condition.OFF:
            self._idle = self._idle + dt if wanted else 0.0
            if self._idle >= IDLE:
                self._enter(READY)
        elif condition is Condition.READY:
            if not wanted:
                self._enter(OFF)
            elif may_begin and obstacle is None:
                self._enter(ENGAGED)
        elif condition is Condition.FADING:
            why = self._state.why
            if obstacle in LATCHED and why not in LATCHED:
                self._enter(ForceState(Condition.FADING, obstacle))
        elif condition is not Condition.FAULT:
            if obstacle is not None:
                self._enter(ForceState(Condition.FADING, obstacle))
            elif condition is Condition.ENGAGED and sample.clutched:
                self._enter(HOLDING)
            elif condition is Condition.HOLDING and may_begin:
                self._enter(ENGAGED)

    def _enter(self, state: ForceState) -> None:
        """Assign the state: the only place."""
        before = self._state.condition
        self._small.restart()
        self._energy.restart()
        self._idle = self._wrench_time = 0.0
        if before is not Condition.FADING:
            self._left, self._from = 1.0, self._last
        if before not in (Condition.ENGAGED, Condition.HOLDING) or (
                state.condition is Condition.FADING):
            # Between engaged and holding the torque follows the slew rate.
            self._shaper.restart()
            self._powered_time = self._borne = 0.0
        self._state = state

    # Torque -------------------------------------------------------------------------------------

    def _powered(self, sample: ForceSample, dt: float,
                 ) -> tuple[tuple[float, ...], tuple[float, ...], Vector[float] | None]:
        """Return the motor torques, those without gravity, and what the handle gets."""
        limits, energy = self._limits, self._energy
        if sample.quaternion is None:
            raise InputError('no orientation in a state with torque')
        rotation = rotation_from_quaternion(*sample.quaternion)
        try:
            statics, rows, poses = statics_of(rotation, self._legs, self._motors, limits)
        except SpmError:
            # A leg is at the edge of its reach.
            self._enter(ForceState(Condition.FADING, Reason.NO_ORIENTATION))
            return self._zero, self._zero, None
        self._powered_time = time = self._powered_time + dt
        self._wrench_time = wrench_time = self._wrench_time + dt
        whole = limits.ramp
        ramp = time / whole if time < whole else 1.0
        x, y, z = asked = self._shaper.take(
            self._arrived(sample, rotation), wrench_time / whole if wrench_time < whole else 1.0,
            dt, NOTHING if sample.lock is NOTHING else self._locked(sample, ramp))
        energy.note(asked)
        if sample.velocity is not None:
            wx, wy, wz = sample.velocity
            damping = ramp * limits.damping + energy.damping * HANDLE_DAMPING
            x, y, z = x - damping * wx, y - damping * wy, z - damping * wz
        held = None
        if self._weight is not None:
            borne = self._borne + (dt if sample.weightless else -dt) / whole
            self._borne = borne = min(1.0, max(0.0, borne))
            gx, gy, gz = self._weight.torque(rotation, rows, poses)
            gx, gy, gz = borne * gx, borne * gy, borne * gz
            held, _ = statics.render((gx, gy, gz))
            x, y, z = x + gx, y + gy, z + gz
        torques, rendered = statics.render((x, y, z))
        if energy.damping > 0.0:
            torques = self._within(torques, energy.damping)
            rendered = statics.rendered(torques)
        return torques, torques if held is None else tuple(map(sub, torques, held)), rendered

    def _arrived(self, sample: ForceSample, rotation: Rotation[float]) -> Vector[float]:
        """Return the wrench that is to be rendered, in the base frame, N m."""
        if self._state is not ENGAGED or sample.wrench is None or sample.velocity is None:
            # Without a velocity nothing could damp what the wrench does.
            return NOTHING
        share = self._energy.share
        _, (x, y, z), in_handle = sample.wrench
        if in_handle:
            r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
            x, y, z = (r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z,
                       r20 * x + r21 * y + r22 * z)
        return share * x, share * y, share * z

    def _locked(self, sample: ForceSample, ramp: float) -> Vector[float]:
        """Return the torque towards a locked orientation, in the base frame, N m."""
        if sample.velocity is None:
            return NOTHING
        share = ramp * self._energy.share
        x, y, z = sample.lock
        return share * x, share * y, share * z

    def _faded(self, dt: float) -> tuple[float, ...]:
        """Return what the fade has left of the torques; end it where that is nothing."""
        why = self._state.why
        # After a gap, or where time stands still, there is nothing to go on from.
        self._left -= dt / (DRIVE_FADE if why is Reason.DRIVE else FADE) if dt else 1.0
        if why is None or self._left <= 0.0:
            self._enter(ForceState(Condition.FAULT, why) if why in LATCHED else READY)
            return self._zero
        return tuple([self._left * torque for torque in self._within(self._from, 1.0)])

    def _within(self, torques: tuple[float, ...], damping: float) -> tuple[float, ...]:
        """Add a share of the joint damping, and keep each motor within its limit."""
        limit, velocity = self._limits.motor_torque, self._motion.velocity
        if velocity is not None:
            torques = tuple([torque - damping * JOINT_DAMPING * rate
                             for torque, rate in zip(torques, velocity, strict=True)])
        return tuple([clipped(torque, limit) for torque in torques])
