# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A session to feel, in simulated time: a wall, the singular surface, a clutch, losses, an end stop.

The device is MuJoCo's; the verdict about each sample is the supervision's, with the defaults of
`fkm`; the torque is `ForceController`'s. The handle turns about its own axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, radians

import numpy as np
from spm_haptic_master.force import Drives, ForceController, ForceOutput, ForceSample, Wrench
from spm_haptic_master.kinematics import jacobian, matrix_from_quaternion
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import (
    AngularVelocity,
    conjugate,
    multiply_quaternions,
    quaternion_from_vector,
    vector_from_quaternion,
)
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.supervisor import make_supervisor
from study.force.loop import DT, PERIOD, quantised, SIGMA, Slave, wall, WINDOW
from study.force.motions import axis, pose
from study.force.plant import Plant

# Self-rotation at the start, and the slave's wall beyond it (deg); its stiffness (N m/rad).
START_DEG, WALL_DEG, WALL = 5.0, 10.0, 1.0
# The hand's grip: N m/rad and N m s/rad.
HAND = (3.0, 0.03)
# The slave's wrench comes every 5 ms; the orientation takes 10 ms there, the wrench 20 ms back.
SLAVE_PERIOD, THERE, BACK = 5, 10, 20
# Time after the last torque frame after which a drive ends its torque by itself (s).
EVENT_TIMER = 0.01
# What the encoder of th1B reads too much while it is faulty (rad).
LIE = radians(5.0)

# Where the hand is: time (s), and its turn from the start (deg); smooth between them.
HAND_WAY = (
    (0.0, 0.0),
    (0.3, -4.0),
    (0.6, 6.0),
    (0.9, 0.0),
    (1.3, 0.0),
    (1.8, 22.0),
    (2.4, 22.0),
    (2.8, 0.0),
    (3.1, 0.0),
    (4.4, 64.0),
    (4.6, 64.0),
    (5.9, 0.0),
    (6.2, 0.0),
    (6.6, 22.0),
    (7.2, 22.0),
    (7.5, 14.0),
    (7.8, 14.0),
    (8.1, -4.0),
    (8.5, -4.0),
    (8.8, 14.0),
    (9.5, 14.0),
    (9.8, -4.0),
    (10.4, -4.0),
    (10.8, 14.0),
    (11.5, 14.0),
    (11.8, -4.0),
    (12.3, 6.0),
    (12.8, -4.0),
    (13.6, -4.0),
    (14.0, 14.0),
    (14.7, 14.0),
    (15.0, -4.0),
    (16.0, -4.0),
    (17.3, 139.0),
    (17.8, 139.0),
    (19.1, -4.0),
    (19.6, -4.0),
    (20.0, 14.0),
    (21.2, 14.0),
)
# What happens: from, to (s).
CLUTCH, NO_WRENCH, ENCODER, DRIVE = (7.1, 7.7), (9.2, 9.9), (11.2, 11.9), (14.4, 15.1)
# No wrenches either while the hand leads the handle over the end stop.
END_STOP = (15.9, 19.0)
MASTER = 20.5
# When somebody acknowledges a fault (s).
ACKNOWLEDGED = (12.2, 15.3)
END = 21.2


@dataclass(frozen=True, slots=True)
class Loss:
    """
    Something that is lost, and what its torque did.

    Attributes
    ----------
    name : str
        What is lost.
    time, limit : float
        When, and how long the torque may last, s.

    """

    name: str
    time: float
    limit: float


LOSSES = (
    Loss('the wrench of the slave', NO_WRENCH[0], 0.05),
    Loss('an encoder', ENCODER[0], 0.025),
    Loss('a drive', DRIVE[0], 0.005),
    Loss('the master', MASTER, 0.01),
)


@dataclass(frozen=True, slots=True)
class Session:
    """
    What a session leaves, one row a millisecond.

    Attributes
    ----------
    time : ndarray, shape (n,)
        s.
    angle, wall : ndarray, shape (n,)
        Self-rotation of the handle, and where the slave meets its wall, deg.
    commanded, rendered : ndarray, shape (n,)
        Torque about the handle's axis: that of the latest wrench, and that of the motors, N m.
    felt : ndarray, shape (n,)
        Torque of the motors on the handle about all axes, N m.
    motor_torque : ndarray, shape (n, 3)
        Torques of the motors, N m.
    given, energy : ndarray, shape (n,)
        Energy that the motors gave in all, and what they may still give, J.
    speed : ndarray, shape (n,)
        Of the handle, rad/s.
    states : list of str
        Words of `force_state`.
    verdicts : list of str
        Words of `state`.

    """

    time: np.ndarray
    angle: np.ndarray
    wall: np.ndarray
    commanded: np.ndarray
    rendered: np.ndarray
    felt: np.ndarray
    motor_torque: np.ndarray
    given: np.ndarray
    energy: np.ndarray
    speed: np.ndarray
    states: list[str]
    verdicts: list[str]

    def time_to_zero(self, loss: Loss) -> float:
        """Return how long the motors have torque after a loss, s."""
        after = self.time >= loss.time - 0.5 * DT
        torque = np.abs(self.motor_torque[after]).max(axis=1)
        return float(DT * np.argmin(torque > 0.0)) if (torque == 0.0).any() else np.inf

    def ends_in(self, loss: Loss) -> str:
        """Return the first words of `force_state` after a loss that differ from `engaged`."""
        first = round(loss.time / DT)
        return next((text for text in self.states[first:] if text != 'engaged'), 'engaged')


def hand_turn(time: float) -> float:
    """Return the hand's turn, rad."""
    for (start, before), (end, after) in zip(HAND_WAY, HAND_WAY[1:], strict=False):
        if time < end:
            share = max(0.0, (time - start) / (end - start))
            return radians(before + (after - before) * share * share * (3.0 - 2.0 * share))
    return radians(HAND_WAY[-1][1])


class Computer:
    """The computer: supervision, angular velocity and force feedback, sample by sample."""

    def __init__(self) -> None:
        self._supervisor = make_supervisor(complete(FKM_SETTINGS, {}))
        self.force, self._velocity = ForceController(), AngularVelocity(WINDOW)
        self.quaternion: Quaternion[float] | None = None
        self.verdict = ''

    def look(self, stamp: int, angles: tuple[float, ...]) -> None:
        """Take a sample: orientation and verdict."""
        decided = self._supervisor.take(stamp, angles)
        self._sample = ForceSample(
            stamp,
            angles,
            None,
            None,
            decided.protection_level,
            max(self._supervisor.joints.noise()) / SIGMA,
        )
        self.verdict, self.quaternion = decided.announced.text, None
        if decided.estimate is None:
            self._velocity = AngularVelocity(WINDOW)
        else:
            self.quaternion = decided.estimate.quaternion
            self._velocity.add(stamp, self.quaternion)
            self._sample = self._sample._replace(
                quaternion=self.quaternion, velocity=self._velocity.value()
            )

    def act(
        self, wrench: Wrench | None, *, drives: Drives = Drives.OPERATING, clutched: bool
    ) -> ForceOutput:
        """Return the force output of that sample."""
        return self.force.take(
            self._sample._replace(wrench=wrench, drives=drives, clutched=clutched)
        )


def within(time: float, span: tuple[float, float]) -> bool:
    """Return whether a time is in a span, s."""
    return span[0] - 0.5 * DT <= time < span[1] - 0.5 * DT


def play(progress: Callable[[float], None] | None = None, seed: int = 1) -> Session:
    """Play the session; `progress` gets the share that is done, 0 to 1, each simulated 0.1 s."""
    R = pose(START_DEG)
    roll, plant, master = axis(R, 'roll'), Plant(R), Computer()
    rx, ry, rz = roll.tolist()
    first = plant.hand

    def turned(angle: float) -> Quaternion[float]:
        return multiply_quaternions(
            quaternion_from_vector(angle * rx, angle * ry, angle * rz), first
        )

    def turn(quaternion: Quaternion[float]) -> float:
        x, y, z = vector_from_quaternion(*multiply_quaternions(quaternion, conjugate(first)))
        return x * rx + y * ry + z * rz

    slave = Slave(wall(turned(radians(WALL_DEG)), roll, WALL), SLAVE_PERIOD, THERE, BACK)
    count = round(END / DT)
    readings = SIGMA * np.random.default_rng(seed).normal(size=(count, 4))
    # Turn of the slave, and of the handle less that (rad).
    command = offset = before = 0.0
    wrench: Wrench | None = None
    torques = in_force = (0.0, 0.0, 0.0)
    rows = []
    for step in range(count):
        time, stamp = step * DT, (step + 1) * PERIOD
        if progress is not None and step % 100 == 0:
            progress(step / count)
        if time < MASTER:
            angles = np.array(plant.angles) + readings[step]
            if within(time, ENCODER):
                angles[1] += LIE
            master.look(stamp, quantised(angles))
            if master.quaternion is not None:
                here = turn(master.quaternion)
                if within(time, CLUTCH):
                    offset = here - command
                command = here - offset
            arrived = slave.take(step, turned(command))
            if not (within(time, NO_WRENCH) or within(time, END_STOP)):
                wrench = arrived and arrived._replace(received=arrived.received + PERIOD)
            if any(abs(time - each) < 0.5 * DT for each in ACKNOWLEDGED):
                master.force.acknowledge()
            output = master.act(
                wrench,
                drives=Drives.FAULT if within(time, DRIVE) else Drives.OPERATING,
                clutched=within(time, CLUTCH),
            )
        elif time >= MASTER + EVENT_TIMER:
            torques = (0.0, 0.0, 0.0)
        angle = hand_turn(time)
        plant.hand = turned(angle)
        rate, before = (angle - before) / DT, angle
        in_force = (torques[0], 0.0, torques[2]) if within(time, DRIVE) else torques
        # The command is in force one period after its sample.
        plant.run(in_force, (rate * rx, rate * ry, rate * rz), *HAND)
        if time < MASTER:
            torques = output.motor_torque
        rows.append(
            (
                time,
                START_DEG + degrees(turn(plant.quaternion)),
                START_DEG + WALL_DEG + degrees(offset),
                0.0 if wrench is None else float(np.dot(wrench.torque, roll)),
                in_force,
                plant.quaternion,
                plant.given,
                output.energy,
                plant.velocity,
                output.state.text,
                master.verdict,
            )
        )
    (
        times,
        angle_rows,
        walls,
        commanded,
        motor_rows,
        quaternions,
        given,
        energies,
        velocities,
        states,
        verdicts,
    ) = zip(*rows, strict=True)
    motor_torque = np.array(motor_rows)
    G = jacobian(matrix_from_quaternion(np.array(quaternions)))
    felt = np.einsum('nij,ni->nj', G, motor_torque)
    return Session(
        np.array(times),
        np.array(angle_rows),
        np.array(walls),
        np.array(commanded),
        felt @ roll,
        np.linalg.norm(felt, axis=1),
        motor_torque,
        np.array(given),
        np.array(energies),
        np.linalg.norm(velocities, axis=1),
        list(states),
        list(verdicts),
    )
