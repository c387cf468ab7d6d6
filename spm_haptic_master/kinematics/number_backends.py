# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Elementary functions for numbers that are either Python floats or numpy arrays.

Every formula of this package is written once, component by component, on "numbers". A kernel takes
the elementary functions from its last argument: `FLOATS` for the 1 kHz path (plain floats, no numpy
call) or `ARRAYS` for batches (broadcasting arrays).
"""

import math
from types import SimpleNamespace

import numpy as np

from spm_haptic_master.exceptions import SingularityError, UnreachableError

REACH_TOLERANCE = 1e-12
"""How far below zero the square of a sine may fall by rounding at the edge of reach (unit 1)."""

MODE_BOUNDARY = 1e-6
"""
|B_kk| under which a pose counts as on the boundary of its working mode (unit 1).

B_kk is a square root there: rounding of 1e-16 in its square leaves five good digits at this size.
"""


def _float_reach_root(square):
    if square < -REACH_TOLERANCE:
        raise UnreachableError(
            'no configuration reaches the pose: the squared sine of a leg is '
            f'{square:.6g}, expected 0 or more')
    return math.sqrt(square) if square > 0.0 else 0.0


def _array_reach_root(square):
    reachable = np.where(square < -REACH_TOLERANCE, np.nan, np.maximum(square, 0.0))
    return np.sqrt(reachable)


def _float_mode_reciprocal(b):
    if -MODE_BOUNDARY < b < MODE_BOUNDARY:
        raise SingularityError(
            f'a leg is on the boundary of its working mode: B_kk = {b:.3g}, expected '
            f'{MODE_BOUNDARY:g} or more in size')
    return 1.0 / b


def _array_mode_reciprocal(b):
    return 1.0 / np.where(np.abs(b) < MODE_BOUNDARY, np.nan, b)


FLOATS = SimpleNamespace(
    sin=math.sin, cos=math.cos, atan2=math.atan2, sqrt=math.sqrt,
    reach_root=_float_reach_root, mode_reciprocal=_float_mode_reciprocal)
"""For plain floats; out of reach and at a mode's boundary they raise."""

ARRAYS = SimpleNamespace(
    sin=np.sin, cos=np.cos, atan2=np.arctan2, sqrt=np.sqrt,
    reach_root=_array_reach_root, mode_reciprocal=_array_mode_reciprocal)
"""For arrays; out of reach and at a mode's boundary they give NaN, row by row."""
