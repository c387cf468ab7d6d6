# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Bring-up of force: signs of the motors, friction of the device, and the stiffness that it allows.

A motor that turns its joint the other way makes every spring an explosion, and a spring that is
stiffer than the friction of the device allows swings by itself. A torque on a motor alone turns
its joint in its own sense, whatever the pose: the inverse of an inertia has a positive diagonal.
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
from typing import TypeAlias

import numpy as np
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.kinematics.number_backends import Array

# Of one release, shape (n,): time (s), turn about one direction (rad), torque about it (N m).
Release: TypeAlias = tuple[Array, Array, Array]
# Least turn of a joint that shows a sign (rad): some ten times the noise of an encoder.
VISIBLE_TURN = 0.005
# Share of the law that is allowed (unit 1).
STIFFNESS_SHARE = 0.5
# Fewest samples of a step and of a release, and least turn of the handle in this (rad).
FEWEST_OF_STEP, FEWEST, LEAST_TURN = 10, 20, 0.02


def motor_sign(torque: Array, angle: Array) -> int:
    """
    Return the sign of a motor from a small step at rest: 1, -1, or 0 if its joint does not turn.

    By its torque, N m, (n,), of 5 samples or more at rest, and the angle of its joint, rad, (n,),
    while the other motors' torques are constant. InputError: too few samples.
    """
    _check_length('a step', angle, FEWEST_OF_STEP)
    # A raw angle may differ by a turn.
    theta = np.unwrap(angle)
    turned = float(np.mean(theta[-5:]) - np.mean(theta[:5]))
    push = float(np.sum(torque - np.mean(torque[:5])))
    return 0 if abs(turned) < VISIBLE_TURN else int(np.sign(turned * push))


@dataclass(frozen=True, slots=True)
class Friction:
    """Inertia and friction of the device about one direction of the handle."""

    inertia: float  # kg m^2
    viscous: float  # N m s/rad
    dry: float  # N m

    def stiffest(self, damping: float, period: float, latency: float) -> float:
        """Return the stiffness, N m/rad, that damping, N m s/rad, period and latency, s, allow."""
        return STIFFNESS_SHARE * max(0.0, self.viscous + damping) / (0.5 * period + latency)


def identify_friction(releases: Sequence[Release]) -> Friction:
    """
    Return inertia and friction by releases: a torque for a moment, then none, on a free handle.

    The turn is from rest to before the handle stops; the torque is that of the motors less the
    weight. InputError: too few samples. CalibrationError: a release does not move, or two speeds
    are missing.
    """
    columns, sides = [], []
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
    if rank < 3 or inertia <= 0.0:
        raise CalibrationError(
            f'releases determine {rank} of inertia, viscous and dry friction '
            f'(inertia {inertia:.2g} kg m^2): expected 3, by two speeds'
        )
    return Friction(inertia, viscous, dry)


def _integral(time: Array, values: Array) -> Array:
    """Return the integral from the first time on, by trapezia."""
    steps = 0.5 * np.diff(time) * (values[1:] + values[:-1])
    found: Array = np.concatenate([[0.0], np.cumsum(steps)])
    return found


def _check_length(part: str, values: Array, fewest: int) -> None:
    if len(values) < fewest:
        raise InputError(f'{part} has {len(values)} samples: expected {fewest} or more')
