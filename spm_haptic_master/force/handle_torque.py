# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The torque that wrench and lock ask of the handle: limited, ramped and of a limited slope."""

from __future__ import annotations

from math import hypot

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.lock import Lock
from spm_haptic_master.force.samples import FADE, ForceSample, Wrench
from spm_haptic_master.force.vectors import moved, NOTHING, shortened
from spm_haptic_master.kinematics.number_backends import Rotation, Vector
from spm_haptic_master.kinematics.vectors import added, scaled, times


class HandleTorque:
    """
    The torque of wrench and lock on the handle, from sample to sample.

    Attributes
    ----------
    asked : tuple of three float
        Torque after limit, ramp, slew rate and fade, N m in the base frame.
    ramp : float
        Share of torque and damping that the ramp after engaging has reached (unit 1).

    """

    def __init__(self, limits: ForceLimits) -> None:
        self._limits = limits
        self._lock = Lock(limits.lock_stiffness)
        self._fade_start: Vector[float] = NOTHING  # what was asked when the fade began, N m
        self.end()

    def end(self) -> None:
        """End all torque and its ramp."""
        self.asked = NOTHING
        self.ramp = 0.0
        self.restart_wrench()
        self._lock.release()

    def drop(self) -> None:
        """Begin with no torque after a gap, as the drives may have dropped it; the ramps stay."""
        self.asked = NOTHING

    def restart_wrench(self) -> None:
        """Let the wrench come up by its ramp again."""
        self._wrench_ramp = 0.0

    def begin_fade(self) -> None:
        """Fade what is asked now."""
        self._fade_start = self.asked

    def fade(self, left: float) -> None:
        """Leave a share (unit 1) of the torque at the begin of the fade."""
        self.asked = scaled(left, self._fade_start)

    def follow(
        self,
        sample: ForceSample,
        has_wrench: bool,
        share: float,
        rotation: Rotation[float],
        dt: float,
    ) -> None:
        """
        Move the torque toward that of wrench and lock of a sample.

        Parameters
        ----------
        sample : ForceSample
            With the wrench and the lock.
        has_wrench : bool
            Whether the wrench is rendered, or the lock alone.
        share : float
            Share of both that the energy budget leaves (unit 1).
        rotation : tuple of nine float
            R_base_platform, row by row.
        dt : float
            Time since the last sample, s.

        """
        self._grow(dt)
        wanted = NOTHING
        if sample.velocity is not None:
            # Without a velocity nothing could damp the motion that they cause.
            if has_wrench and sample.wrench is not None:
                wanted = self._of_wrench(sample.wrench, sample.stamp, share, rotation)
            wanted = self._with_lock(wanted, sample, share, dt)
        self.asked = moved(self.asked, wanted, self._limits.slew * dt)

    def _grow(self, dt: float) -> None:
        """Let the ramps go up; that of the wrench begins no earlier than the other."""
        if self._wrench_ramp < 1.0:
            step = dt / self._limits.ramp
            self.ramp = min(1.0, self.ramp + step)
            self._wrench_ramp = min(1.0, self._wrench_ramp + step)

    def _of_wrench(
        self,
        wrench: Wrench,
        stamp: int,
        share: float,
        rotation: Rotation[float],
    ) -> Vector[float]:
        """Return the torque of a wrench that is rendered at a stamp, ns; N m in the base frame."""
        length = hypot(*wrench.torque)
        limit = self._limit_by_age(1e-9 * (stamp - wrench.received))
        if share * length > limit:
            share = limit / length
        torque = scaled(share * self._wrench_ramp, wrench.torque)
        return times(rotation, torque) if wrench.in_handle else torque

    def _limit_by_age(self, age: float) -> float:
        """
        Return the largest torque of a wrench by its age, s.

        From a third of the longest age on it falls, so that little is left to fade at that age.
        """
        limits = self._limits
        begin = limits.wrench_age / 3.0
        end = limits.wrench_age + FADE
        share = (end - age) / (end - begin)
        return limits.torque * min(1.0, share)

    def _with_lock(
        self,
        torque: Vector[float],
        sample: ForceSample,
        share: float,
        dt: float,
    ) -> Vector[float]:
        """Return a torque with that of the lock, together within the limit."""
        if sample.lock is None or sample.quaternion is None:
            self._lock.release()
            return torque
        pull = self._lock.torque(sample.lock, sample.quaternion, dt)
        pull = scaled(self.ramp * share, pull)
        return shortened(added(torque, pull), self._limits.torque)
