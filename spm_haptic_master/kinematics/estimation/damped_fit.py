# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Whether any orientation near a given one explains the readings, also where they determine none.

Gauss-Newton diverges where the sensors measure one direction hardly at all, as where two of their
solutions meet: that it finds no solution says nothing of the readings. A damped step is that of
readings with which the last orientation is one more measurement, of deviation `DAMPING`: it stays
short along such a direction, and lowers the residuals along the others as an undamped one does.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.closed_form import possible_starts, start_at
from spm_haptic_master.kinematics.estimation.gauss_newton import is_in_mode, moved
from spm_haptic_master.kinematics.estimation.normal_equations import (
    gauss_newton_step,
    Legs,
    linearise,
    normal_equations,
    Row,
    State,
)
from spm_haptic_master.kinematics.estimation.solutions import (
    known_readings,
    Readings,
    START_RESIDUAL,
)
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion, linkage
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion

# Standard deviation of the last state as a measurement of the next one, rad: of the size of the
# steps.
DAMPING = 0.05
# Rows of that measurement: residual 0 along th1A, th2A and th3A.
WEIGHT = 1.0 / DAMPING**2
DAMPED_ROWS: tuple[Row[float], ...] = (
    (0.0, 1.0, 0.0, 0.0, WEIGHT),
    (0.0, 0.0, 1.0, 0.0, WEIGHT),
    (0.0, 0.0, 0.0, 1.0, WEIGHT),
)
# Largest number of steps: what a fault leaves after a few, later ones hardly lower.
DAMPED_STEPS = 15
# Largest correction of a leg that counts as closed, rad: its second order is below the noise.
CLOSED = 0.005


def explaining_orientation(
    near: Quaternion[float] | None,
    readings: tuple[float, ...],
    sensors: UsedSensors,
    geometry: Geometry,
    working_mode: WorkingMode,
    most: float,
) -> Quaternion[float] | None:
    """
    Return an orientation that explains the readings in use to some residual, by damped steps.

    Parameters
    ----------
    near : tuple of four float, or None
        x, y, z, w of R_base_platform to start from; None: the closed forms of the readings.
    readings : tuple of N float
        Angles of the N mounted sensors, rad; one that is not in use may be NaN.
    sensors : UsedSensors
        The sensors in use: three with an orientation to start from, else four or more.
    geometry : Geometry
        The mechanism.
    working_mode : tuple of three int
        Signs of B_kk of the legs A, B, C (eq. 10).
    most : float
        Largest norm of the whitened residuals (unit 1).

    Returns
    -------
    tuple of four float, or None
        Quaternion x, y, z, w; None if the steps lead to none, or to the boundary of the working
        mode, or a leg that lacks a reading does not reach the orientation to start from.

    """
    known = known_readings(readings, sensors)
    for start in _starts(near, known, geometry):
        # A leg may come to the boundary of its working mode on the way.
        with suppress(SingularityError):
            found = _explaining_from(start, known, sensors, geometry, working_mode, most)
            if found is not None:
                return found
    return None


def _starts(
    near: Quaternion[float] | None,
    known: Readings,
    geometry: Geometry,
) -> Iterator[State[float]]:
    """Yield the states to start from."""
    if near is None:
        yield from possible_starts(known, geometry, START_RESIDUAL)
        return
    with suppress(UnreachableError):
        yield start_at(rotation_from_quaternion(*near), known, geometry)


def _explaining_from(
    state: State[float],
    known: Readings,
    sensors: UsedSensors,
    geometry: Geometry,
    working_mode: WorkingMode,
    most: float,
) -> Quaternion[float] | None:
    """
    Return the orientation of the first state that explains the known readings.

    SingularityError if a leg comes to the boundary of its working mode.
    """
    readings = tuple([0.0 if angle is None else angle for angle in known[: len(sensors.sigma)]])
    for _ in range(DAMPED_STEPS):
        th1a, th2a, th3a, th1b, th1c = state
        view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
        legs, rows = linearise(state, view, readings, sensors, geometry, FLOATS)
        is_possible = _are_closed(legs) and is_in_mode(th2a, legs, sensors, working_mode, geometry)
        if is_possible and _squares(rows) <= most * most:
            return chain_quaternion(th1a, th2a, th3a, geometry, FLOATS)
        right, adjugate, determinant, _ = normal_equations(rows + DAMPED_ROWS)
        step, _ = gauss_newton_step(right, legs, adjugate, determinant)
        state = moved(state, step)
    return None


def _are_closed(legs: Legs[float]) -> bool:
    """Whether both legs nearly reach the platform."""
    (correction_b, *_), (correction_c, *_) = legs
    return abs(correction_b) < CLOSED and abs(correction_c) < CLOSED


def _squares(rows: tuple[Row[float], ...]) -> float:
    """Return the weighted sum of the squared residuals (unit 1)."""
    return sum([weight * residual * residual for residual, _, _, _, weight in rows])
