# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Time offset and frames of a motion capture relative to recorded orientations."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product
import math

import numpy as np
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.kinematics.rotations import matrix_from_vector

# Step at which angular speeds are compared (s).
SPEED_STEP = 0.01
# Window of an angular speed (steps): in 0.15 s, 0.2 deg of noise is less than a hand's slow
# 5 deg/s; the window is short beside a hand's motion.
SPEED_WINDOW = 15
# Least part of the shorter recording that has to lie within the other (unit 1).
OVERLAP = 2.0 / 3.0
# Correlation of the two angular speeds below which they are not of one motion (unit 1).
CORRELATION_LIMIT = 0.9
# Largest angular speed that counts (rad/s): no hand turns a handle faster.
SPEED_LIMIT = 20.0
# Ratio of a capture's length to the recording's from which its times are not in s (unit 1).
MILLISECONDS = 300.0
# Factor above the least misfit up to which misfits are alike: noise alone makes them differ so.
TIE_RATIO = 1.2
# Rounding of a correlation by FFT, over its largest value: ten units in the last place.
FFT_ROUNDING = 2e-15
# Longest gap between samples (s) within which orientations are interpolated.
GAP = 0.1
# Last step of offset (s) and frames (rad) at which they count as found.
STEP_TOLERANCE = 1e-7
# Largest number of steps of the fit of offset and frames.
STEPS = 30
# Common samples below which nothing is fitted.
ROWS_MINIMUM = 10
# Half width of the difference that yields the angular velocity (s).
VELOCITY_HALF_WIDTH = 0.02
# Least length of a motion that shows the rate of a clock (s), and the largest one (unit 1).
RATE_SECONDS = 5.0
RATE_LIMIT = 0.01
# Standard deviations by which a rate differs from 0 that is one.
RATE_DEVIATIONS = 5.0
# Largest number of steps between frame and body.
FRAME_STEPS = 200
# Gain in cosine, per sample, below which no more steps are needed.
FRAME_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Alignment:
    """
    Time offset and constant rotations between a capture and a recording.

    captured = frame recorded body, at recorded_time(capture's time).

    Attributes
    ----------
    offset : float
        Time to add to the capture's times at their beginning, s.
    rate : float
        By how much the capture's clock is slow, s/s.
    begin : float
        First of the capture's times, s.
    correlation : float
        Correlation of the two angular speeds at the coarse offset (unit 1).
    frame : ndarray, shape (3, 3)
        Orientation of the base frame in the capture's frame.
    body : ndarray, shape (3, 3)
        Orientation of the captured body in the platform's frame.
    residual : float
        What is left of the orientations that both have, rad rms.

    """

    offset: float
    rate: float
    begin: float
    correlation: float
    frame: np.ndarray
    body: np.ndarray
    residual: float

    def recorded_time(self, time: np.ndarray) -> np.ndarray:
        """
        Return the times of the recording's clock, s, at times of the capture's.

        Parameters
        ----------
        time : ndarray
            Times by the capture's clock, s.

        Returns
        -------
        ndarray
            The same moments by the recording's clock, s.

        """
        return time + self.offset + self.rate * (time - self.begin)


def between(
    time: np.ndarray,
    quaternions: np.ndarray,
    at: np.ndarray,
) -> np.ndarray:
    """
    Return quaternions at other times, by linear interpolation of their components.

    Between samples the chord is as good as the arc: a hand turns the platform by a degree or two.
    The signs are made continuous first, as q and -q are one orientation.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Times of the recording, s, increasing.
    quaternions : ndarray, shape (n, 4)
        Recorded unit quaternions x, y, z, w.
    at : ndarray, shape (m,)
        Times to interpolate at, s.

    Returns
    -------
    ndarray, shape (m, 4)
        X, y, z, w; not of unit length.

    """
    before = quaternions[:-1]
    after = quaternions[1:]
    cosines = np.sum(after * before, axis=1)
    flips = np.cumsum(cosines < 0.0)
    signs = np.ones(len(quaternions))
    signs[1:][flips % 2 == 1] = -1.0
    continuous = quaternions * signs[:, None]
    columns = []
    for component in continuous.T:
        columns.append(np.interp(at, time, component))
    return np.stack(columns, axis=1)


def interpolate(
    time: np.ndarray,
    quaternions: np.ndarray,
    at: np.ndarray,
) -> np.ndarray:
    """
    Return unit quaternions at other times.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Times of the recording, s, increasing.
    quaternions : ndarray, shape (n, 4)
        Recorded unit quaternions x, y, z, w.
    at : ndarray, shape (m,)
        Times to interpolate at, s.

    Returns
    -------
    ndarray, shape (m, 4)
        X, y, z, w; NaN in gaps longer than `GAP`, and outside the recording.

    """
    next_row = np.searchsorted(time, at)
    place = np.clip(next_row, 1, len(time) - 1)
    gaps = time[place] - time[place - 1]
    known = gaps <= GAP
    known &= at >= time[0]
    known &= at <= time[-1]
    found = between(time, quaternions, at)
    size = np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(known[:, None], found / size, np.nan)


def angular_speed(
    time: np.ndarray,
    quaternions: np.ndarray,
) -> tuple[float, np.ndarray]:
    """
    Return the smoothed angular speed of a recording on a grid of `SPEED_STEP`.

    It is the turn between two means over `SPEED_WINDOW` steps, one window apart, so that it is
    late by a constant; at most `SPEED_LIMIT`.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Times of the recording, s, increasing.
    quaternions : ndarray, shape (n, 4)
        Recorded unit quaternions x, y, z, w.

    Returns
    -------
    begin : float
        Time of the first value, s; the others follow at `SPEED_STEP`.
    speed : ndarray
        Angular speeds, rad/s.

    Raises
    ------
    InputError
        The recording is too short.

    """
    first = math.ceil(time[0] / SPEED_STEP)
    last = math.floor(time[-1] / SPEED_STEP)
    grid = np.arange(first, last + 1) * SPEED_STEP
    if len(grid) < 4 * SPEED_WINDOW:
        raise InputError(
            f'{time[-1] - time[0]:.2f} s are too short to be aligned; expected '
            f'{4 * SPEED_WINDOW * SPEED_STEP:g} s or more'
        )
    mean = np.full(SPEED_WINDOW, 1.0 / SPEED_WINDOW)
    columns = []
    for component in between(time, quaternions, grid).T:
        columns.append(np.convolve(component, mean, 'valid'))
    smooth = np.stack(columns, axis=1)
    difference = smooth[SPEED_WINDOW:] - smooth[:-SPEED_WINDOW]
    chord = np.linalg.norm(difference, axis=1)
    sine = np.minimum(0.5 * chord, 1.0)
    turn = 4.0 * np.arcsin(sine)
    speed = turn / (SPEED_WINDOW * SPEED_STEP)
    return grid[0], np.minimum(speed, SPEED_LIMIT)


def coarse_offset(
    recorded: tuple[float, np.ndarray],
    captured: tuple[float, np.ndarray],
) -> tuple[float, float]:
    """
    Return the shift at which two angular speeds agree best.

    Least squares over all shifts with an overlap of `OVERLAP`, by correlations with FFT. Among
    equally good ones, that with the longest overlap is taken: a motion that repeats itself fits at
    every period.

    Parameters
    ----------
    recorded : tuple of float and ndarray
        First time, s, and angular speeds, rad/s, of `angular_speed`.
    captured : tuple of float and ndarray
        The same of the capture.

    Returns
    -------
    offset : float
        Time to add to the captured times, s.
    correlation : float
        Correlation of the two speeds there (unit 1).

    Raises
    ------
    InputError
        The motions are not alike: the correlation is below `CORRELATION_LIMIT`.

    """
    recorded_begin, recorded_speed = recorded
    captured_begin, captured_speed = captured
    sums = _SlidingSums(recorded_speed, captured_speed)
    misfit = sums.misfit()
    # A motion that repeats itself fits at every period: take the one with the longest overlap.
    alike = np.flatnonzero(misfit <= TIE_RATIO * misfit.min())
    longest = np.argmax(sums.number[alike])
    most = alike[longest]
    begin = max(most - SPEED_WINDOW, 0)
    near = misfit[begin : most + SPEED_WINDOW]
    best = begin + int(np.argmin(near))
    correlation = sums.correlation(best)
    if not correlation >= CORRELATION_LIMIT:
        raise InputError(
            'recording and motion capture do not move alike: the best correlation of '
            f'their angular speeds is {correlation:.2f}, expected '
            f'{CORRELATION_LIMIT:g} or more'
        )
    steps = best - (len(captured_speed) - 1)
    shift = steps * SPEED_STEP
    return float(recorded_begin + shift - captured_begin), correlation


class _SlidingSums:
    """
    Sums of products of two series over their common samples, for all shifts of the second.

    Parameters
    ----------
    a : ndarray, shape (n,)
        First series.
    b : ndarray, shape (m,)
        Second series; index i of a sum is a shift of i - (m - 1).

    """

    def __init__(self, a: np.ndarray, b: np.ndarray):
        self._count = len(a) + len(b) - 1
        self._size = 1 << self._count.bit_length()
        ones_a = np.ones(len(a))
        ones_b = np.ones(len(b))
        exact = self._slide(ones_a, ones_b)
        shorter = min(len(a), len(b))
        self._enough = exact >= OVERLAP * shorter
        self.number = np.maximum(np.round(exact), 1.0)
        self._sum_a = self._slide(a, ones_b)
        self._sum_b = self._slide(ones_a, b)
        self._square_a = self._slide(a * a, ones_b)
        self._square_b = self._slide(ones_a, b * b)
        self._mixed = self._slide(a, b)

    def _slide(self, p: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return the sums of p[i + shift] q[i] for shift = -(m - 1) .. n - 1."""
        of_p = np.fft.rfft(p, self._size)
        of_q = np.fft.rfft(q[::-1], self._size)
        sums = np.fft.irfft(of_p * of_q, self._size)
        return sums[: self._count]

    def misfit(self) -> np.ndarray:
        """Return the mean of (a - b)^2 for each shift; inf where the overlap is too short."""
        squares = self._square_a + self._square_b
        # Rounding leaves equal motions a misfit of a few units in the last place, of either sign.
        largest = self._square_a.max() + self._square_b.max()
        rounding = FFT_ROUNDING * largest / self.number
        mean = (squares - 2.0 * self._mixed) / self.number
        return np.where(self._enough, np.maximum(mean, rounding), np.inf)

    def correlation(self, at: int) -> float:
        """Return the correlation of both series at an index (unit 1); 0 for a constant one."""
        number = self.number[at]
        sum_a = self._sum_a[at]
        sum_b = self._sum_b[at]
        spread_a = self._square_a[at] - sum_a**2 / number
        spread_b = self._square_b[at] - sum_b**2 / number
        spread = spread_a * spread_b
        if not spread > 0.0:
            return 0.0
        covariance = self._mixed[at] - sum_a * sum_b / number
        return float(covariance / math.sqrt(spread))


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """
    Return the rotations Q with the largest trace(Q^T M).

    Wahba's problem, by Kabsch's solution with a singular value decomposition.

    Parameters
    ----------
    matrix : ndarray
        Matrices M, shape (..., 3, 3).

    Returns
    -------
    ndarray
        Rotations, shape (..., 3, 3).

    """
    left, _, right = np.linalg.svd(matrix)
    signs = np.linalg.det(left) * np.linalg.det(right)
    left[..., 2] *= signs[..., None]
    rotations: np.ndarray = left @ right
    return rotations


def constant_frames(
    captured: np.ndarray,
    recorded: np.ndarray,
    body_known: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return X and, approximately, Y of captured = X recorded Y, by least squares.

    X and Y are improved in turn (each is Wahba's problem) from 24 starts, the rotations that map
    axes to axes: one of them is near every solution. The sums of products contain all of the data.

    Parameters
    ----------
    captured : ndarray, shape (n, 3, 3)
        Orientations of the captured body in the capture's frame.
    recorded : ndarray, shape (n, 3, 3)
        Orientations R_base_platform at the same times.
    body_known : bool
        Whether the captured body is the platform: Y is the unit matrix.

    Returns
    -------
    frame : ndarray, shape (3, 3)
        X, the orientation of the base frame in the capture's frame.
    body : ndarray, shape (3, 3)
        Y, the orientation of the captured body in the platform's frame.

    """
    # These sums contain all of the data: the fit costs the same for any n.
    products = np.einsum('nab,ncd->abcd', captured, recorded)
    if body_known:
        frame = nearest_rotation(np.einsum('abcb->ac', products))
        return frame, np.eye(3)
    # One of the 24 rotations that map axes to axes is near every solution.
    turns = []
    for columns in permutations(range(3)):
        axes = np.eye(3)[list(columns)].T
        for signs in product((1.0, -1.0), repeat=3):
            turns.append(axes * signs)
    every = np.array(turns)
    body = every[np.linalg.det(every) > 0.0]
    frame = body.copy()
    fit = np.full(len(body), -math.inf)
    going = np.arange(len(body))
    for _ in range(FRAME_STEPS):
        across = np.einsum('abcd,kdb->kac', products, body[going])
        frame[going] = nearest_rotation(across)
        along = np.einsum('abcd,kac->kdb', products, frame[going])
        body[going] = nearest_rotation(along)
        before = fit[going]
        products_of_bodies = along * body[going]
        fit[going] = np.sum(products_of_bodies, axis=(1, 2))
        gain = fit[going] - before
        is_gaining = gain > FRAME_TOLERANCE * len(captured)
        going = going[is_gaining]
    best = fit.argmax()
    return frame[best], body[best]


def rotation_vectors(matrices: np.ndarray) -> np.ndarray:
    """
    Return the rotation vectors of rotations well below half a turn.

    The direction is that of the antisymmetric part; the angle is arctan2 of sine and cosine.

    Parameters
    ----------
    matrices : ndarray
        Rotations, shape (..., 3, 3).

    Returns
    -------
    ndarray
        Rotation vectors, shape (..., 3), rad.

    """
    across_x = matrices[..., 2, 1] - matrices[..., 1, 2]
    across_y = matrices[..., 0, 2] - matrices[..., 2, 0]
    across_z = matrices[..., 1, 0] - matrices[..., 0, 1]
    sine = 0.5 * np.stack([across_x, across_y, across_z], axis=-1)
    size = np.linalg.norm(sine, axis=-1, keepdims=True)
    trace = np.trace(matrices, axis1=-2, axis2=-1)
    cosine = 0.5 * (trace[..., None] - 1.0)
    angle = np.arctan2(size, cosine)
    ratio = angle / np.maximum(size, 1e-300)
    factor = np.where(size > 0.0, ratio, 1.0)
    return sine * factor


def align(
    recorded_time: np.ndarray,
    recorded: np.ndarray,
    captured_time: np.ndarray,
    captured: np.ndarray,
    body_known: bool,
) -> Alignment:
    """
    Return the time offset and the constant rotations between a recording and a capture.

    First the offset from the angular speeds, which no constant rotation changes; then offset and
    frames together from the orientations, by Gauss-Newton; then the rate of the clocks, if it
    differs from 0 by `RATE_DEVIATIONS` standard deviations.

    Parameters
    ----------
    recorded_time : ndarray, shape (n,)
        Times by the recording's clock, s.
    recorded : ndarray, shape (n, 4)
        Unit quaternions x, y, z, w of R_base_platform.
    captured_time : ndarray, shape (m,)
        Times by the capture's clock, s.
    captured : ndarray, shape (m, 4)
        Unit quaternions x, y, z, w in the capture's frame.
    body_known : bool
        Whether the captured body is the platform itself.

    Returns
    -------
    Alignment
        Offset, rate and rotations.

    Raises
    ------
    InputError
        The recordings are too short, their motions are not alike, they hardly overlap, or the
        capture was exported wrongly (`_check_export`).

    """
    found = _aligned(recorded_time, recorded, captured_time, captured, body_known)
    _check_export(found, recorded_time, recorded, captured_time, captured, body_known)
    return found


def _aligned(
    recorded_time: np.ndarray,
    recorded: np.ndarray,
    captured_time: np.ndarray,
    captured: np.ndarray,
    body_known: bool,
) -> Alignment:
    """Return the alignment of the two as they are; arguments and errors as of `align`."""
    # Measured from the first sample, times in floats resolve far less than a microsecond.
    begin = recorded_time[0]
    captured_begin = captured_time[0]
    recorded_time = recorded_time - begin
    captured_time = captured_time - captured_begin
    _check_unit(recorded_time, captured_time)
    recorded_speed = angular_speed(recorded_time, recorded)
    captured_speed = angular_speed(captured_time, captured)
    offset, correlation = coarse_offset(recorded_speed, captured_speed)
    pair = _Pair(
        recorded_time=recorded_time,
        recorded=recorded,
        captured_time=captured_time,
        captured=matrix_from_quaternion(captured),
    )
    start = _start(pair, offset, body_known)
    found, _ = _refined(pair, start, body_known, with_rate=False)
    if captured_time[-1] > RATE_SECONDS:
        other, deviation = _refined(pair, found, body_known, with_rate=True)
        if abs(other.rate) > RATE_DEVIATIONS * deviation:
            found = other
    return Alignment(
        offset=found.offset + float(begin - captured_begin),
        rate=found.rate,
        begin=float(captured_begin),
        correlation=correlation,
        frame=found.frame,
        body=found.body,
        residual=found.residual,
    )


@dataclass(frozen=True, slots=True)
class _Pair:
    """
    A recording and a capture, each by its own times from its first sample on.

    Attributes
    ----------
    recorded_time : ndarray, shape (n,)
        Times from the recording's first sample, s.
    recorded : ndarray, shape (n, 4)
        Unit quaternions.
    captured_time : ndarray, shape (m,)
        Times from the capture's first sample, s.
    captured : ndarray, shape (m, 3, 3)
        Orientations.

    """

    recorded_time: np.ndarray
    recorded: np.ndarray
    captured_time: np.ndarray
    captured: np.ndarray

    def recorded_at(self, at: np.ndarray) -> np.ndarray:
        """Return the recorded quaternions at times, s, as `interpolate` has them."""
        return interpolate(self.recorded_time, self.recorded, at)


@dataclass(frozen=True, slots=True)
class _Fit:
    """
    State of the fit of a pair.

    Attributes
    ----------
    offset : float
        Time to add to the capture's times at their beginning, s.
    frame : ndarray, shape (3, 3)
        Orientation of the base frame in the capture's frame.
    body : ndarray, shape (3, 3)
        Orientation of the captured body in the platform's frame.
    rate : float
        By how much the capture's clock is slow, s/s.
    residual : float
        What is left of the orientations, rad rms.

    """

    offset: float
    frame: np.ndarray
    body: np.ndarray
    rate: float = 0.0
    residual: float = math.inf

    def changed(
        self,
        step: np.ndarray,
        body_known: bool,
        with_rate: bool,
        residual: float,
    ) -> _Fit:
        """
        Return the fit after a step of Gauss-Newton.

        Parameters
        ----------
        step : ndarray
            Changes of the offset, s, the frame, rad, and those of rate and body that are fitted.
        body_known : bool
            Whether the body stays as it is.
        with_rate : bool
            Whether the rate is fitted; it is 0 otherwise.
        residual : float
            What is left of the orientations before the step, rad rms.

        Returns
        -------
        _Fit
            With a rate within `RATE_LIMIT`.

        """
        rate = 0.0
        if with_rate:
            changed_rate = self.rate + step[4]
            rate = float(np.clip(changed_rate, -RATE_LIMIT, RATE_LIMIT))
        body = self.body
        if not body_known:
            of_body = matrix_from_vector(step[None, -3:])
            body = of_body[0] @ body
        of_frame = matrix_from_vector(step[None, 1:4])
        return _Fit(
            offset=float(self.offset + step[0]),
            frame=self.frame @ of_frame[0],
            body=body,
            rate=rate,
            residual=residual,
        )


def _start(
    pair: _Pair,
    offset: float,
    body_known: bool,
) -> _Fit:
    """
    Return the fit with which Gauss-Newton begins.

    Parameters
    ----------
    pair : _Pair
        Recording and capture.
    offset : float
        Time to add to the capture's times, s.
    body_known : bool
        Whether the captured body is the platform.

    Returns
    -------
    _Fit
        Frames by `constant_frames` at this offset.

    Raises
    ------
    InputError
        Fewer than `ROWS_MINIMUM` samples are common to both.

    """
    at = pair.captured_time + offset
    quaternions = pair.recorded_at(at)
    known = np.isfinite(quaternions).all(axis=1)
    if known.sum() < ROWS_MINIMUM:
        raise InputError('recording and motion capture hardly overlap')
    here = matrix_from_quaternion(quaternions[known])
    frame, body = constant_frames(pair.captured[known], here, body_known)
    return _Fit(
        offset=offset,
        frame=frame,
        body=body,
    )


def _refined(
    pair: _Pair,
    start: _Fit,
    body_known: bool,
    with_rate: bool,
) -> tuple[_Fit, float]:
    """
    Refine offset, rate and frames together by Gauss-Newton.

    The least-squares step of smallest length is taken: a motion about one axis does not separate
    frame and body.

    Parameters
    ----------
    pair : _Pair
        Recording and capture.
    start : _Fit
        Fit to begin with.
    body_known : bool
        Whether the captured body is the platform.
    with_rate : bool
        Whether the rate of the clocks is fitted.

    Returns
    -------
    fit : _Fit
        Result.
    deviation : float
        Standard deviation of its rate, s/s; inf where it was not fitted.

    Raises
    ------
    InputError
        Fewer than `ROWS_MINIMUM` samples are common to both.

    """
    now = start
    deviation = math.inf
    for _ in range(STEPS):
        at = pair.captured_time * (1.0 + now.rate) + now.offset
        quaternions = pair.recorded_at(at)
        earlier = pair.recorded_at(at - VELOCITY_HALF_WIDTH)
        later = pair.recorded_at(at + VELOCITY_HALF_WIDTH)
        known = np.isfinite(quaternions + earlier + later).all(axis=-1)
        if known.sum() < ROWS_MINIMUM:
            raise InputError('recording and motion capture hardly overlap')
        here = matrix_from_quaternion(quaternions[known])
        before = matrix_from_quaternion(earlier[known])
        after = matrix_from_quaternion(later[known])
        captured = pair.captured[known]
        # Residual of captured = frame recorded body, as a rotation vector in the base frame.
        expected = now.frame.T @ captured @ now.body.T
        off = rotation_vectors(expected @ here.swapaxes(-1, -2))
        turn = rotation_vectors(after @ before.swapaxes(-1, -2))
        velocity = turn / (2.0 * VELOCITY_HALF_WIDTH)
        changes = _changes(
            velocity=velocity,
            captured_time=pair.captured_time[known],
            recorded=here,
            with_rate=with_rate,
            with_body=not body_known,
        )
        rows = np.concatenate(changes)
        # A motion about one axis does not separate frame and body: the solution is the least
        # rotation of both.
        step, *_ = np.linalg.lstsq(rows, off.ravel(), rcond=None)
        squares = np.sum(off**2, axis=1)
        residual = float(np.sqrt(np.mean(squares)))
        if with_rate:
            # A third of the squared residual is the variance of one component.
            inverse = np.linalg.pinv(rows.T @ rows)
            of_rate = max(inverse[4, 4], 0.0)
            deviation = math.sqrt(of_rate * residual**2 / 3.0)
        now = now.changed(step, body_known, with_rate, residual)
        if np.abs(step).max() < STEP_TOLERANCE:
            break
    return now, deviation


def _changes(
    velocity: np.ndarray,
    captured_time: np.ndarray,
    recorded: np.ndarray,
    with_rate: bool,
    with_body: bool,
) -> np.ndarray:
    """
    Return how the predicted orientations change with what is fitted.

    Parameters
    ----------
    velocity : ndarray, shape (n, 3)
        Angular velocity of the platform, base frame, rad/s.
    captured_time : ndarray, shape (n,)
        Times from the capture's first sample, s.
    recorded : ndarray, shape (n, 3, 3)
        Orientations at these times.
    with_rate : bool
        Whether there is a column of the rate.
    with_body : bool
        Whether there are three columns of the body's rotation.

    Returns
    -------
    ndarray, shape (n, 3, columns)
        Rotation vectors in the base frame by offset (rad/s), frame, rate and body.

    """
    of_frame = np.broadcast_to(np.eye(3), recorded.shape)
    columns = [velocity[..., None], of_frame]
    if with_rate:
        of_rate = velocity * captured_time[:, None]
        columns.append(of_rate[..., None])
    if with_body:
        columns.append(recorded)
    return np.concatenate(columns, axis=-1)


def _check_unit(recorded_time: np.ndarray, captured_time: np.ndarray) -> None:
    """Raise InputError where the times of one are a thousand times as long as the other's, s."""
    ratio = captured_time[-1] / recorded_time[-1]
    if not 1.0 / MILLISECONDS < ratio < MILLISECONDS:
        raise InputError(
            f'the motion capture lasts {captured_time[-1]:.6g} s and the recording '
            f'{recorded_time[-1]:.6g} s; expected times in s, not in ms'
        )


# Residual from which mistakes of an export are tried (rad rms), and the part of it that is left
# where one of them is what happened (unit 1).
SUSPICIOUS = math.radians(1.0)
EXPLAINED = 0.3
# Directions of the platform's axes x and z for a body turned so (unit 1): nearly 1 or -1.
ALONG = 0.9


def _check_export(
    found: Alignment,
    recorded_time: np.ndarray,
    recorded: np.ndarray,
    captured_time: np.ndarray,
    captured: np.ndarray,
    body_known: bool,
) -> None:
    """
    Raise InputError where a mistake of the export explains what an alignment leaves.

    Angular speeds are the same for the inverse, a mirror image and quaternions in another order:
    only the orientations tell them apart. The order w, x, y, z of unit quaternions is, but for two
    constant rotations, the inverse; a mirror image of a body is the body, but for these.

    Parameters
    ----------
    found : Alignment
        Alignment of the two as they are.
    recorded_time : ndarray, shape (n,)
        Times by the recording's clock, s.
    recorded : ndarray, shape (n, 4)
        Unit quaternions x, y, z, w of R_base_platform.
    captured_time : ndarray, shape (m,)
        Times by the capture's clock, s.
    captured : ndarray, shape (m, 4)
        Unit quaternions x, y, z, w in the capture's frame.
    body_known : bool
        Whether the captured body is the platform, by markers on it.

    Raises
    ------
    InputError
        Inverted orientations, or exchanged or mirrored markers, fit far better.

    """
    if found.residual < SUSPICIOUS:
        return
    inverse = captured * [-1.0, -1.0, -1.0, 1.0]
    other = _aligned(
        recorded_time=recorded_time,
        recorded=recorded,
        captured_time=captured_time,
        captured=captured if body_known else inverse,
        body_known=False,
    )
    if other.residual >= EXPLAINED * found.residual:
        return
    if body_known:
        mistake = _marker_mistake(other.body)
    else:
        mistake = (
            'the captured orientations are inverted (of the world in the body), or their '
            'quaternions are in the order w, x, y, z'
        )
    raise InputError(
        f'{mistake}: so they fit the recording to {math.degrees(other.residual):.2f} deg rms, as '
        f'they are to {math.degrees(found.residual):.1f}'
    )


def _marker_mistake(body: np.ndarray) -> str:
    """
    Return which mistake in the markers turns the platform's orientation so.

    Parameters
    ----------
    body : ndarray, shape (3, 3)
        Orientation of the markers in the platform's frame.

    Returns
    -------
    str
        The mistake, in words.

    """
    if body[2, 2] < -ALONG:
        if body[0, 0] > ALONG:
            return 'the markers A and B are exchanged'
        return 'the markers are a mirror image: of left-handed axes'
    angle = math.atan2(body[1, 0], body[0, 0])
    turn = math.degrees(angle)
    return (
        f'the markers C and D are turned by {turn:.0f} deg about Z_E: exchanged, or expected at '
        'other --marker-azimuths'
    )
