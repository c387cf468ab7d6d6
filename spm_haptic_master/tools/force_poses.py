# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Hold the handle where a hand has brought it: at rest the motors bear its weight."""

from __future__ import annotations

from enum import Enum
from math import pi, remainder
from typing import TypeAlias

from spm_haptic_master.force.energy import JointMotion
from spm_haptic_master.force.statics import clipped

# Readings of all encoders, rad.
Angles: TypeAlias = tuple[float, ...]
# Largest turn of a joint at rest, least turn of one from every other pose, and the turn of one by
# which a hand takes the handle back (rad).
STILL, APART, TAKEN = 0.01, 0.15, 0.1
# Spring and damping of each joint (N m/rad, N m s/rad), and the largest torque of a motor (N m).
STIFFNESS, DAMPING, LARGEST = 1.0, 0.02, 0.3
# Time at rest before the motors hold, until the hand has let go, and at rest after that; time for
# which the spring comes up, and that is recorded (s).
SETTLED, LET_GO, QUIET, RAMP, RECORDED = 1.0, 3.0, 1.0, 0.5, 0.5


class Phase(Enum):
    """What happens in a pose, as it is shown."""

    MOVING = 'is moved'
    HOLDING = 'let the handle go: the motors hold it'
    RECORDING = 'at rest, is recorded'
    KEEPING = 'is recorded: take the handle again'
    OVER = 'over'


class PoseHold:
    """Torques of one pose, sample by sample; it is added to `others`, the poses before."""

    def __init__(self, motors: int, others: list[Angles]) -> None:
        self.name, self.phase = f'pose {len(others) + 1}', Phase.MOVING
        self._motors, self._others, self._motion = motors, others, JointMotion(motors)
        self._tau = (0.0,) * motors
        # Angles near which the joints stay, those that are held, and times since when, s: they
        # stay, and the phase lasts; time of the sample before.
        self._near: Angles = ()
        self._held: Angles = ()
        self._near_since = self._phase_since = self._before = 0.0

    def torques(self, stamp: int, since: float, angles: Angles) -> tuple[float, ...]:
        """Return the torques for angles at a time, s, since the pose began, N m."""
        self._motion.take(stamp, angles, self._tau, since - self._before)
        self._before = since
        if not self._near or _turn(angles, self._near) > STILL:
            self._near, self._near_since = angles, since
        self._advance(since, angles)
        rates = self._motion.velocity
        if self.phase in (Phase.MOVING, Phase.OVER) or rates is None:
            self._tau = (0.0,) * self._motors
        else:
            stiffness = STIFFNESS
            if self.phase is Phase.HOLDING:
                stiffness *= min(1.0, (since - self._phase_since) / RAMP)
            self._tau = tuple([
                clipped(stiffness * remainder(held - angle, 2.0 * pi) - DAMPING * rate, LARGEST)
                for held, angle, rate in zip(self._held, angles, rates, strict=False)])
        return self._tau

    def _advance(self, since: float, angles: Angles) -> None:
        still, lasted = since - self._near_since, since - self._phase_since
        if self.phase is Phase.MOVING:
            if still >= SETTLED and all(_turn(angles, each) > APART for each in self._others):
                self._held = angles
                self._enter(Phase.HOLDING, since)
        elif self.phase is Phase.HOLDING:
            if lasted >= LET_GO and still >= QUIET:
                self._others.append(angles)
                self._enter(Phase.RECORDING, since)
        elif self.phase is Phase.RECORDING:
            if lasted >= RECORDED:
                self._enter(Phase.KEEPING, since)
        elif _turn(angles, self._others[-1]) > TAKEN:
            self._enter(Phase.OVER, since)

    def _enter(self, phase: Phase, since: float) -> None:
        self.phase, self._phase_since = phase, since


def _turn(angles: Angles, others: Angles) -> float:
    """Return the largest turn of a joint between two sets of angles, rad."""
    return max(abs(remainder(a - b, 2.0 * pi)) for a, b in zip(angles, others, strict=True))
