# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The periodic error of an encoder: its harmonics, from joint angle to reading and back.

An encoder that is not centred on its shaft, or an off-axis Hall sensor, reads

    reading = angle + cosine cos(angle) + sine sin(angle) + table(angle)

where `angle` is the joint angle, from the joint's zero. The table has the rest, at n equally
spaced joint angles from 0 on, and between them the trigonometric polynomial through them: n values
are exact for the harmonics of an order below n / 2. The counts are those of the reading:
counts = zero + direction * reading * counts_per_turn / 2 pi.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from spm_haptic_master.exceptions import InputError

# Number of readings in a turn at which the correction is tabulated: every count of 16 bits. A
# finer encoder takes the entry below, off by 5e-5 deg for a first harmonic of 1 deg.
KNOTS = 65536
# The knots (rad).
GRID = np.arange(KNOTS) * (math.tau / KNOTS)

# Least number of values in a table, but for a single one: with fewer no second harmonic.
TABLE_MINIMUM = 5
# Largest number of values in a table: sixteen knots for each of them.
TABLE_MAXIMUM = 4096


@dataclass(frozen=True, slots=True)
class Harmonics:
    """
    Harmonics of one encoder.

    Attributes
    ----------
    cosine, sine : float
        Amplitudes of the first harmonic, rad.
    table : tuple of float
        Further deviations, rad, at equally spaced joint angles from 0 on; empty: none.
    corrections : tuple of float
        Joint angle minus reading, rad, at KNOTS equally spaced readings from 0 on.

    Raises
    ------
    InputError
        A table is too short or too long, or the reading does not increase with the joint angle
        everywhere.

    """

    cosine: float = 0.0
    sine: float = 0.0
    table: tuple[float, ...] = ()
    corrections: tuple[float, ...] = field(init=False, repr=False, compare=False)
    _deviations: NDArray[np.float64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.table and not TABLE_MINIMUM <= len(self.table) <= TABLE_MAXIMUM:
            raise InputError(
                f'a table of {len(self.table)} values, expected {TABLE_MINIMUM} to {TABLE_MAXIMUM}'
            )
        deviations = _deviations(self.cosine, self.sine, self.table)
        # Steps of the reading from one knot to the next, the last to the first of the next turn.
        steps = math.tau / KNOTS + np.diff(deviations, append=deviations[:1])
        if not steps.min() > 0.0:
            raise InputError(
                f'near a joint angle of {math.degrees(GRID[steps.argmin()]):.1f} deg the reading '
                'does not increase with the angle, expected one that is monotonic'
            )
        object.__setattr__(self, '_deviations', deviations)
        object.__setattr__(self, 'corrections', tuple((self.angles(GRID) - GRID).tolist()))

    def readings(self, angles: ArrayLike) -> NDArray[np.float64]:
        """
        Return the readings at joint angles, to n^2 1e-9 of the n-th harmonic.

        Parameters
        ----------
        angles : array_like
            Joint angles, rad, of any shape.

        Returns
        -------
        ndarray
            Readings, rad, of the same shape.

        """
        at = np.asarray(angles, dtype=float)
        found: NDArray[Any] = at + np.interp(at, GRID, self._deviations, period=math.tau)
        return found

    def angles(self, readings: ArrayLike) -> NDArray[np.float64]:
        """
        Return the joint angles at readings: the inverse of `readings`.

        Parameters
        ----------
        readings : array_like
            Readings, rad, of any shape.

        Returns
        -------
        ndarray
            Joint angles, rad, of the same shape.

        """
        at = np.asarray(readings, dtype=float)
        found: NDArray[Any] = at - np.interp(
            at, GRID + self._deviations, self._deviations, period=math.tau
        )
        return found


def _deviations(
    cosine: float,
    sine: float,
    table: tuple[float, ...],
) -> NDArray[np.float64]:
    """Return reading minus joint angle, rad, at the knots."""
    values = table or (0.0, 0.0)
    spectrum = np.fft.rfft(values) * (KNOTS / len(values))
    if len(values) % 2 == 0:
        # The order n / 2 is there once, and twice in the finer series.
        spectrum[-1] *= 0.5
    spectrum[1] += 0.5 * KNOTS * complex(cosine, -sine)
    return np.fft.irfft(spectrum, KNOTS)
