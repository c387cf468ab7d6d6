# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the hand gets when something is lost, lies, is wired wrongly, or the workspace ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import cache
from math import pi, radians, sin

import numpy as np
from paper.figure_entry import table
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.force import ForceCondition, ForceController, ForceLimits, Gravity, Wrench
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.kinematics.number_backends import Vector
from study.force.limit_row import Row
from study.force.loop import ClosedLoop, DT, GEOMETRY, PERIOD, SIGMA, Trace
from study.force.motions import axis, pose, push
from study.force.session import Computer

STILL: Vector[float] = (0.0, 0.0, 0.0)
# Periods until force is engaged, and its ramp of 50 ms is over.
ENGAGED = 210
# Speeds of the handle when the wrench is lost (rad/s), and its way until then (rad).
SPEEDS, RUN_UP = (0.0, 3.0, 8.0), 0.25
# Weight of a handle (N m), and what of it is known (unit 1).
WEIGHT, KNOWN = 0.13, 0.8
GRAVITY = 9.80665
# Speeds of an encoder that runs away (rad/s).
DRIFTS = (1.0, 5.0, 10.0, 20.0, 28.0)
# A slave that is unstable: torque (N m) and frequency (Hz); a hand (N m/rad, N m s/rad).
UNSTABLE, FREQUENCY, HAND = 0.3, 3.0, (1.0, 0.01)
# Pauses of its wrench, and taps of the clutch (periods), each 0.9 s; and until when it is small.
PAUSES, SMALL_UNTIL = {'wrench': 45, 'clutch': 20}, 70
# Fastest handle where the wiring is wrong (rad/s): the default of `force.speed_limit`.
SPEED_LIMIT = 6.0
# Hands that meet an end stop at a speed (rad/s).
STOPPED, AT = (0.3, 1.0, 10.0), 3.0


def largest_step(found: Trace, first: int, end: int | None = None) -> float:
    """Return the largest step of the torque that the handle gets within a period, N m."""
    felt = found.rendered[first:end]
    felt = felt[np.isfinite(felt).all(axis=1)]
    return float(np.linalg.norm(np.diff(felt, axis=0), axis=1).max())


def wrench_lost(speed: float, torque: float = 0.0) -> Trace:
    """Lose a wrench against the turn of a handle, N m, that turns at a speed, rad/s."""
    R = pose(-15.0)
    roll = axis(R, 'roll')
    x, y, z = (-torque * roll).tolist()
    limits = ForceLimits(ramp=0.05, speed=10.0)
    controller = ForceController(GEOMETRY, motors=4, limits=limits)
    loop = ClosedLoop(R, hand=(10.0, 0.1), motors=4, controller=controller)
    moved = round(RUN_UP / max(speed, 1.0) / DT)
    wrench = Wrench(0, STILL)
    for step in range(ENGAGED + moved + 80):
        loop.measure()
        if step < ENGAGED + moved:
            asked = (x, y, z) if step > 130 else STILL
            wrench = Wrench(loop.stamp, asked)
        way = speed * DT * max(0, step - ENGAGED)
        here = (way * roll).tolist()
        loop.command(wrench)
        loop.move((here[0], here[1], here[2]))
    return loop.trace(ENGAGED + moved)


def sag(stiffness: float = 0.3) -> tuple[float, float]:
    """Return how far a handle falls when the wrench is lost, rad, and its largest speed, rad/s."""
    R = workspace_pose(0.2, 0.3, radians(15.0))
    offset = WEIGHT / GRAVITY
    gravity = Gravity(handle=(KNOWN * offset, 0.0, 0.0))
    controller = ForceController(GEOMETRY, limits=ForceLimits(ramp=0.05), gravity=gravity)
    loop = ClosedLoop(R, hand=(stiffness, 0.01), controller=controller)
    loop.plant.weight = (offset, 0.0, 0.0)
    lost = 1500
    # The hand holds the handle by itself until it is compensated.
    loop.hand = (30.0, 0.3)
    for step in range(lost + 1500):
        loop.measure()
        if step == 500:
            loop.hand = (stiffness, 0.01)
        if step < lost:
            wrench = Wrench(loop.stamp, STILL)
        loop.command(wrench)
        loop.move(STILL)
    found = loop.trace(lost)
    fallen = np.linalg.norm(found.turned[lost:] - found.turned[lost - 1], axis=1).max()
    return float(fallen), float(np.linalg.norm(found.velocity[lost:], axis=1).max())


class _AtRest:
    """A computer whose encoders read a pose at rest, with their noise."""

    def __init__(self) -> None:
        self._computer, self._rng = Computer(), np.random.default_rng(3)
        self._angles = np.array(ClosedLoop(pose(15.0), hand=None).plant.angles)
        self._samples = 0

    def torques(self, lie: Vector[float] = STILL) -> Vector[float]:
        """Return the torques of the motors after a sample in which the motors' encoders lie."""
        self._samples += 1
        angles = self._angles + SIGMA * self._rng.normal(size=4)
        angles[:3] += lie
        stamp = self._samples * PERIOD
        self._computer.look(stamp, tuple(angles.tolist()))
        return self._computer.act(Wrench(stamp, STILL), clutched=False).motor_torque


@cache
def _rested() -> _AtRest:
    """Return such a computer after 2.1 s, of which each user takes a copy."""
    device = _AtRest()
    for _ in range(2100):
        device.torques()
    return device


def drifting(speed: float, motor: int) -> float:
    """Return the largest torque of a motor whose encoder runs away at a speed, rad/s, N m."""
    device = deepcopy(_rested())
    away = speed * DT * np.eye(3)[motor]
    lies = np.cumsum(np.tile(away, (100, 1)), axis=0)
    return max(abs(device.torques(lie)[motor]) for lie in lies)


def stuttering(pause: str, seconds: float = 60.0) -> tuple[float, str]:
    """
    Return the energy, J, that an unstable slave gets out of the motors, and the last state.

    It pauses for 45 ms each 0.9 s, or the clutch is tapped for 20 ms as often.
    """
    loop = ClosedLoop(pose(20.0), hand=HAND)
    roll = axis(pose(20.0), 'roll')
    wrench = Wrench(0, STILL)
    is_paused = False
    for step in range(ENGAGED + round(seconds / DT)):
        loop.measure()
        if step >= ENGAGED:
            is_paused = (step - ENGAGED) % 900 < PAUSES[pause]
        if not is_paused or pause == 'clutch':
            x, y, z = (_unstable(step) * roll).tolist()
            wrench = Wrench(loop.stamp, (x, y, z))
        loop.command(wrench, clutched=is_paused and pause == 'clutch')
        loop.move(STILL)
        if loop.output.state.condition is ForceCondition.FAULT:
            break
    found = loop.trace(ENGAGED)
    return found.generated, found.states[-1]


def _unstable(step: int) -> float:
    """Return the torque of the unstable slave, N m: small behind a pause, so that force begins."""
    if step < ENGAGED or (step - ENGAGED) % 900 < SMALL_UNTIL:
        return 0.0
    return UNSTABLE if sin(2.0 * pi * FREQUENCY * step * DT) > 0.0 else -UNSTABLE


def end_stop_met(stiffness: float, tilt_deg: float = 20.0) -> tuple[Trace, float]:
    """Lead the handle over its end stop at 3 rad/s and back; return the trace and the margin."""
    R = workspace_pose(radians(tilt_deg), 2.0, radians(60.0))
    roll = axis(R, 'roll')
    loop = ClosedLoop(R, hand=(stiffness, 0.01))
    way = push(roll, 0.45, rise=1.5 * 0.45 / AT, hold=0.3)
    try:
        for step in range(ENGAGED + 1200):
            loop.measure()
            loop.command(Wrench(loop.stamp, STILL))
            loop.move(way((step - ENGAGED) * DT) if step >= ENGAGED else STILL)
    except SpmError:
        # It has left the workspace.
        return loop.trace(ENGAGED), 0.0
    return loop.trace(ENGAGED), 1.0


WIRINGS: dict[str, Callable[[Sequence[float]], tuple[float, ...]]] = {
    'right': lambda t: (t[0], t[1], t[2]),
    '1A reversed': lambda t: (-t[0], t[1], t[2]),
    '1B reversed': lambda t: (t[0], -t[1], t[2]),
    '1C reversed': lambda t: (t[0], t[1], -t[2]),
    '1A and 1B swapped': lambda t: (t[1], t[0], t[2]),
    '1B and 1C swapped': lambda t: (t[0], t[2], t[1]),
    '1A and 1C swapped': lambda t: (t[2], t[1], t[0]),
    'rated torque x 10': lambda t: (10.0 * t[0], 10.0 * t[1], 10.0 * t[2]),
}


def wired(name: str, phi_deg: float = 20.0) -> tuple[float, float, float, str]:
    """
    Touch a free handle whose motors are wired in a way.

    Returns
    -------
    tuple of float, float, float and str
        Times from 1 rad/s, and from the limit of the speed, to zero torque, s, NaN where it never
        is as fast; largest speed, rad/s; last state.

    """
    limits = ForceLimits(ramp=0.05, speed=SPEED_LIMIT)
    controller = ForceController(GEOMETRY, limits=limits)
    loop = ClosedLoop(pose(phi_deg), hand=(1.0, 0.01), controller=controller)
    roll = axis(pose(phi_deg), 'roll')
    wiring = WIRINGS[name]
    try:
        for step in range(ENGAGED + 4000):
            loop.measure()
            loop.command(Wrench(loop.stamp, STILL))
            if step == ENGAGED + 50:
                loop.hand = (0.0, 0.0)
            way = 0.05 * min(1.0, max(0.0, (step - ENGAGED) / 50))
            here = (way * roll).tolist()
            loop.move((here[0], here[1], here[2]), wiring(loop.torques))
    except SpmError:
        pass  # it has left the workspace
    found = loop.trace(ENGAGED)
    speed = np.linalg.norm(found.velocity[found.start + 50 :], axis=1)
    torque = np.abs(found.torque[found.start + 50 :]).max(axis=1)
    return (
        _time_to_none(speed, torque, 1.0),
        _time_to_none(speed, torque, SPEED_LIMIT),
        float(speed.max()),
        found.states[-1],
    )


def _time_to_none(speed: np.ndarray, torque: np.ndarray, since: float) -> float:
    """Return the time from a speed, rad/s, to zero torque, s; NaN: never as fast; inf: no end."""
    fast = np.flatnonzero(speed > since)
    if not len(fast):
        return float('nan')
    ended = np.flatnonzero(torque[fast[0] :] == 0.0)
    return float(DT * ended[0]) if len(ended) else float('inf')


def hand_rows() -> list[Row]:
    """Return the rows of the table of limits: what is found, and its limit."""
    blow = max(
        largest_step(found, found.start - 5) for found in (wrench_lost(speed) for speed in SPEEDS)
    )
    loud = wrench_lost(3.0, 0.3)
    fallen, _ = sag()
    drifts = max(drifting(speed, motor) for speed in DRIFTS for motor in range(3))
    generated = max(stuttering(pause)[0] for pause in ('wrench', 'clutch'))
    stops = [end_stop_met(stiffness)[0] for stiffness in STOPPED]
    step = max(largest_step(found, found.start) for found in stops)
    returned = max(found.generated for found in stops)
    return [
        Row('wrench of zero lost at 0, 3, 8 rad/s: step', 1e3 * blow, 10.0, 'mN m a ms'),
        Row(
            'wrench of 0.3 N m lost at 3 rad/s: step',
            1e3 * largest_step(loud, loud.start - 5),
            10.0,
            'mN m a ms',
        ),
        Row(
            'weight of 0.13 N m, known to 20 %, wrench lost, hand of 0.3 N m/rad: sag',
            float(np.degrees(fallen)),
            3.0,
            'deg',
        ),
        Row('encoder that runs away at 1 to 28 rad/s: its motor', 1e3 * drifts, 20.0, 'mN m'),
        Row('unstable slave that stutters, a minute: generated', 1e3 * generated, 25.0, 'mJ'),
        Row('end stop met at 3 rad/s, hands of 0.3, 1, 10 N m/rad: step', step, 0.15, 'N m a ms'),
        Row('the same: energy that comes back in all', 1e3 * returned, 0.01, 'mJ'),
    ]


def wiring_table() -> str:
    """Return what a free handle does that is touched, by its wiring, Markdown."""
    rows = []
    for name in WIRINGS:
        *times, speed, state = wired(name)
        ends = [f'{1e3 * time:.0f}' if np.isfinite(time) else '-' for time in times]
        rows.append((name, f'{speed:.1f}', *ends, state))
    return table(
        (
            'wiring',
            'fastest, rad/s',
            'torque ends, ms after 1 rad/s',
            f'ms after {SPEED_LIMIT:g} rad/s',
            'at last',
        ),
        rows,
    )
