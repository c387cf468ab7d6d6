# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A session to feel, in simulated time: a wall, the singular surface, a clutch, losses, an end stop.

The device is MuJoCo's; the verdict about each sample is the supervision's, with the defaults of
`fkm`; the torque is `ForceController`'s. The handle turns about its own axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import degrees, radians
from typing import NamedTuple

import numpy as np
from spm_haptic_master.force import DrivesState, ForceController, ForceOutput, ForceSample, Wrench
from spm_haptic_master.kinematics import jacobian, matrix_from_quaternion
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
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
            self._sample = replace(
                self._sample, quaternion=self.quaternion, velocity=self._velocity.value()
            )

    def act(
        self, wrench: Wrench | None, *, drives: DrivesState = DrivesState.OPERATING, clutched: bool
    ) -> ForceOutput:
        """Return the force output of that sample."""
        return self.force.take(
            replace(self._sample, wrench=wrench, drives=drives, clutched=clutched)
        )


def within(time: float, span: tuple[float, float]) -> bool:
    """Return whether a time is in a span, s."""
    return span[0] - 0.5 * DT <= time < span[1] - 0.5 * DT


class Row(NamedTuple):
    """What is kept of a period."""

    time: float
    angle: float
    wall: float
    commanded: float
    motor_torque: tuple[float, ...]
    quaternion: Quaternion[float]
    given: float
    energy: float
    velocity: Vector[float]
    state: str
    verdict: str


class Play:
    """Hand, device, computer and slave of a session, period after period."""

    def __init__(self, seed: int) -> None:
        R = pose(START_DEG)
        self.roll = axis(R, 'roll')
        self._plant = Plant(R)
        self._first = self._plant.hand
        self._computer = Computer()
        start = self._turned(radians(WALL_DEG))
        self._slave = Slave(wall(start, self.roll, WALL), SLAVE_PERIOD, THERE, BACK)
        self._rng = np.random.default_rng(seed)
        # Turns of the slave, of the handle less that, and of the hand (rad).
        self._followed = 0.0
        self._offset = 0.0
        self._hand = 0.0
        self._wrench: Wrench | None = None
        self._torques: tuple[float, ...] = (0.0, 0.0, 0.0)
        self._output: ForceOutput = self._computer.force.output

    def _turned(self, angle: float) -> Quaternion[float]:
        """Return the orientation that is turned from the first one, rad."""
        x, y, z = (angle * self.roll).tolist()
        return multiply_quaternions(quaternion_from_vector(x, y, z), self._first)

    def _turn(self, quaternion: Quaternion[float]) -> float:
        """Return the turn of an orientation from the first one, rad."""
        turn = multiply_quaternions(quaternion, conjugate(self._first))
        return float(np.dot(vector_from_quaternion(*turn), self.roll))

    def step(self, step: int) -> Row:
        """Play a period."""
        time = step * DT
        noise = SIGMA * self._rng.normal(size=4)
        in_force = self._torques
        if time < MASTER:
            self._compute(step, noise)
        elif time >= MASTER + EVENT_TIMER:
            in_force = (0.0, 0.0, 0.0)
        if within(time, DRIVE):
            in_force = (in_force[0], 0.0, in_force[2])
        # The command is in force one period after its sample.
        self._move(hand_turn(time), in_force)
        self._torques = self._output.motor_torque
        wrench = self._wrench
        return Row(
            time=time,
            angle=START_DEG + degrees(self._turn(self._plant.quaternion)),
            wall=START_DEG + WALL_DEG + degrees(self._offset),
            commanded=0.0 if wrench is None else float(np.dot(wrench.torque, self.roll)),
            motor_torque=in_force,
            quaternion=self._plant.quaternion,
            given=self._plant.given,
            energy=self._output.energy,
            velocity=self._plant.velocity,
            state=self._output.state.text,
            verdict=self._computer.verdict,
        )

    def _compute(self, step: int, noise: np.ndarray) -> None:
        """Let the computer take a sample, and the slave follow."""
        time = step * DT
        angles = np.array(self._plant.angles) + noise
        if within(time, ENCODER):
            angles[1] += LIE
        self._computer.look((step + 1) * PERIOD, quantised(angles))
        self._follow(step)
        if any(abs(time - each) < 0.5 * DT for each in ACKNOWLEDGED):
            self._computer.force.acknowledge()
        self._output = self._computer.act(
            self._wrench,
            drives=DrivesState.FAULT if within(time, DRIVE) else DrivesState.OPERATING,
            clutched=within(time, CLUTCH),
        )

    def _follow(self, step: int) -> None:
        """Let the slave follow, and its wrench arrive."""
        time = step * DT
        if self._computer.quaternion is not None:
            here = self._turn(self._computer.quaternion)
            if within(time, CLUTCH):
                self._offset = here - self._followed
            self._followed = here - self._offset
        arrived = self._slave.take(step, self._turned(self._followed))
        if within(time, NO_WRENCH) or within(time, END_STOP):
            return
        self._wrench = arrived and replace(arrived, received=arrived.received + PERIOD)

    def _move(self, angle: float, in_force: tuple[float, ...]) -> None:
        """Move the hand to an angle, rad, and run the plant."""
        self._plant.hand = self._turned(angle)
        x, y, z = ((angle - self._hand) / DT * self.roll).tolist()
        self._hand = angle
        self._plant.run(in_force, (x, y, z), *HAND)


def play(progress: Callable[[float], None] | None = None, seed: int = 1) -> Session:
    """Play the session; `progress` gets the share that is done, 0 to 1, each simulated 0.1 s."""
    session, rows = Play(seed), []
    count = round(END / DT)
    for step in range(count):
        if progress is not None and step % 100 == 0:
            progress(step / count)
        rows.append(session.step(step))
    columns = {name: _column(rows, name) for name in Row._fields}
    G = jacobian(matrix_from_quaternion(columns['quaternion']))
    felt = np.einsum('nij,ni->nj', G, columns['motor_torque'])
    return Session(
        time=columns['time'],
        angle=columns['angle'],
        wall=columns['wall'],
        commanded=columns['commanded'],
        rendered=felt @ session.roll,
        felt=np.linalg.norm(felt, axis=1),
        motor_torque=columns['motor_torque'],
        given=columns['given'],
        energy=columns['energy'],
        speed=np.linalg.norm(columns['velocity'], axis=1),
        states=columns['state'].tolist(),
        verdicts=columns['verdict'].tolist(),
    )


def _column(rows: list[Row], name: str) -> np.ndarray:
    """Return what is kept by a name, one row a period."""
    return np.array([getattr(row, name) for row in rows])
