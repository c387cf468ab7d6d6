# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The closed loop in simulated time: encoders, orientation, force feedback, plant, hand, slave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import pi, radians

import numpy as np
from spm_haptic_master.force import ForceController, ForceLimits, ForceOutput, ForceSample, Wrench
from spm_haptic_master.kinematics import estimate_sample, Geometry, UsedSensors
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    AngularVelocity,
    conjugate,
    multiply_quaternions,
    quaternion_from_vector,
    vector_from_quaternion,
)
from study.force.plant import Plant, StiffHand

# Control period (ns), and in s.
PERIOD, DT = 1_000_000, 1e-3
# Standard deviation of an encoder's noise (rad), and its counts a turn.
SIGMA, COUNTS = radians(0.04), 2**14
# Time over which the angular velocity is averaged (ns).
WINDOW = 10_000_000
# Time until force is engaged and its ramp is over (s): the hand holds still meanwhile.
START = 0.15
# Orientation of the slave to the torque that the hand is to feel, N m in the base frame.
Environment = Callable[[Quaternion[float]], Vector[float]]
# Time since the start to the hand's displacement from its first orientation, rad.
Motion = Callable[[float], Vector[float]]

GEOMETRY = Geometry()
FOUR_SENSORS = UsedSensors((SIGMA,) * 4)


@dataclass(slots=True)
class Slave:
    """
    A slave that follows at once, and its environment, behind delays.

    Attributes
    ----------
    environment : callable
        Torque that the hand is to feel for an orientation of the slave.
    period : int
        Periods of the control between two wrenches.
    there, back : int
        Delay of the orientation and of the wrench, in periods of the control.

    """

    environment: Environment
    period: int = 1
    there: int = 0
    back: int = 0
    _orientations: list[Quaternion[float]] = field(default_factory=list)
    _wrenches: list[tuple[int, Vector[float]]] = field(default_factory=list)

    def take(self, step: int, quaternion: Quaternion[float]) -> Wrench | None:
        """Take the master's orientation of a period; return the latest wrench that arrived."""
        self._orientations.append(quaternion)
        if step % self.period == 0:
            seen = self._orientations[max(0, len(self._orientations) - 1 - self.there)]
            self._wrenches.append((step + self.back, self.environment(seen)))
        if len(self._orientations) > self.there + 1:
            self._orientations.pop(0)
        while len(self._wrenches) > 1 and self._wrenches[1][0] <= step:
            self._wrenches.pop(0)
        arrived, torque = self._wrenches[0]
        return Wrench(arrived * PERIOD, torque) if arrived <= step else None


@dataclass(slots=True)
class Trace:
    """What a run leaves, one row a period; `start` is the row at which the motion began."""

    torque: np.ndarray
    asked: np.ndarray
    rendered: np.ndarray
    turned: np.ndarray
    velocity: np.ndarray
    given: np.ndarray
    energy: np.ndarray
    share: np.ndarray
    states: list[str]
    start: int

    @property
    def generated(self) -> float:
        """Largest energy, J, that the motors have given in all since the motion began."""
        return float(max(0.0, (self.given - self.given[self.start]).max()))


def run(
    R: np.ndarray,
    slave: Slave,
    seconds: float,
    *,
    motion: Motion | None = None,
    hand: tuple[float, float] | None = (1.0, 0.01),
    motors: int = 3,
    controller: ForceController | None = None,
    friction: float = 1.0,
    noise: float = 1.0,
    seed: int = 1,
) -> Trace:
    """
    Run the closed loop for some seconds from R_base_platform `R`, (3, 3).

    `motion` is the displacement of the hand, a rotation vector in the base frame; it holds still
    by default. `hand` is stiffness and damping of the grip, N m/rad and N m s/rad; None is a
    `StiffHand`. The usual controller has a ramp of 50 ms, so that a run begins soon. `motors` and
    `friction` are those of `Plant`, `noise` is a factor of the encoders' noise.
    """
    rng = np.random.default_rng(seed)
    plant = (
        StiffHand(R, motors, GEOMETRY) if hand is None else Plant(R, motors, GEOMETRY, friction)
    )
    if controller is None:
        controller = ForceController(GEOMETRY, motors=motors, limits=ForceLimits(ramp=0.05))
    first, start = plant.hand, round((START + 0.06) / DT)
    count = start + round(seconds / DT)
    readings = noise * SIGMA * rng.normal(size=(count, 4))
    filtered, prior, before = AngularVelocity(WINDOW), first, (0.0, 0.0, 0.0)
    torques: tuple[float, ...] = (0.0,) * motors
    rows: list[tuple[ForceOutput, Vector[float], Vector[float], float]] = []
    for step in range(count):
        stamp = step * PERIOD
        angles = quantised(np.array(plant.angles) + readings[step])
        estimate = estimate_sample(angles, FOUR_SENSORS, GEOMETRY, prior)
        prior = _continued(estimate.quaternion, prior)
        filtered.add(stamp, prior)
        wrench = slave.take(step, prior)
        if step < start:
            # Nothing to feel until the motion begins.
            wrench = Wrench(stamp, (0.0, 0.0, 0.0))
        output = controller.take(
            ForceSample(stamp, angles, prior, filtered.value(), wrench=wrench)
        )
        here = (0.0, 0.0, 0.0)
        if motion is not None and step >= start:
            here = motion((step - start) * DT)
        plant.hand = multiply_quaternions(quaternion_from_vector(*here), first)
        rate = [(new - old) / DT for new, old in zip(here, before, strict=True)]
        before = here
        # The command is in force one period after its sample.
        plant.run(torques, (rate[0], rate[1], rate[2]), *(hand or ()))
        torques = output.motor_torque
        rows.append(
            (
                output,
                vector_from_quaternion(*multiply_quaternions(plant.quaternion, conjugate(first))),
                plant.velocity,
                plant.given,
            )
        )
    outputs, turned, velocities, given = zip(*rows, strict=True)
    return Trace(
        np.array([each.motor_torque for each in outputs]),
        np.array([each.asked for each in outputs]),
        np.array([each.rendered or (np.nan,) * 3 for each in outputs]),
        np.array(turned),
        np.array(velocities),
        np.array(given),
        np.array([each.energy for each in outputs]),
        np.array([each.share for each in outputs]),
        [each.state.text for each in outputs],
        start,
    )


def quantised(angles: np.ndarray) -> tuple[float, ...]:
    """Return angles, rad, as encoders of 14 bit read them."""
    return tuple((np.round(angles * COUNTS / (2.0 * pi)) * (2.0 * pi / COUNTS)).tolist())


def _continued(quaternion: Quaternion[float], last: Quaternion[float]) -> Quaternion[float]:
    """Return a quaternion in the sign of the last one."""
    x, y, z, w = quaternion
    if x * last[0] + y * last[1] + z * last[2] + w * last[3] >= 0.0:
        return quaternion
    return -x, -y, -z, -w


def wall(first: Quaternion[float], normal: np.ndarray, stiffness: float) -> Environment:
    """Return a wall: beyond the first orientation, a spring about `normal`, N m/rad."""
    nx, ny, nz = normal.tolist()
    start = conjugate(first)

    def torque(quaternion: Quaternion[float]) -> Vector[float]:
        x, y, z = vector_from_quaternion(*multiply_quaternions(quaternion, start))
        depth = max(0.0, x * nx + y * ny + z * nz)
        return (-stiffness * depth * nx, -stiffness * depth * ny, -stiffness * depth * nz)

    return torque


def spring(centre: Quaternion[float], stiffness: float) -> Environment:
    """Return a spring about an orientation, N m/rad."""
    start = conjugate(centre)

    def torque(quaternion: Quaternion[float]) -> Vector[float]:
        x, y, z = vector_from_quaternion(*multiply_quaternions(quaternion, start))
        return -stiffness * x, -stiffness * y, -stiffness * z

    return torque


def constant(torque: Vector[float]) -> Environment:
    """Return a torque that does not depend on the orientation, N m in the base frame."""
    return lambda quaternion: torque
