# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a recording has of insertion and gripper: the share of their readings, and the gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.encoders.single_axis import MISSING_PERIODS


@dataclass(frozen=True, slots=True)
class AxisRecord:
    """
    The readings of one axis in a recording.

    Attributes
    ----------
    name : str
        Name of the axis, `insertion` or `gripper`.
    seconds : ndarray, shape (n,)
        Times of its readings since the first sample of the joints, s.
    length : float
        Time from the first sample of the joints to the last one, s.
    period : float
        Time between two samples of the joints, s.

    """

    name: str
    seconds: NDArray[np.float64]
    length: float
    period: float


def axis_line(axis: AxisRecord) -> str:
    """
    Return the share of an axis's readings, and its gaps, in one line.

    A gap is longer than three of its own periods, after which its topic is silent. That period is
    the mean one without the gaps: the gripper is published less often than it is read.

    Parameters
    ----------
    axis : AxisRecord
        Readings of the axis.

    Returns
    -------
    str
        The line; `no reading` where there is none.

    """
    count = len(axis.seconds)
    if not count:
        return f'{axis.name}: no reading'
    # A reading is missing at the begin and at the end of the recording as well.
    times = np.concatenate([[0.0], axis.seconds, [max(axis.length, axis.seconds[-1])]])
    between = np.diff(times)
    period = _period(axis)
    expected = max(count, int(axis.length / period) + 1)
    gaps = np.flatnonzero(between > MISSING_PERIODS * period)
    share = f'{axis.name}: {100.0 * count / expected:.2f} % of {expected} readings'
    if not gaps.size:
        return f'{share}, no gap'
    longest = int(np.argmax(between))
    noun = 'gap' if gaps.size == 1 else 'gaps'
    return (
        f'{share}, {gaps.size} {noun} of more than {MISSING_PERIODS:g} periods, the longest '
        f'{between[longest]:.3f} s at {times[longest]:.3f} s'
    )


def _period(axis: AxisRecord) -> float:
    """Return the time between two readings without a gap, s."""
    between = np.diff(axis.seconds)
    if not between.size:
        return axis.period
    return float(between[between <= MISSING_PERIODS * np.median(between)].mean())
