# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Across the singular surface against a torque: how fast a hand is thrown, by what is chosen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from paper.figure_entry import table
from spm_haptic_master.force import ForceController, ForceLimits, render, three_motors
from spm_haptic_master.kinematics import jacobian, workspace_pose
from study.force.bare import UNBOUNDED, UNLIMITED, weak_bound
from study.force.loop import constant, DT, run, Slave
from study.force.motions import axis, pose, push

# Stiffnesses of hands (N m/rad), and the torque on the handle (N m).
HANDS, THROWN = (1.0, 3.0, 10.0), 0.3
# Time until the torque has come up and the hand holds it (s).
SETTLED = 1.2
# Way of the hand (rad) and its time (s).
ACROSS, SLOWLY = 0.9, 4.0
# Poses and directions of the share that is rendered exactly.
POSES, EXACT = 6000, 1e-9
# What may be chosen: name, bound of the weak part and where it begins, and the limits.
CHOSEN = three_motors.BOUND, three_motors.BEGIN
NONE = UNBOUNDED, 1.0
CHOICES: tuple[tuple[str, tuple[float, float], ForceLimits], ...] = (
    ('**as it is**', CHOSEN, ForceLimits()),
    ('fade alone', NONE, ForceLimits()),
    ('fade alone, twice as wide', NONE, ForceLimits(sigma_full=0.3)),
    ('fade alone, damping of 0.02 N m s/rad', NONE, ForceLimits(damping=0.02)),
    ('fade alone, slew rate of 1 N m/s', NONE, ForceLimits(slew=1.0)),
    ('fade alone, at most 0.15 N m', NONE, ForceLimits(torque=0.15)),
    ('bound of 1.73, from 1 off', (1.73, 1.0), ForceLimits()),
    ('bound of 1.4, from 1 off', (1.4, 1.0), ForceLimits()),
    ('bound of 1.2, from 1 off', (1.2, 1.0), ForceLimits()),
    ('bound of 1.4, from 0.4 off', (1.4, 0.4), ForceLimits()),
)


def exact_share(limits: ForceLimits) -> float:
    """Return the share of poses and directions of the workspace that are rendered exactly."""
    rng = np.random.default_rng(6)
    tilt, azimuth, phi = rng.uniform(size=(3, POSES))
    R = workspace_pose(
        np.radians(20.0) * np.sqrt(tilt), 2.0 * np.pi * azimuth, np.radians(95.0) * phi
    )
    R = R[np.isfinite(jacobian(R)).all((1, 2))]
    drawn = rng.normal(size=(len(R), 3))
    m = THROWN * drawn / np.linalg.norm(drawn, axis=1)[:, None]
    found = render(R, m, sigma_off=limits.sigma_off, sigma_full=limits.sigma_full)
    return float(np.mean(np.linalg.norm(found.rendered - m, axis=1) < EXACT))


def thrown(stiffness: float, motors: int = 3, limits: ForceLimits | None = None) -> float:
    """
    Return the fastest handle, rad/s, as a hand of some N m/rad pushes across; NaN: a fault.

    It is as fast as it gets: without `force.speed_limit`.
    """
    limits = replace(limits or ForceLimits(), speed=UNLIMITED)
    R = pose(30.0)
    roll = axis(R, 'roll')
    x, y, z = (-THROWN * roll).tolist()
    across = push(roll, ACROSS, rise=SLOWLY)
    found = run(
        R,
        Slave(constant((x, y, z))),
        SETTLED + SLOWLY,
        motors=motors,
        hand=(stiffness, 0.01 * stiffness),
        controller=ForceController(motors=motors, limits=limits),
        motion=lambda time: across(max(0.0, time - SETTLED)),
    )
    if found.states[-1] != 'engaged':
        return float('nan')
    first = found.start + round(SETTLED / DT)
    return float(np.linalg.norm(found.velocity[first:], axis=1).max())


def crossing() -> str:
    """Return the table of peak speeds by what is chosen and by the hand, Markdown."""
    rows = []
    for name, bound, limits in CHOICES:
        with weak_bound(*bound):
            rows.append(
                (
                    name,
                    f'{100.0 * exact_share(limits):.1f} %',
                    *(f'{thrown(hand, limits=limits):.2f}' for hand in HANDS),
                )
            )
    rows.append(('four motors', '100 %', *(f'{thrown(hand, 4):.2f}' for hand in HANDS)))
    return table(('', 'exact', *(f'hand {hand:g} N m/rad' for hand in HANDS)), rows)
