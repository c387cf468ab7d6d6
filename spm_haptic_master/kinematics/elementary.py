"""
Elementary functions for numbers that are either Python floats or numpy arrays.

Every formula of this package is written once, component by component, on "numbers". A kernel takes
the elementary functions from its last argument: `FLOATS` for the 1 kHz path (plain floats, no numpy
call) or `ARRAYS` for batches (broadcasting arrays).
"""

import math
from types import SimpleNamespace

import numpy as np

from spm_haptic_master.exceptions import UnreachableError

REACH_TOLERANCE = 1e-12
"""How far below zero the square of a sine may fall by rounding at the edge of reach (unit 1)."""


def _float_reach_root(square):
    if square < -REACH_TOLERANCE:
        raise UnreachableError(
            'no configuration reaches the pose: the squared sine of a leg is '
            f'{square:.6g}, expected 0 or more')
    return math.sqrt(square) if square > 0.0 else 0.0


def _array_reach_root(square):
    reachable = np.where(square < -REACH_TOLERANCE, np.nan, np.maximum(square, 0.0))
    return np.sqrt(reachable)


FLOATS = SimpleNamespace(
    sin=math.sin, cos=math.cos, atan2=math.atan2, sqrt=math.sqrt,
    reach_root=_float_reach_root)
"""For plain floats; out of reach raises `UnreachableError`."""

ARRAYS = SimpleNamespace(
    sin=np.sin, cos=np.cos, atan2=np.arctan2, sqrt=np.sqrt,
    reach_root=_array_reach_root)
"""For arrays; out of reach gives NaN, row by row."""
