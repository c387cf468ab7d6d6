# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Force feedback: motor torques for each joint sample.

`ForceController.take` passes a sample through six steps: its time, its pose, the work of the
motors since the last one, what stands in the way of force, the state, and the torques.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.force.energy import EnergyBudget, HANDLE_DAMPING, JOINT_DAMPING
from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.gravity import Gravity
from spm_haptic_master.force.handle_torque import HandleTorque
from spm_haptic_master.force.joint_motion import JointMotion
from spm_haptic_master.force.obstacles import Obstacles
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.force.samples import (
    Command,
    DRIVE_FADE,
    DrivesState,
    ENDS_ALL,
    ENGAGED,
    FADE,
    ForceCondition,
    ForceOutput,
    ForceReason,
    ForceSample,
    ForceState,
    HOLDING,
    LATCHED,
    LONG_AGO,
    OFF,
    READY,
)
from spm_haptic_master.force.statics import clipped, Torques
from spm_haptic_master.force.support import Support
from spm_haptic_master.force.vectors import NOTHING, shortened
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import jacobian, RIG_WORKING_MODE
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    matrix_from_quaternion,
    rotation_between,
    rotation_from_quaternion,
)
from spm_haptic_master.kinematics.vectors import added, dot, scaled, subtracted

# Longest time between two samples over which the torque goes on (s).
TORQUE_GAP = 0.01
TORQUE_GAP_NS = round(1e9 * TORQUE_GAP)
# A stamp that is older by up to this (ns) is a sample that comes again or too late; the clock was
# set back if it is older than that.
LATE_NS = 1_000_000_000
# Time for which force has to be wanted before off becomes ready (s).
READY_DELAY = 0.1
# Time from a sample until its torque is at the motors (s): at 1 kHz the torque of the sample
# before is in force all that period. Of a period above the second (s) it is so for a part only.
LATENCY = 1e-3
LONG_PERIOD = 1.1e-3
# Speed (rad/s) below which the handle is at rest: the noise of the encoders makes 0.05.
REST_SPEED = 0.2


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

    Attributes
    ----------
    output : ForceOutput
        The output for the latest sample.

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
        self._support = Support(geometry, gravity, limits, self._statics)
        self._handle = HandleTorque(limits)
        self._obstacles = Obstacles(limits)
        self._energy = EnergyBudget()
        self._motion = JointMotion(motors)
        self._zero = (0.0,) * motors
        # The commands of the last sample and of that before, which is in force until the torque of
        # the last one is at the motors; and the last orientation.
        self._none = Command(motor_torque=self._zero, weight=NOTHING, wrench=NOTHING)
        self._last = self._none
        self._before = self._none
        self._orientation: Quaternion[float] | None = None
        # Share that a fade has left (unit 1), and the motor torques at its begin, N m.
        self._fade_left = 0.0
        self._fade_start: Torques = self._zero
        self._stamp = LONG_AGO
        self._wanted_for = 0.0  # time for which force has been wanted while off, s
        self._state = OFF
        self.output = ForceOutput(
            state=OFF,
            motor_torque=self._zero,
            asked=NOTHING,
            rendered=NOTHING,
            obstacle=None,
            energy=self._energy.energy,
            share=self._energy.share,
        )

    def acknowledge(self) -> bool:
        """End a latched fault; return whether there was one. Weight and end stop stay."""
        if self._state.condition is not ForceCondition.FAULT:
            return False
        if self._state.why is ForceReason.ENERGY:
            self._energy.restart()
        self._enter(READY if self._support.has_torque else OFF)
        self.output = replace(self.output, state=self._state)
        return True

    def has_seen(self, stamp: int) -> bool:
        """Whether a stamp, ns, is not newer than that of the last sample: it changes nothing."""
        return -LATE_NS <= stamp - self._stamp <= 0

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
        """
        Return the motor torques for a sample.

        Parameters
        ----------
        sample : ForceSample
            The samples come in the order of their stamps: one with the stamp of the last sample,
            or an older one, changes nothing.

        Returns
        -------
        ForceOutput
            Motor torques, state and figures.

        """
        if self.has_seen(sample.stamp):
            return self.output
        dt = self._advance(sample.stamp)
        is_placed = self._place(sample.quaternion)
        self._count_energy(sample, dt)
        obstacle = self._obstacles.first(
            sample,
            is_placed=is_placed,
            angle_missing=self._motion.is_missing,
            energy_generated=self._energy.is_spent,
        )
        self._change_state(sample, obstacle, dt)
        is_sound = is_placed and obstacle not in ENDS_ALL
        command, rendered = self._command(sample, is_sound, dt)
        self._before = self._last
        self._last = command
        self._orientation = sample.quaternion
        self.output = ForceOutput(
            state=self._state,
            motor_torque=command.motor_torque,
            asked=self._handle.asked,
            rendered=rendered,
            obstacle=obstacle,
            energy=self._energy.energy,
            share=self._energy.share,
        )
        return self.output

    # Time, pose and energy ----------------------------------------------------------------------

    def _advance(self, stamp: int) -> float:
        """Return the time since the last sample, s; 0 after a gap, which ends all torque."""
        elapsed = stamp - self._stamp
        self._stamp = stamp
        if 0 < elapsed <= TORQUE_GAP_NS:
            return 1e-9 * elapsed
        # The drives may have dropped the torque meanwhile: it begins from zero, and that of before
        # does no more work.
        self._last = self._none
        self._motion.restart()
        self._handle.drop()
        self._support.end()
        return 0.0

    def _place(self, quaternion: Quaternion[float] | None) -> bool:
        """Move the statics to an orientation; return whether there is one that all legs reach."""
        if quaternion is None:
            return False
        try:
            self._statics.place(rotation_from_quaternion(*quaternion))
        except SpmError:
            return False
        return True

    def _count_energy(self, sample: ForceSample, dt: float) -> None:
        """Count the work of the motors since the last sample."""
        in_force = self._before.motor_torque
        work = self._motion.follow(sample.stamp, sample.angles, in_force, dt)
        if work is None:
            return
        has_weight = self._before.weight is not NOTHING
        if has_weight or dt > LONG_PERIOD:
            work += self._correction(sample.quaternion, dt)
        asked = added(self._handle.asked, self._support.end_stop)
        self._energy.count(work, asked, dt)
        if self._state is ENGAGED or self._state is HOLDING:
            self._energy.note_wrench(dt)
        if sample.velocity is not None and hypot(*sample.velocity) < REST_SPEED:
            self._energy.recover(dt)

    def _correction(self, quaternion: Quaternion[float] | None, dt: float) -> float:
        """Return the work, J, to be added to that of the motor torques that were in force."""
        if quaternion is None or self._orientation is None:
            return 0.0
        turn = rotation_between(self._orientation, quaternion)
        # The ideal weight torque is conservative: only the motors' deviation from it is work.
        work = -dot(self._before.weight, turn)
        before = self._before.wrench
        last = self._last.wrench
        if dt > LONG_PERIOD and before is not None and last is not None:
            # After the latency the torque of the last sample was in force. Only that of the wrench
            # counts: that of a lock or of damping has the noise of the last angles.
            change = subtracted(last, before)
            work += (1.0 - LATENCY / dt) * dot(change, turn)
        return work

    # State --------------------------------------------------------------------------------------

    def _change_state(
        self,
        sample: ForceSample,
        obstacle: ForceReason | None,
        dt: float,
    ) -> None:
        """Change the state if the sample and its obstacle require it."""
        if self._state is OFF:
            self._leave_off(sample, dt)
        elif self._state is READY:
            self._leave_ready(sample, obstacle)
        elif self._state.why is not None:
            # Torque fades, or a fault is latched.
            self._worsen(obstacle)
        elif obstacle is not None:
            self._enter(ForceState(ForceCondition.FADING, obstacle))
        elif self._state is ENGAGED:
            self._leave_engaged(sample)
        elif self._may_begin(sample):
            self._enter(ENGAGED)

    def _may_begin(self, sample: ForceSample) -> bool:
        """Count the wrench of a sample; return whether it may be rendered."""
        is_small = self._obstacles.may_begin(sample.wrench, sample.stamp)
        return is_small and not sample.clutched

    def _leave_off(self, sample: ForceSample, dt: float) -> None:
        """Become ready after some time in which force is wanted."""
        self._wanted_for = self._wanted_for + dt if _is_wanted(sample) else 0.0
        if self._wanted_for >= READY_DELAY:
            self._enter(READY)

    def _leave_ready(self, sample: ForceSample, obstacle: ForceReason | None) -> None:
        """Begin with force, fade weight and end stop, or switch off."""
        may_begin = self._may_begin(sample)
        if obstacle in ENDS_ALL and self._support.has_torque:
            self._enter(ForceState(ForceCondition.FADING, obstacle))
        elif not sample.enabled and self._support.has_torque:
            self._enter(ForceState(ForceCondition.FADING, ForceReason.DISABLED))
        elif not _is_wanted(sample):
            self._enter(OFF)
        elif obstacle is None and may_begin:
            self._enter(ENGAGED)
        elif obstacle is None and sample.lock is not None:
            self._enter(HOLDING)

    def _worsen(self, obstacle: ForceReason | None) -> None:
        """Let a worse reason replace that of a fade, or of a fault with weight and end stop."""
        is_fault = self._state.condition is ForceCondition.FAULT
        if is_fault and not self._support.has_torque:
            return
        if obstacle is not None and _severity(obstacle) > _severity(self._state.why):
            self._enter(ForceState(ForceCondition.FADING, obstacle))

    def _leave_engaged(self, sample: ForceSample) -> None:
        """Hold while the clutch is pressed, or a lock holds without wrenches."""
        if sample.clutched or self._obstacles.is_old(sample.wrench, sample.stamp):
            self._enter(HOLDING)

    def _enter(self, state: ForceState) -> None:
        """Enter a state: the only place that assigns it."""
        before = self._state
        self._obstacles.restart()
        self._handle.restart_wrench()
        self._wanted_for = 0.0
        if state.is_fading:
            is_worse = state.why in ENDS_ALL and before.why not in ENDS_ALL
            if not before.is_fading or is_worse:
                self._fade_left = 1.0
                self._fade_start = self._last.motor_torque
                self._handle.begin_fade()
        elif state not in (ENGAGED, HOLDING):
            self._handle.end()
        self._state = state

    # Torque -------------------------------------------------------------------------------------

    def _command(
        self, sample: ForceSample, is_sound: bool, dt: float
    ) -> tuple[Command, Vector[float] | None]:
        """
        Return the command of a sample, and the torque that the handle gets; None if not known.

        `is_sound` is whether orientation and motors can be relied on.
        """
        if self._state.is_fading:
            self._fade(dt)
        if self._state.is_fading and self._state.why in ENDS_ALL:
            self._support.end()
            faded = Command(motor_torque=self._faded(), weight=NOTHING, wrench=NOTHING)
            return faded, None
        if self._state is OFF or not is_sound:
            self._support.end()
            return self._none, NOTHING
        if self._state is ENGAGED or self._state is HOLDING:
            self._handle.follow(
                sample,
                has_wrench=self._state is ENGAGED,
                share=self._energy.share,
                rotation=self._statics.rotation,
                dt=dt,
            )
        is_wanted = self._state.has_support and sample.enabled
        self._support.move(is_wanted, sample.weightless, sample.velocity, dt)
        return self._rendered(sample)

    def _rendered(self, sample: ForceSample) -> tuple[Command, Vector[float]]:
        """Return the command for all torques together, and the torque that the handle gets."""
        support = self._support
        handle = self._handle
        if not (any(handle.asked) or handle.ramp or support.has_torque):
            return self._none, NOTHING
        torque = handle.asked
        if any(support.end_stop):
            stop = scaled(self._energy.share, support.end_stop)
            torque = shortened(added(torque, stop), self._limits.torque)
        ramp = handle.ramp * (self._fade_left if self._state.is_fading else 1.0)
        energy_damping = self._energy.damping * max(ramp, support.weight_share)
        if sample.velocity is not None:
            damping = self._limits.damping * ramp + HANDLE_DAMPING * energy_damping
            torque = subtracted(torque, scaled(damping, sample.velocity))
        motor_torque, rendered = self._statics.render(added(torque, support.weight))
        if energy_damping > 0.0:
            motor_torque = self._damped(motor_torque, energy_damping)
            rendered = self._statics.rendered(motor_torque)
        wrench = handle.asked if sample.lock is None else None
        command = Command(motor_torque=motor_torque, weight=support.weight, wrench=wrench)
        return command, rendered

    def _fade(self, dt: float) -> None:
        """Fade for a period, s; enter the state after the fade once nothing is left."""
        why = self._state.why
        # After a gap no torque is left to fade.
        step = dt / (DRIVE_FADE if why is ForceReason.DRIVE else FADE) if dt else 1.0
        self._fade_left = max(0.0, self._fade_left - step)
        self._handle.fade(self._fade_left)
        if self._fade_left > 0.0:
            return
        # A fade with which weight and end stop end as well lasts until their ramps are down.
        is_over = why in ENDS_ALL or self._state.has_support or not self._support.has_torque
        if is_over:
            self._enter(ForceState(ForceCondition.FAULT, why) if why in LATCHED else READY)

    def _faded(self) -> Torques:
        """Return what is left of the motor torques: without damping, as angles may be wrong."""
        return tuple([self._fade_left * torque for torque in self._fade_start])

    def _damped(self, torques: Torques, share: float) -> Torques:
        """Return torques with a share of the joint damping, each motor within its limit."""
        limit = self._limits.motor_torque
        velocity = self._motion.velocity or self._zero
        return tuple(
            [
                clipped(torque - share * JOINT_DAMPING * rate, limit)
                for torque, rate in zip(torques, velocity, strict=True)
            ]
        )


def _is_wanted(sample: ForceSample) -> bool:
    """Return whether force is wanted, and the drives are in operation."""
    return sample.enabled and sample.drives is DrivesState.OPERATING


def _severity(why: ForceReason | None) -> int:
    """Rank a reason: one that ends all torque above one of the wrench alone, then a fault."""
    return 2 * (why in ENDS_ALL) + (why in LATCHED)
