# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Bring-up of force: signs of the motors, friction of the device, and the stiffness that it allows.

A motor that turns its joint the other way makes every spring an explosion, and a spring that is
stiffer than the friction of the device allows swings by itself. The turns of all joints by a small
step of each motor are columns of the inverse of an inertia. So a motor turns its joint in its own
sense, whatever the pose (positive diagonal); of the joints th1A, th1B, th1C it turns its own most,
but for one pose and motor in a hundred; and it turns another motor's joint as much as that motor
turns its joint (symmetry), which shows swapped motors and wrong rated torques.

With the torque m about one direction of the handle, from rest,

    I theta'' + b theta' + c sign(theta') = m

is linear in inertia I, viscous friction b and dry friction c, and after two integrations needs
angles alone. A spring of the control is passive below

    K = (b + B) / (T / 2 + t_d)

(Colgate and Schenkel 1997) with the damping B, the period T and the latency t_d; as a velocity
lags, half of that is allowed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.kinematics.number_backends import Array

# Of one release, shape (n,): time (s), turn about one direction (rad), torque about it (N m).
Release: TypeAlias = tuple[Array, Array, Array]
# Joints of the motors, in their order.
MOTOR_JOINTS = 'th1A', 'th1B', 'th1C', 'th3A'
# Joints of which a motor on one of them turns its own most.
COMPARED = 3
# Least turn of a joint that is seen (rad): some ten times the noise of an encoder.
VISIBLE_TURN = 0.005
# Turn of a second joint by a motor over that of its own joint by the second motor, from which on
# they are not the same: dry friction changes it by less.
ASYMMETRY = 4.0
# Share of the law that is allowed (unit 1).
STIFFNESS_SHARE = 0.5
# Fewest samples of a step and of a release, and least turn of the handle in this (rad).
FEWEST_OF_STEP = 10
FEWEST = 20
LEAST_TURN = 0.02


@dataclass(frozen=True, slots=True)
class StepResponse:
    """
    What a small step of one motor from rest does.

    Attributes
    ----------
    motor : int
        Index of the motor, in the order of `MOTOR_JOINTS`.
    turns : tuple of float
        Turns of th1A, th1B, th1C, th3A at the end, rad; positive in the sense of the torque.

    """

    motor: int
    turns: tuple[float, ...]

    @property
    def joint(self) -> str:
        """Joint of the motor."""
        return MOTOR_JOINTS[self.motor]

    @property
    def most_turned(self) -> int:
        """Index of the joint that turns most, of those that can be compared."""
        if self.motor >= COMPARED:
            return self.motor
        return int(np.argmax(np.abs(self.turns[:COMPARED])))

    @property
    def is_seen(self) -> bool:
        """Whether a joint turns visibly."""
        return abs(self.turns[self.most_turned]) >= VISIBLE_TURN

    @property
    def is_right(self) -> bool:
        """Whether the motor turns its own joint most, in its own sense."""
        return self.most_turned == self.motor and self.turns[self.motor] >= VISIBLE_TURN

    @property
    def is_reversed(self) -> bool:
        """Whether the motor turns its own joint most, but the other way."""
        return self.most_turned == self.motor and self.turns[self.motor] <= -VISIBLE_TURN

    @property
    def words(self) -> str:
        """Return what is to be known of it, in words."""
        own = f'motor on {self.joint}'
        if not self.is_seen:
            return f'{own}: not seen: no joint turned; is it connected, its rated torque right?'
        if self.most_turned != self.motor:
            other = MOTOR_JOINTS[self.most_turned]
            return f'{own} turns {other} most: are node ids or cables swapped?'
        return f'{own}: sign {"right" if self.is_right else "wrong: it turns the other way"}'


def step_response(
    motor: int,
    torque: Array,
    angles: Array,
) -> StepResponse:
    """
    Return what a small step of one motor does.

    Parameters
    ----------
    motor : int
        Index of the motor.
    torque : ndarray, shape (n,)
        Its torque, N m; 5 samples or more at rest come first. Those of the others are constant.
    angles : ndarray, shape (n, 4)
        th1A, th1B, th1C, th3A meanwhile, rad.

    Raises
    ------
    InputError
        Too few samples.

    """
    _check_length('a step', angles, FEWEST_OF_STEP)
    # A raw angle may differ by a turn.
    unwrapped = np.unwrap(angles, axis=0)
    at_first = np.mean(unwrapped[:5], axis=0)
    at_last = np.mean(unwrapped[-5:], axis=0)
    turned = at_last - at_first
    push = float(np.sum(torque - np.mean(torque[:5])))
    along_push = np.sign(push) * turned
    return StepResponse(motor, tuple(along_push.tolist()))


def wiring_faults(responses: Sequence[StepResponse]) -> list[str]:
    """
    Return what the steps of all motors show of wrong signs, swapped motors and rated torques.

    Parameters
    ----------
    responses : sequence of StepResponse
        One step of each motor.

    Returns
    -------
    list of str
        A line for each fault; empty where all is right. A direction is to be reversed only where
        nothing else is wrong: the advice is not there before.

    """
    wrong = [each for each in responses if not each.is_right]
    unequal = [
        text
        for one, other in combinations(responses, 2)
        if (text := _asymmetry(one, other)) is not None
    ]
    faults = [each.words for each in wrong] + unequal
    if not unequal and all(each.is_reversed for each in wrong):
        return [f'{text}: reverse its direction' for text in faults]
    return faults


def _asymmetry(one: StepResponse, other: StepResponse) -> str | None:
    """Return in words that two motors turn the joints of each other unequally; None if equally."""
    there = abs(one.turns[other.motor])
    back = abs(other.turns[one.motor])
    if there < back:
        one, other, there, back = other, one, back, there
    if there < VISIBLE_TURN or there < ASYMMETRY * back:
        return None
    return (
        f'motor on {one.joint} turns {other.joint} by {there:.3f} rad, but the motor on '
        f'{other.joint} turns {one.joint} by {back:.3f}: is a rated torque wrong, or are motors '
        'swapped?'
    )


@dataclass(frozen=True, slots=True)
class Friction:
    """
    Inertia and friction of the device about one direction of the handle.

    Attributes
    ----------
    inertia : float
        Inertia I, kg m^2.
    viscous : float
        Viscous friction b, N m s/rad.
    dry : float
        Dry (Coulomb) friction c, N m.

    """

    inertia: float
    viscous: float
    dry: float

    def stiffest(
        self,
        damping: float,
        period: float,
        latency: float,
    ) -> float:
        """
        Return the stiffest spring that the friction of the device keeps passive.

        K = (b + B) / (T / 2 + t_d) (Colgate and Schenkel 1997), of which `STIFFNESS_SHARE` is
        allowed.

        Parameters
        ----------
        damping : float
            Damping B that the control adds, N m s/rad.
        period : float
            Period T of the control, s.
        latency : float
            Time t_d from an angle to its torque, s.

        Returns
        -------
        float
            Stiffness, N m/rad.

        """
        return STIFFNESS_SHARE * max(0.0, self.viscous + damping) / (0.5 * period + latency)


def identify_friction(releases: Sequence[Release]) -> Friction:
    """
    Return inertia and friction from releases: a torque for a moment, then none, on a free handle.

    Linear least squares for I, b and c in the equation of motion (see the module), integrated
    twice over time, so that only the angle is needed.

    Parameters
    ----------
    releases : sequence of Release
        Time, turn and torque of each release. The turn is from rest to before the handle stops;
        the torque is that of the motors less the weight.

    Returns
    -------
    Friction
        Inertia and friction about the direction of the releases.

    Raises
    ------
    InputError
        A release has too few samples.
    CalibrationError
        A release does not turn the handle, all have one speed, or the handle turns against the
        torque.

    """
    columns = []
    sides = []
    for number, (time, angle, torque) in enumerate(releases, start=1):
        _check_length(f'release {number}', time, FEWEST)
        # Before the torque comes up the handle rests.
        start = max(1, int(np.argmax(torque != 0.0)))
        turned = angle - np.mean(angle[:start])
        if np.abs(turned).max() < LEAST_TURN:
            raise CalibrationError(
                f'release {number} turns the handle by '
                f'{np.abs(turned).max():.4f} rad: expected {LEAST_TURN:g} or '
                'more; is the handle free?'
            )
        moving = np.sign(turned[-1]) * (np.arange(len(angle)) >= start)
        # I turn + b int turn + c int int sign(turn') = int int torque, from rest.
        columns.append(
            np.column_stack(
                [turned, _integral(time, turned), _integral(time, _integral(time, moving))]
            )
        )
        sides.append(_integral(time, _integral(time, torque)))
    matrix = np.concatenate(columns)
    scale = np.linalg.norm(matrix, axis=0)
    values, _, rank, _ = np.linalg.lstsq(matrix / scale, np.concatenate(sides), rcond=1e-3)
    inertia, viscous, dry = (values / scale).tolist()
    if rank < 3:
        raise CalibrationError(
            f'releases determine {rank} of inertia, viscous and dry friction: expected 3, by two '
            'speeds'
        )
    if inertia <= 0.0:
        raise CalibrationError(
            f'the handle turns against the torque of the releases (inertia {1e3 * inertia:.2g} '
            'g m^2): does a motor have the wrong sign, are two swapped, is a rated torque wrong?'
        )
    return Friction(
        inertia=inertia,
        viscous=viscous,
        dry=dry,
    )


def _integral(time: Array, values: Array) -> Array:
    """Return the integral from the first time on, by trapezia."""
    means = 0.5 * (values[1:] + values[:-1])
    steps = np.diff(time) * means
    found: Array = np.concatenate([[0.0], np.cumsum(steps)])
    return found


def _check_length(
    part: str,
    values: Array,
    fewest: int,
) -> None:
    """Raise InputError if a part of a recording has fewer samples than are needed."""
    if len(values) < fewest:
        raise InputError(f'{part} has {len(values)} samples: expected {fewest} or more')
