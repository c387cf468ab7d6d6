# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Eq. 5, the quartic of Fig. 4, from the formulas of eqs. 1 to 4 applied to polynomials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.assembly_modes import checked_chain, eliminant, LockedChain
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.kinematics.leg_kernels import into_second_link


def eq5_coefficients(th1: np.ndarray, geometry: Geometry = PAPER_GEOMETRY) -> np.ndarray:
    """
    Return the coefficients of eq. 5: eq. 4 as a quartic in x = cos xi and y = sin xi (Fig. 4).

    xi is measured at A2 from the arc A2B2, xi = th2A - xi' (eq. 13); the print's numbers are those
    of th1 = (90, 90, 90) deg. `th1` (3,) in rad. Entry [i, j] of the matrix (5, 5) is the
    coefficient of x^i y^j; those with i + j > 4 are zero. The solutions are the curve's
    intersections with the circle x^2 + y^2 = 1.
    """
    chain = checked_chain(th1, geometry)
    x, y, _ = chain.seconds[0]
    reference = math.atan2(x, -y)
    c, s = math.cos(reference), math.sin(reference)
    chain = LockedChain(
        chain.th1a, tuple(into_second_link(c, s, axis) for axis in chain.seconds), chain.g
    )
    # L, M, N are affine in x and y: three points give their coefficients.
    origin, along_x, along_y = (
        np.array(chain.turn_equations(*point)) for point in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    )
    affine = np.zeros((2, 3, 2, 2))
    affine[..., 0, 0] = origin
    affine[..., 1, 0] = along_x - origin
    affine[..., 0, 1] = along_y - origin
    first, second = ([_Polynomial(term) for term in equation] for equation in affine)
    # The formula is made of sums and products: it holds for polynomials as for numbers.
    formula: Callable[..., Any] = eliminant
    coefficients: np.ndarray = formula(first, second).coefficients
    return coefficients


@dataclass(frozen=True, slots=True)
class _Polynomial:
    """
    A polynomial in x and y, for the formulas of eqs. 3 and 4.

    Attributes
    ----------
    coefficients : ndarray, shape (k, k)
        Entry [i, j] is the coefficient of x^i y^j.

    """

    coefficients: np.ndarray

    def __add__(self, other: _Polynomial) -> _Polynomial:
        return _Polynomial(self.coefficients + other.coefficients)

    def __sub__(self, other: _Polynomial) -> _Polynomial:
        return _Polynomial(self.coefficients - other.coefficients)

    def __mul__(self, other: _Polynomial) -> _Polynomial:
        p, q = self.coefficients, other.coefficients
        degree = len(p) + len(q) - 1
        product = np.zeros((degree, degree))
        for (i, j), value in np.ndenumerate(p):
            product[i : i + len(q), j : j + len(q)] += value * q
        return _Polynomial(product)
