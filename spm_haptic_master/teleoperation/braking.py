# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Speeds from which a motion can still stop in time, when it slows down by steps.

Both are for a deceleration that changes the speed before the step is made: a step of dt at speed
v moves v dt, and the next speed is lower by a dt.
"""

from __future__ import annotations

from math import sqrt

# Share by which a target may exceed a limit and still be followed exactly (unit 1): rounding.
ROUNDING = 1e-9


def braking_speed(
    room: float,
    dt: float,
    acceleration: float,
) -> float:
    """
    Return the largest speed of one step after which the rest can stop within what is left.

    Solves v dt + v^2 / (2 a) = room. The steps that follow may have any length: a step at the
    speed v - a dt moves no farther than a motion that slows down continuously.

    Parameters
    ----------
    room
        Distance to the end, rad or m; below zero it counts as none.
    dt
        Duration of this step, s.
    acceleration
        Largest deceleration a, rad/s^2 or m/s^2.

    Returns
    -------
    float
        Speed, rad/s or m/s.

    """
    if room <= 0.0:
        return 0.0
    return acceleration * (sqrt(dt * dt + 2.0 * room / acceleration) - dt)


def closing_speed(
    distance: float,
    dt: float,
    speed_change: float,
) -> float:
    """
    Return the largest speed from which equal steps end exactly at a distance.

    n full steps, each slower than the one before by `speed_change`, and one that covers the rest:
    the sum of speed_change dt (1 + 2 + ... + n) is the distance that n full steps cover.

    Parameters
    ----------
    distance
        Distance to cover, rad or m, 0 or more.
    dt
        Duration of each step, s.
    speed_change
        Largest change of the speed from one step to the next, rad/s or m/s.

    Returns
    -------
    float
        Speed of the next step, rad/s or m/s.

    """
    full_steps = int(0.5 * (sqrt(1.0 + 8.0 * distance / (speed_change * dt)) - 1.0))
    return 0.5 * speed_change * full_steps + distance / ((full_steps + 1) * dt)
