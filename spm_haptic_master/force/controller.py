# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback: motor torques for each joint sample."""

from __future__ import annotations

from math import dist, hypot

import numpy as np
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.force.energy import EnergyBudget, HANDLE_DAMPING, JOINT_DAMPING
from spm_haptic_master.force.gravity import Gravity, Weight
from spm_haptic_master.force.joint_motion import JointMotion
from spm_haptic_master.force.obstacles import Obstacles
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.force.samples import (
    Command,
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
    OFF,
    READY,
    Reason,
)
from spm_haptic_master.force.statics import clipped, ForceLimits, Torques
from spm_haptic_master.force.vectors import added, NOTHING, scaled, shortened, subtracted
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import jacobian, RIG_WORKING_MODE
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    matrix_from_quaternion,
    multiply_quaternions,
    rotation_from_quaternion,
    vector_from_quaternion,
)
from spm_haptic_master.kinematics.vectors import dot, times

# Longest gap between two samples that the torque survives (s).
GAP = 0.01
GAP_NS = round(1e9 * GAP)
# Time without torque between off and ready (s).
IDLE = 0.1


class ForceController:
    """
    Motor torques for each joint sample, by the state of the force feedback.

    Parameters
    ----------
    geometry : Geometry
        Link angles and axes.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.
    motors : {3, 4}
        3: on th1A, th1B, th1C; 4: on th3A as well.
    limits : ForceLimits, optional
        Limits of torque, speed and encoders.
    gravity : Gravity, optional
        Weight of handle and links; without it none is compensated.

    Raises
    ------
    InputError
        An argument has a wrong type or value.

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
        self._geometry = geometry
        self._mode = working_mode
        self._statics = make_statics(geometry, working_mode, motors, limits)
        self._weight = None if gravity is None else Weight(gravity, self._statics)
        self._obstacles = Obstacles(limits)
        self._energy = EnergyBudget()
        self._motion = JointMotion(motors)
        self._zero = (0.0,) * motors
        # The last two commands, and the orientation of the last sample.
        self._last = Command(self._zero, NOTHING)
        self._before = self._last
        self._pose: Quaternion[float] | None = None
        self._asked = NOTHING  # of the handle, N m
        self._fade_start: Torques = self._zero  # motor torques from which a fade began, N m
        self._stamp = LONG_AGO
        # Shares (unit 1) that the ramps of torque and of the wrench have reached, that the fade
        # has left, and of the weight that is compensated.
        self._ramp = 0.0
        self._wrench_ramp = 0.0
        self._fade_left = 0.0
        self._weight_share = 0.0
        self._idle = 0.0  # time without torque, s
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
        dt = self._advance(sample.stamp)
        generated = self._count_energy(sample, dt)
        obstacle = self._obstacles.first(sample, self._motion.is_missing, generated)
        self._change_state(sample, obstacle, dt)
        self._place(sample.quaternion)
        command, rendered = self._command(sample, dt)
        self._before = self._last
        self._last = command
        self._pose = sample.quaternion
        return ForceOutput(
            state=self._state,
            motor_torque=command.motor_torque,
            asked=self._asked,
            rendered=rendered,
            obstacle=obstacle,
            energy=self._energy.energy,
            share=self._energy.share,
        )

    # Time and energy ----------------------------------------------------------------------------

    def _advance(self, stamp: int) -> float:
        """Return the time since the sample before, s; 0 after a gap, which ends all torque."""
        elapsed = stamp - self._stamp
        self._stamp = stamp
        if 0 < elapsed <= GAP_NS:
            return 1e-9 * elapsed
        # The drives may have dropped the torque meanwhile: it begins from zero.
        self._motion.restart()
        self._asked = NOTHING
        self._weight_share = 0.0
        return 0.0

    def _count_energy(self, sample: ForceSample, dt: float) -> bool:
        """Count the work of the motors since the last sample; return whether it is a fault."""
        work = self._motion.work(sample.stamp, sample.angles, self._before.motor_torque, dt)
        if work is None:
            return False
        if self._weight is not None and sample.quaternion is not None and self._pose is not None:
            # The ideal weight torque is conservative: only the motors' deviation is work.
            turn = multiply_quaternions(sample.quaternion, conjugate(self._pose))
            work -= dot(self._before.weight, vector_from_quaternion(*turn))
        if self._state not in (ENGAGED, HOLDING):
            return False
        return self._energy.count(work, self._asked, dt)

    # State --------------------------------------------------------------------------------------

    def _change_state(self, sample: ForceSample, obstacle: Reason | None, dt: float) -> None:
        """Change the state where a sample asks for it."""
        may_begin = self._obstacles.may_begin(sample.wrench, sample.stamp) and not sample.clutched
        is_wanted = sample.enabled and sample.drives is Drives.OPERATING
        condition = self._state.condition
        if condition is Condition.OFF:
            self._wait(is_wanted, dt)
        elif condition is Condition.READY:
            self._leave_ready(is_wanted, may_begin and obstacle is None)
        elif condition is Condition.FADING:
            self._worsen(obstacle)
        elif condition is not Condition.FAULT:
            self._leave_torque(obstacle, sample.clutched, may_begin)

    def _wait(self, is_wanted: bool, dt: float) -> None:
        """Become ready after some time in which force is wanted."""
        self._idle = self._idle + dt if is_wanted else 0.0
        if self._idle >= IDLE:
            self._enter(READY)

    def _leave_ready(self, is_wanted: bool, may_begin: bool) -> None:
        """Begin with force, or switch off."""
        if not is_wanted:
            self._enter(OFF)
        elif may_begin:
            self._enter(ENGAGED)

    def _worsen(self, obstacle: Reason | None) -> None:
        """Let a reason that latches replace one that does not."""
        if obstacle in LATCHED and self._state.why not in LATCHED:
            self._enter(ForceState(Condition.FADING, obstacle))

    def _leave_torque(self, obstacle: Reason | None, clutched: bool, may_begin: bool) -> None:
        """Fade out, or follow the clutch."""
        if obstacle is not None:
            self._enter(ForceState(Condition.FADING, obstacle))
        elif self._state is ENGAGED and clutched:
            self._enter(HOLDING)
        elif self._state is HOLDING and may_begin:
            self._enter(ENGAGED)

    def _enter(self, state: ForceState) -> None:
        """Assign the state: the only place."""
        before = self._state.condition
        self._obstacles.restart()
        self._energy.restart()
        self._idle = 0.0
        self._wrench_ramp = 0.0
        if before is not Condition.FADING:
            self._fade_left = 1.0
            self._fade_start = self._last.motor_torque
        if before not in (Condition.ENGAGED, Condition.HOLDING) or (
            state.condition is Condition.FADING
        ):
            # Between engaged and holding the torque follows the slew rate.
            self._asked = NOTHING
            self._ramp = 0.0
            self._weight_share = 0.0
        self._state = state

    def _place(self, quaternion: Quaternion[float] | None) -> None:
        """Take the pose; fade out where a leg is at the edge of its reach."""
        if quaternion is None or self._state not in (ENGAGED, HOLDING):
            return
        try:
            self._statics.place(rotation_from_quaternion(*quaternion))
        except SpmError:
            self._enter(ForceState(Condition.FADING, Reason.NO_ORIENTATION))

    # Torque -------------------------------------------------------------------------------------

    def _command(self, sample: ForceSample, dt: float) -> tuple[Command, Vector[float] | None]:
        """Return the command of a sample, and what the handle gets of it; None if not known."""
        if self._state is ENGAGED or self._state is HOLDING:
            return self._command_of_handle(sample, dt)
        if self._state.condition is Condition.FADING:
            return Command(self._faded(dt), NOTHING), None
        return Command(self._zero, NOTHING), NOTHING

    def _command_of_handle(self, sample: ForceSample, dt: float) -> tuple[Command, Vector[float]]:
        """Return the command that makes the torque on the handle, and what the handle gets."""
        self._grow(dt)
        wanted = self._wrench(sample)
        if sample.lock is not NOTHING and sample.velocity is not None:
            wanted = self._with_lock(wanted, sample.lock)
        self._asked = _moved(self._asked, wanted, self._limits.slew * dt)
        torque = self._damped(self._asked, sample.velocity)
        weight = NOTHING
        if self._weight is not None:
            weight = scaled(self._moved_weight_share(sample.weightless, dt), self._weight.torque())
            torque = added(torque, weight)
        motor_torque, rendered = self._statics.render(torque)
        if self._energy.damping > 0.0:
            motor_torque = self._within(motor_torque, self._energy.damping)
            rendered = self._statics.rendered(motor_torque)
        return Command(motor_torque, weight), rendered

    def _grow(self, dt: float) -> None:
        """Let the ramps go up."""
        if self._wrench_ramp < 1.0:
            step = dt / self._limits.ramp
            self._ramp = min(1.0, self._ramp + step)
            self._wrench_ramp = min(1.0, self._wrench_ramp + step)

    def _wrench(self, sample: ForceSample) -> Vector[float]:
        """Return the part of the wrench that is rendered, N m in the base frame."""
        wrench = sample.wrench
        if wrench is None or sample.velocity is None or self._state is HOLDING:
            # Without a velocity nothing could damp it.
            return NOTHING
        share, limit, length = self._energy.share, self._limits.torque, hypot(*wrench.torque)
        if share * length > limit:
            share = limit / length
        torque = scaled(share * self._wrench_ramp, wrench.torque)
        return times(self._statics.rotation, torque) if wrench.in_handle else torque

    def _with_lock(self, wanted: Vector[float], lock: Vector[float]) -> Vector[float]:
        """Return torque and lock together, within the limit."""
        together = added(wanted, scaled(self._ramp * self._energy.share, lock))
        return shortened(together, self._limits.torque)

    def _damped(self, torque: Vector[float], velocity: Vector[float] | None) -> Vector[float]:
        """Return a torque on the handle with the damping of the velocity."""
        if velocity is None:
            return torque
        damping = self._limits.damping * self._ramp
        if self._energy.damping > 0.0:
            damping += self._energy.damping * HANDLE_DAMPING
        return subtracted(torque, scaled(damping, velocity))

    def _moved_weight_share(self, weightless: bool, dt: float) -> float:
        """Move the share of the weight that is compensated by a step of its ramp; return it."""
        step = dt / self._limits.ramp
        share = self._weight_share + (step if weightless else -step)
        self._weight_share = min(1.0, max(0.0, share))
        return self._weight_share

    def _faded(self, dt: float) -> Torques:
        """Return the torques of the fade; end it when nothing is left."""
        why = self._state.why
        # After a gap, or if time stands still, no torque is left to fade.
        self._fade_left -= dt / (DRIVE_FADE if why is Reason.DRIVE else FADE) if dt else 1.0
        if why is None or self._fade_left <= 0.0:
            self._enter(ForceState(Condition.FAULT, why) if why in LATCHED else READY)
            return self._zero
        return tuple([self._fade_left * each for each in self._within(self._fade_start, 1.0)])

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


def _moved(start: Vector[float], goal: Vector[float], step: float) -> Vector[float]:
    """Return the vector on the way from start to goal that is a step away, or the goal."""
    way = dist(goal, start)
    if way <= step:
        return goal
    return added(start, scaled(step / way, subtracted(goal, start)))
