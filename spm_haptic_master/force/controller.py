# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback: motor torques for each joint sample."""

from __future__ import annotations

from math import dist, hypot, inf

import numpy as np
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.force.energy import (
    EnergyBudget,
    HANDLE_DAMPING,
    JOINT_DAMPING,
    JointMotion,
)
from spm_haptic_master.force.gravity import Gravity, Weight
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.force.samples import (
    Condition,
    DRIVE_FADE,
    Drives,
    ENGAGED,
    FADE,
    ForceOutput,
    ForceSample,
    ForceState,
    HOLDING,
    LATCHED,
    LONG_AGO,
    NO_WRENCH,
    NOTHING,
    Obstacles,
    OFF,
    READY,
    Reason,
)
from spm_haptic_master.force.statics import clipped, ForceLimits, rotated, Torques
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import jacobian, RIG_WORKING_MODE
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    matrix_from_quaternion,
    multiply_quaternions,
    rotation_from_quaternion,
    vector_from_quaternion,
)

# Longest gap between two samples that the torque survives (s).
GAP = 0.01
GAP_NS = round(1e9 * GAP)
# Stands for an unknown velocity, rad/s.
UNKNOWN = (inf, inf, inf)
# Looked up once, not at each sample.
OPERATING = Drives.OPERATING
# Time without torque between off and ready (s).
IDLE = 0.1
# Makes a named tuple of all its fields in a third of the time.
_output = tuple.__new__


class ForceController:
    """
    Motor torques for each joint sample, by the state of the force feedback.

    Three motors are on th1A, th1B, th1C, a fourth on th3A. Without `gravity` no weight is
    compensated. InputError: an argument has a wrong type or value.
    """

    def __init__(
        self,
        geometry: Geometry = PAPER_GEOMETRY,
        working_mode: WorkingMode = RIG_WORKING_MODE,
        motors: int = 3,
        limits: ForceLimits | None = None,
        gravity: Gravity | None = None,
    ) -> None:
        self._limits = limits = ForceLimits() if limits is None else limits
        self._statics = make_statics(geometry, working_mode, motors, limits)
        self._geometry, self._mode = geometry, working_mode
        self._weight = None if gravity is None else Weight(gravity, self._statics)
        self._obstacles = Obstacles(limits)
        # Limits of each sample.
        self._figures = (
            limits.speed**2,
            limits.protection_level,
            limits.noise,
            limits.torque,
            limits.slew,
            limits.ramp,
            limits.damping,
            -self._obstacles.latest,
            self._obstacles.latest,
        )
        self._energy = EnergyBudget()
        self._motion = JointMotion(motors)
        self._zero = (0.0,) * motors
        # Motor torques of the last two samples, N m, and with each the torque on the handle that
        # the weight asked for; the orientation of the last one.
        self._last = self._before = self._zero
        self._held = self._held_before = NOTHING
        self._pose: Quaternion[float] | None = None
        # Torque asked of the handle, N m, and the motor torques from which a fade began.
        self._asked, self._from = NOTHING, self._zero
        self._stamp = LONG_AGO
        # Shares that the ramps of torque and of the wrench have reached, that the fade has left,
        # and of the weight that is compensated; time without torque, s.
        self._ramp = self._wrench_ramp = self._left = self._borne = self._idle = 0.0
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
            rates = jacobian(
                matrix_from_quaternion(quaternion),
                self._geometry,
                self._mode,
                self._statics.motors,
            )
        except SpmError:
            return None
        smallest = float(np.linalg.svd(rates, compute_uv=False)[-1])
        return 1.0 / smallest if smallest else None

    def take(self, sample: ForceSample) -> ForceOutput:
        """Return the motor torques for a sample: once for each, in the order of their stamps."""
        # One function: a call costs as much as the product of two vectors.
        (
            stamp,
            angles,
            quaternion,
            velocity,
            level,
            noise,
            wrench,
            sources,
            drives,
            enabled,
            engaged,
            present,
            clutched,
            lock,
            weightless,
        ) = sample
        (
            square_of_speed,
            level_limit,
            noise_limit,
            torque_limit,
            slew,
            ramp,
            damping,
            earliest,
            latest,
        ) = self._figures
        energy, state, obstacles = self._energy, self._state, self._obstacles
        elapsed = stamp - self._stamp
        self._stamp = stamp
        if 0 < elapsed <= GAP_NS:
            dt = 1e-9 * elapsed
        else:
            # The drives may have dropped the torque meanwhile: it begins from zero.
            self._motion.restart()
            self._asked, self._borne, dt = NOTHING, 0.0, 0.0
        work, generated = self._motion.take(stamp, angles, self._before, dt), False
        if (
            work is not None
            and self._weight is not None
            and quaternion is not None
            and (self._pose is not None)
        ):
            # The weight gives back what lifting it takes; what the motors make of it may not.
            dx, dy, dz = vector_from_quaternion(
                *multiply_quaternions(quaternion, conjugate(self._pose))
            )
            hx, hy, hz = self._held_before
            work -= hx * dx + hy * dy + hz * dz
        self._pose = quaternion
        if work is not None and (state is ENGAGED or state is HOLDING):
            generated = energy.take(work, self._asked, dt)
        received, (x, y, z), in_handle = NO_WRENCH if wrench is None else wrench
        wx, wy, wz = UNKNOWN if velocity is None else velocity
        whole, age = hypot(x, y, z), stamp - received
        if (
            state is ENGAGED
            and work is not None
            and quaternion is not None
            and wx * wx + wy * wy + wz * wz <= square_of_speed
            and level <= level_limit
            and noise <= noise_limit
            and whole < inf
            and earliest <= age <= latest
            and sources <= 1
            and drives is OPERATING
            and enabled
            and engaged
            and present
            and (lock is NOTHING or hypot(*lock) < inf)
            and not (clutched or generated)
        ):
            # The usual case: nothing is in the way.
            obstacle = None
        else:
            obstacle = obstacles.take(sample, self._motion.is_missing, generated)
            if obstacle is not None or state is not ENGAGED or clutched:
                self._change(sample, obstacle, dt)
                state = self._state
        if quaternion is not None and (state is ENGAGED or state is HOLDING):
            statics, (qx, qy, qz, qw) = self._statics, quaternion
            try:
                statics.place(rotation_from_quaternion(qx, qy, qz, qw))
            except SpmError:
                # A leg is at the edge of its reach.
                self._enter(ForceState(Condition.FADING, Reason.NO_ORIENTATION))
                state = self._state
        if state is ENGAGED or state is HOLDING:
            if self._wrench_ramp < 1.0:
                part = dt / ramp
                self._ramp = grown if (grown := self._ramp + part) < 1.0 else 1.0
                self._wrench_ramp = grown if (grown := self._wrench_ramp + part) < 1.0 else 1.0
            if velocity is None or state is HOLDING:
                # Without a velocity nothing could damp what wrench and lock do.
                x = y = z = 0.0
            else:
                part = energy.share
                if part * whole > torque_limit:
                    part = torque_limit / whole
                part *= self._wrench_ramp
                if part != 1.0:
                    x, y, z = part * x, part * y, part * z
                if in_handle:
                    x, y, z = rotated(statics.rotation, (x, y, z))
            if lock is not NOTHING and velocity is not None:
                part, (lx, ly, lz) = self._ramp * energy.share, lock
                x, y, z = x + part * lx, y + part * ly, z + part * lz
                whole = hypot(x, y, z)
                if whole > torque_limit:
                    part = torque_limit / whole
                    x, y, z = part * x, part * y, part * z
            wanted, step = (x, y, z), slew * dt
            way = dist(wanted, self._asked)
            if way > step:
                px, py, pz = self._asked
                part = step / way
                wanted = x, y, z = (
                    px + part * (x - px),
                    py + part * (y - py),
                    pz + part * (z - pz),
                )
            self._asked, share = wanted, energy.damping
            if velocity is not None:
                damping *= self._ramp
                if share > 0.0:
                    damping += share * HANDLE_DAMPING
                x, y, z = x - damping * wx, y - damping * wy, z - damping * wz
            held = NOTHING
            if self._weight is not None:
                part = self._borne + (dt if weightless else -dt) / ramp
                self._borne = part = min(1.0, max(0.0, part))
                gx, gy, gz = self._weight.torque()
                held = gx, gy, gz = part * gx, part * gy, part * gz
                x, y, z = x + gx, y + gy, z + gz
            torques, rendered = statics.render((x, y, z))
            if share > 0.0:
                torques = self._within(torques, share)
                rendered = statics.rendered(torques)
        elif state.condition is Condition.FADING:
            torques, held, rendered = self._faded(dt), NOTHING, None
            state = self._state
        else:
            torques, held, rendered = self._zero, NOTHING, NOTHING
        self._before, self._last = self._last, torques
        self._held_before, self._held = self._held, held
        return _output(
            ForceOutput,
            (state, torques, self._asked, rendered, obstacle, energy.energy, energy.share),
        )

    # State --------------------------------------------------------------------------------------

    def _change(self, sample: ForceSample, obstacle: Reason | None, dt: float) -> None:
        """Change the state where a sample asks for it."""
        condition = self._state.condition
        may_begin = self._obstacles.may_begin(sample.wrench, sample.stamp) and not sample.clutched
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
            elif condition is Condition.ENGAGED:
                self._enter(HOLDING)  # nothing but the clutch asks for a change
            elif may_begin:
                self._enter(ENGAGED)

    def _enter(self, state: ForceState) -> None:
        """Assign the state: the only place."""
        before = self._state.condition
        self._obstacles.restart()
        self._energy.restart()
        self._idle = self._wrench_ramp = 0.0
        if before is not Condition.FADING:
            self._left, self._from = 1.0, self._last
        if before not in (Condition.ENGAGED, Condition.HOLDING) or (
            state.condition is Condition.FADING
        ):
            # Between engaged and holding the torque follows the slew rate.
            self._asked = NOTHING
            self._ramp = self._borne = 0.0
        self._state = state

    # Torque -------------------------------------------------------------------------------------

    def _faded(self, dt: float) -> Torques:
        """Return the torques of the fade; end it when nothing is left."""
        why = self._state.why
        # After a gap, or if time stands still, no torque is left to fade.
        self._left -= dt / (DRIVE_FADE if why is Reason.DRIVE else FADE) if dt else 1.0
        if why is None or self._left <= 0.0:
            self._enter(ForceState(Condition.FAULT, why) if why in LATCHED else READY)
            return self._zero
        return tuple([self._left * torque for torque in self._within(self._from, 1.0)])

    def _within(self, torques: Torques, damping: float) -> Torques:
        """Add a share of the joint damping, and keep each motor within its limit."""
        limit, velocity = self._limits.motor_torque, self._motion.velocity
        if velocity is not None:
            torques = tuple(
                [
                    torque - damping * JOINT_DAMPING * rate
                    for torque, rate in zip(torques, velocity, strict=True)
                ]
            )
        return tuple([clipped(torque, limit) for torque in torques])
