# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Elementary functions for numbers that are either Python floats or numpy arrays.

Every formula of this package is written once, component by component, on numbers. A kernel takes
the elementary functions as its last argument: `FLOATS` for the 1 kHz path (plain floats, no numpy
call) or `ARRAYS` for batches (arrays that broadcast together).
"""

from __future__ import annotations

import math
from typing import Any, Final, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import SingularityError, UnreachableError

Array: TypeAlias = NDArray[np.float64]
# Number of a batch: one value a row, or one for all rows.
Batch: TypeAlias = Array | float
# Number of a kernel: all floats, or all numbers of a batch.
N = TypeVar('N', float, Batch)
Vector: TypeAlias = tuple[N, N, N]
# Rotation matrix, row by row.
Rotation: TypeAlias = tuple[N, N, N, N, N, N, N, N, N]
# Quaternion x, y, z, w.
Quaternion: TypeAlias = tuple[N, N, N, N]
# Largest squared sine below zero that rounding explains at the edge of reach (unit 1).
REACH_TOLERANCE = 1e-12
# Smallest |B_kk| of a pose inside its working mode (unit 1): B_kk is a square root there, and
# rounding of 1e-16 in its square leaves four good digits at this size.
MODE_BOUNDARY = 1e-6
# Rows of a batch that are done together: their numbers stay in the processor's cache.
SLICE = 4096


class Backend(Protocol[N]):
    """Elementary functions of one kind of number."""

    def sin(self, angle: N, /) -> N:
        """Return the sine of an angle in rad."""

    def cos(self, angle: N, /) -> N:
        """Return the cosine of an angle in rad."""

    def atan2(self, y: N, x: N, /) -> N:
        """Return the angle of the point (x, y), rad in [-pi, pi]."""

    def remainder(self, angle: N, turn: float, /) -> N:
        """Return an angle less the nearest multiple of a turn, rad."""

    def half_turn(self, y: N, x: N, /) -> tuple[N, N]:
        """Return cosine and sine of half the angle of the point (x, y), the cosine 0 or more."""

    def sqrt(self, square: N, /) -> N:
        """Return the square root."""

    def reciprocal_root(self, square: N, least: float, /) -> N:
        """Return 1 / sqrt(square); 0 where the square is `least` or smaller."""

    def reach_root(self, square: N, /) -> N:
        """
        Return the root of a leg's squared sine (unit 1); 0 from -`REACH_TOLERANCE` to 0.

        Below, the leg does not reach the pose: floats raise UnreachableError, arrays give NaN.
        """

    def mode_reciprocal(self, b: N, /) -> N:
        """Return 1 / B_kk; within `MODE_BOUNDARY` of 0, SingularityError or NaN in arrays."""


class _Floats:
    """Backend of plain floats."""

    __slots__ = ()

    sin = staticmethod(math.sin)
    cos = staticmethod(math.cos)
    atan2 = staticmethod(math.atan2)
    remainder = staticmethod(math.remainder)
    sqrt = staticmethod(math.sqrt)

    @staticmethod
    def half_turn(y: float, x: float) -> tuple[float, float]:
        half = 0.5 * math.atan2(y, x)
        return math.cos(half), math.sin(half)

    @staticmethod
    def reciprocal_root(square: float, least: float) -> float:
        return 1.0 / math.sqrt(square) if square > least else 0.0

    @staticmethod
    def reach_root(square: float) -> float:
        if square < -REACH_TOLERANCE:
            raise UnreachableError(
                'no configuration reaches the pose: the squared sine of a leg is '
                f'{square:.6g}, expected 0 or more'
            )
        return math.sqrt(square) if square > 0.0 else 0.0

    @staticmethod
    def mode_reciprocal(b: float) -> float:
        if -MODE_BOUNDARY < b < MODE_BOUNDARY:
            raise SingularityError(
                f'a leg is on the boundary of its working mode: B_kk = {b:.3g}, expected '
                f'{MODE_BOUNDARY:g} or more in size'
            )
        return 1.0 / b


class _Arrays:
    """Backend of arrays."""

    __slots__ = ()

    # To a type checker, ufuncs do not take a Batch.
    sin: Any = staticmethod(np.sin)
    cos: Any = staticmethod(np.cos)
    atan2: Any = staticmethod(np.arctan2)
    sqrt: Any = staticmethod(np.sqrt)

    @staticmethod
    def remainder(angle: Batch, turn: float) -> Batch:
        return angle - turn * np.rint(angle / turn)

    @staticmethod
    def half_turn(y: Batch, x: Batch) -> tuple[Array, Array]:
        # Roots cost a tenth of the angle, its sine and its cosine. The larger of the two is a
        # root, the smaller a quotient, so that neither cancels. The point 0 has the angle 0.
        radius = np.sqrt(x * x + y * y)
        if np.any(radius == 0.0):
            x = np.where(radius == 0.0, 1.0, x)
            radius = np.where(radius == 0.0, 1.0, radius)
        larger = np.sqrt(0.5 + 0.5 * np.abs(x) / radius)
        smaller = 0.5 * np.abs(y) / (radius * larger)
        ahead = x >= 0.0
        return np.where(ahead, larger, smaller), np.copysign(np.where(ahead, smaller, larger), y)

    @staticmethod
    def reciprocal_root(square: Batch, least: float) -> Array:
        positive = square > least
        return np.where(positive, 1.0 / np.sqrt(np.where(positive, square, 1.0)), 0.0)

    @staticmethod
    def reach_root(square: Batch) -> Array:
        return np.sqrt(np.where(square < -REACH_TOLERANCE, np.nan, np.maximum(square, 0.0)))

    @staticmethod
    def mode_reciprocal(b: Batch) -> Array:
        return 1.0 / np.where(np.abs(b) < MODE_BOUNDARY, np.nan, b)


# Backend of the 1 kHz path: raises out of reach and at the boundary of a working mode.
FLOATS: Final[Backend[float]] = _Floats()
# Backend of batches: gives NaN there, row by row.
ARRAYS: Final[Backend[Batch]] = _Arrays()
