# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The closed loop in simulated time: encoders, orientation, force feedback, plant, hand, slave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import pi, radians
from typing import Any

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


class ClosedLoop:
    """
    Encoders, orientation, force feedback, plant and hand, period after period.

    Parameters
    ----------
    R : ndarray, shape (3, 3)
        R_base_platform at the start.
    hand : tuple of two float, optional
        Stiffness and damping of the grip, N m/rad and N m s/rad; None: a `StiffHand`.
    motors : {3, 4}
        Number of motors.
    controller : ForceController, optional
        By default one with a ramp of 50 ms, so that a run begins soon.
    friction, noise : float
        Factors of the joints' friction and of the encoders' noise.
    seed : int
        Of the noise.

    Attributes
    ----------
    plant : Plant or StiffHand
        The device.
    orientation : tuple of four float
        Measured R_base_platform.
    output : ForceOutput
        Of the latest period.
    torques : tuple of float
        Motor torques that are commanded, N m: they are in force one period later.

    """

    def __init__(
        self,
        R: np.ndarray,
        *,
        hand: tuple[float, float] | None = (1.0, 0.01),
        motors: int = 3,
        controller: ForceController | None = None,
        friction: float = 1.0,
        noise: float = 1.0,
        seed: int = 1,
    ) -> None:
        self.plant: Plant | StiffHand = (
            StiffHand(R, motors, GEOMETRY)
            if hand is None
            else Plant(R, motors, GEOMETRY, friction)
        )
        self.hand = hand or (0.0, 0.0)
        self.torques: tuple[float, ...] = (0.0,) * motors
        self.stamp = 0
        self.orientation = self._first = self.plant.hand
        limits = ForceLimits(ramp=0.05)
        self._controller = controller or ForceController(GEOMETRY, motors=motors, limits=limits)
        self._rng = np.random.default_rng(seed)
        self._sigma = noise * SIGMA
        self._velocity = AngularVelocity(WINDOW)
        self._here: Vector[float] = (0.0, 0.0, 0.0)
        self._rows: list[tuple[ForceOutput, Vector[float], Vector[float], float]] = []

    def measure(self) -> Quaternion[float]:
        """Read the encoders; return the orientation."""
        noise = self._sigma * self._rng.normal(size=4)
        self._angles = quantised(np.array(self.plant.angles) + noise)
        estimate = estimate_sample(self._angles, FOUR_SENSORS, GEOMETRY, self.orientation)
        self.orientation = _continued(estimate.quaternion, self.orientation)
        self._velocity.add(self.stamp, self.orientation)
        return self.orientation

    def command(self, wrench: Wrench | None, **changed: Any) -> ForceOutput:
        """Pass the sample with a wrench, and with changed fields, to the force feedback."""
        sample = ForceSample(
            self.stamp,
            self._angles,
            self.orientation,
            self._velocity.value(),
            wrench=wrench,
        )
        self.output = self._controller.take(replace(sample, **changed))
        return self.output

    def move(self, here: Vector[float], in_force: tuple[float, ...] | None = None) -> None:
        """
        Run the plant for a period.

        Parameters
        ----------
        here : tuple of three float
            Displacement of the hand from the first orientation, rad.
        in_force : tuple of float, optional
            Torques of the motors, N m; by default those commanded in the period before.

        """
        self.plant.hand = multiply_quaternions(quaternion_from_vector(*here), self._first)
        rate = tuple((new - old) / DT for new, old in zip(here, self._here, strict=True))
        self._here = here
        self.plant.run(self.torques if in_force is None else in_force, rate, *self.hand)
        self.torques = self.output.motor_torque
        self.stamp += PERIOD
        turn = multiply_quaternions(self.plant.quaternion, conjugate(self._first))
        self._rows.append(
            (
                self.output,
                vector_from_quaternion(*turn),
                self.plant.velocity,
                self.plant.given,
            )
        )

    def trace(self, start: int) -> Trace:
        """Return what has happened, with the row at which the motion began."""
        outputs, turned, velocities, given = zip(*self._rows, strict=True)
        return Trace(
            torque=np.array([each.motor_torque for each in outputs]),
            asked=np.array([each.asked for each in outputs]),
            rendered=np.array([each.rendered or (np.nan,) * 3 for each in outputs]),
            turned=np.array(turned),
            velocity=np.array(velocities),
            given=np.array(given),
            energy=np.array([each.energy for each in outputs]),
            share=np.array([each.share for each in outputs]),
            states=[each.state.text for each in outputs],
            start=start,
        )


def run(
    R: np.ndarray,
    slave: Slave,
    seconds: float,
    *,
    motion: Motion | None = None,
    **setup: Any,
) -> Trace:
    """
    Run the closed loop for some seconds from an orientation.

    Parameters
    ----------
    R : ndarray, shape (3, 3)
        R_base_platform at the start.
    slave : Slave
        Where the wrench comes from: none is felt until the motion begins.
    seconds : float
        Time from the begin of the motion, s.
    motion : callable, optional
        Displacement of the hand, a rotation vector in the base frame; it holds still by default.
    **setup
        As of `ClosedLoop`.

    """
    loop = ClosedLoop(R, **setup)
    start = round((START + 0.06) / DT)
    here: Vector[float] = (0.0, 0.0, 0.0)
    for step in range(start + round(seconds / DT)):
        wrench = slave.take(step, loop.measure())
        if step < start:
            wrench = Wrench(loop.stamp, (0.0, 0.0, 0.0))
        elif motion is not None:
            here = motion((step - start) * DT)
        loop.command(wrench)
        loop.move(here)
    return loop.trace(start)


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
