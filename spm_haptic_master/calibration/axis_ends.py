# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zero count, direction, scale and range of insertion or gripper from a motion between its two ends.

The slide or the gripper rests at one end, is moved by hand to the other end, and rests there. Of
the slide both positions are known, so that its counts per metre follow. Of the gripper the
counts per turn are known, so that the angle between both ends is a check of the angles given.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, remainder
from typing import Any

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.parameters.axes import GRIPPER, INSERTION

# Time for which it rests at each end (s), and the share of the way between both ends that it may
# move in that time, or go beyond an end (unit 1).
REST = 0.3
STILL = 0.02
# Fewest readings at each end, and the longest time without a reading (s).
REST_READINGS = 5
LONGEST_GAP = 0.5
# Fewest counts between both ends, and the largest share of these between two readings.
LEAST_COUNTS = 100
LARGEST_STEP = 0.5
# Largest difference between the gripper's angle as measured and as given (unit 1).
ANGLE_TOLERANCE = 0.1
# Largest change of an end's position with which a calibration holds, as a share of the range.
END_TOLERANCE = 0.01


@dataclass(frozen=True, slots=True)
class AxisMotion:
    """
    Readings of one axis from its first end to its second one.

    Attributes
    ----------
    axis : str
        Name of the axis, `insertion` or `gripper`.
    stamps : ndarray of int, shape (n,)
        Times, ns.
    counts : ndarray, shape (n,)
        Readings, each from -ring / 2 to ring / 2.
    ring : int
        Number of counts after which they begin again.

    """

    axis: str
    stamps: NDArray[np.int64]
    counts: NDArray[np.float64]
    ring: int


@dataclass(frozen=True, slots=True)
class AxisCalibration:
    """
    What the driver has to know of one axis.

    position = direction (counts - zero_count) / counts_per_unit, in m, or deg for the gripper.

    Attributes
    ----------
    axis : str
        Name of the axis, `insertion` or `gripper`.
    zero_count : int
        Count at position 0.
    direction : int
        1 or -1.
    counts_per_unit : float
        Counts per m or per deg.
    range : tuple of 2 float
        Least and greatest position, m or deg.

    """

    axis: str
    zero_count: int
    direction: int
    counts_per_unit: float
    range: tuple[float, float]

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the driver by name."""
        found: dict[str, Any] = {
            f'{self.axis}.direction': self.direction,
            f'{self.axis}.zero_count': self.zero_count,
        }
        if self.axis == INSERTION:
            found['insertion.counts_per_metre'] = self.counts_per_unit
            found['insertion.range'] = self.range
        else:
            found['gripper.range_deg'] = self.range
        return found


def calibrate_axis(
    motion: AxisMotion,
    ends: tuple[float, float],
) -> AxisCalibration:
    """
    Return the calibration of an axis from a motion between its ends.

    Parameters
    ----------
    motion
        It rests at the first end, moves, and rests at the second.
    ends
        Positions of the first and the second end, m, or deg for the gripper.

    Returns
    -------
    AxisCalibration
        The position of a reading is direction (counts - zero_count) / counts_per_unit.

    Raises
    ------
    CalibrationError
        The motion has no readings, too few at rest, a gap or a jump, does not move, goes beyond
        its ends, or is not that of the positions given.

    """
    first, second = resting_counts(motion)
    counts_between = second - first
    if motion.axis == GRIPPER:
        counts_per_unit = motion.ring / 360.0
        _check_angle(abs(counts_between) / counts_per_unit, ends, motion.ring)
    else:
        counts_per_unit = abs(counts_between) / abs(ends[1] - ends[0])
    direction = _direction(counts_between, ends)
    zero_count = round(second - direction * counts_per_unit * ends[1]) % motion.ring
    # The angle of the gripper between both ends is the measured one, counted from the second.
    position_at_first = ends[1] - direction * counts_between / counts_per_unit
    least, greatest = sorted((position_at_first, ends[1]))
    return AxisCalibration(
        axis=motion.axis,
        zero_count=zero_count,
        direction=direction,
        counts_per_unit=round(counts_per_unit, 6),
        range=(round(least, 6), round(greatest, 6)),
    )


def _direction(counts_between: float, ends: tuple[float, float]) -> int:
    """Return 1 where the counts increase with the position, -1 where they decrease."""
    return int(copysign(1.0, counts_between * (ends[1] - ends[0])))


def resting_counts(motion: AxisMotion) -> tuple[float, float]:
    """
    Return the mean counts at rest at both ends.

    The counts go on beyond a turn: their difference is the way. All checks of `calibrate_axis` are
    made but for those of the positions.

    Parameters
    ----------
    motion : AxisMotion
        It rests at the first end, moves, and rests at the second.

    Returns
    -------
    tuple of 2 float
        Mean over `REST` at the first and at the second end.

    Raises
    ------
    CalibrationError
        There are too few readings at rest, a gap or a jump; it does not move, or goes beyond its
        ends.

    """
    axis = motion.axis
    since_first = motion.stamps - motion.stamps[:1]
    seconds = np.asarray(since_first * 1e-9)
    at_first = seconds <= REST
    at_second = seconds >= seconds[-1:] - REST
    fewest = min(at_first.sum(), at_second.sum())
    if fewest < REST_READINGS or seconds[-1] < 2.0 * REST:
        raise CalibrationError(
            f'{axis}: {len(seconds)} readings; expected at least {REST_READINGS} in {REST:g} s '
            'at rest at each end'
        )
    _check_gaps(axis, seconds)
    counts = np.unwrap(motion.counts, period=motion.ring)
    first = float(counts[at_first].mean())
    second = float(counts[at_second].mean())
    way = abs(second - first)
    if way < LEAST_COUNTS:
        raise CalibrationError(
            f'{axis} did not move: {way:.0f} counts between begin and end of the motion; expected '
            f'at least {LEAST_COUNTS}, from one end to the other'
        )
    for name, resting in (('first', counts[at_first]), ('second', counts[at_second])):
        if np.ptp(resting) > STILL * way:
            raise CalibrationError(
                f'{axis} moved by {np.ptp(resting):.0f} counts at its {name} end; '
                f'expected {REST:g} s at rest'
            )
    _check_way(axis, counts, way)
    return first, second


def _check_gaps(
    axis: str,
    seconds: NDArray[np.float64],
) -> None:
    """Raise CalibrationError where the readings pause for longer than `LONGEST_GAP`."""
    gaps = np.diff(seconds)
    longest = int(np.argmax(gaps))
    if gaps[longest] > LONGEST_GAP:
        raise CalibrationError(
            f'{axis}: no reading for {gaps[longest]:.2f} s, {seconds[longest]:.1f} s after the '
            f'beginning; expected one in {LONGEST_GAP:g} s'
        )


def _check_way(
    axis: str,
    counts: NDArray[np.float64],
    way: float,
) -> None:
    """Raise CalibrationError where the counts jump, or go beyond both ends."""
    step = float(np.abs(np.diff(counts)).max())
    if step > LARGEST_STEP * way:
        raise CalibrationError(
            f'{axis} jumps by {step:.0f} counts between two readings; expected a slow motion, and '
            f'in {axis}.mask all bits of the counts and no others'
        )
    beyond = float(np.ptp(counts)) - way
    if beyond > 2.0 * STILL * way:
        raise CalibrationError(
            f'{axis} went beyond where it rested, by {beyond:.0f} of {way:.0f} counts; expected '
            'the motion from one end to the other'
        )


def _check_angle(
    measured: float,
    ends: tuple[float, float],
    ring: int,
) -> None:
    """Raise CalibrationError for a gripper that turned by another angle, deg, than given."""
    given = abs(ends[1] - ends[0])
    if abs(measured - given) > ANGLE_TOLERANCE * given:
        raise CalibrationError(
            f'gripper turned by {measured:.1f} deg with gripper.counts_per_turn {ring}; expected '
            f'{given:g} deg between the angles given'
        )


def change_since(
    motion: AxisMotion,
    ends: tuple[float, float],
    before: AxisCalibration,
) -> str | None:
    """
    Return what changed since an earlier calibration of an axis.

    An end may be off by `END_TOLERANCE` of the range.

    Parameters
    ----------
    motion : AxisMotion
        It rests at the first end, moves, and rests at the second.
    ends : tuple of 2 float
        Positions of the first and the second end, m, or deg for the gripper.
    before : AxisCalibration
        The earlier calibration.

    Returns
    -------
    str or None
        In words; None where the calibration holds.

    Raises
    ------
    CalibrationError
        As of `resting_counts`.

    """
    first, second = resting_counts(motion)
    if before.direction != _direction(second - first, ends):
        return f'{motion.axis} counts in the opposite direction'
    unit = 'm' if motion.axis == INSERTION else 'deg'
    tolerance = END_TOLERANCE * (before.range[1] - before.range[0])
    at_second = _position(second, before, motion.ring)
    at_first = at_second - before.direction * (second - first) / before.counts_per_unit
    # The first end of a gripper is where it was measured, not where it was said to be.
    if motion.axis == INSERTION:
        first_end = ends[0]
    else:
        first_end = _farthest(before.range, ends[1])
    found = [
        f'its {name} end reads {now:.4g} {unit}, not {expected:.4g}'
        for name, now, expected in (('first', at_first, first_end), ('second', at_second, ends[1]))
        if abs(now - expected) > tolerance
    ]
    return f'{motion.axis}: {"; ".join(found)}' if found else None


def _farthest(
    limits: tuple[float, float],
    position: float,
) -> float:
    """Return the end of a range that is farther from a position."""
    return max(limits, key=lambda end: abs(end - position))


def _position(
    counts: float,
    calibration: AxisCalibration,
    ring: int,
) -> float:
    """Return the position of counts, m or deg, as the driver has it."""
    turned = calibration.direction * (counts - calibration.zero_count)
    return remainder(turned, ring) / calibration.counts_per_unit
