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
# Least part of the shorter recording that has to lie within the other.
OVERLAP = 0.5
# Correlation of the two angular speeds below which they are not of one motion.
CORRELATION_LIMIT = 0.5
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
# Largest number of steps between frame and body.
FRAME_STEPS = 200
# Gain in cosine, per sample, below which no more steps are needed.
FRAME_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Alignment:
    """Time offset and constant rotations between a capture and a recording."""

    offset: float  # time to add to the capture's times, s
    correlation: float  # of the two angular speeds at the coarse offset
    frame: np.ndarray  # orientation of the base frame in the capture's frame, (3, 3)
    body: np.ndarray  # orientation of the captured body in the platform's frame, (3, 3)


def between(time: np.ndarray, quaternions: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return quaternions at other times, s, (m, 4), on chords: arcs of a degree or two."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0
    signs = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2, -1.0, 1.0)])
    return np.stack(
        [np.interp(at, time, each) for each in (quaternions * signs[:, None]).T], axis=1
    )


def interpolate(time: np.ndarray, quaternions: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return unit quaternions at other times, s, (m, 4); NaN in gaps beyond `GAP`, and outside."""
    place = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    known = (at >= time[0]) & (at <= time[-1]) & (time[place] - time[place - 1] <= GAP)
    found = between(time, quaternions, at)
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(known[:, None], found, np.nan)


def angular_speed(time: np.ndarray, quaternions: np.ndarray) -> tuple[float, np.ndarray]:
    """Return a time, s, and, later by a constant, smoothed speeds, rad/s, each `SPEED_STEP`."""
    grid = (
        np.arange(math.ceil(time[0] / SPEED_STEP), math.floor(time[-1] / SPEED_STEP) + 1)
        * SPEED_STEP
    )
    if len(grid) < 4 * SPEED_WINDOW:
        raise InputError(
            f'{time[-1] - time[0]:.2f} s are too short to be aligned; expected '
            f'{4 * SPEED_WINDOW * SPEED_STEP:g} s or more'
        )
    smooth = np.stack(
        [
            np.convolve(each, np.full(SPEED_WINDOW, 1.0 / SPEED_WINDOW), 'valid')
            for each in between(time, quaternions, grid).T
        ],
        axis=1,
    )
    chord = np.linalg.norm(smooth[SPEED_WINDOW:] - smooth[:-SPEED_WINDOW], axis=1)
    speed = 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)) / (SPEED_WINDOW * SPEED_STEP)
    return grid[0], speed


def coarse_offset(
    recorded: tuple[float, np.ndarray], captured: tuple[float, np.ndarray]
) -> tuple[float, float]:
    """
    Return the time to add to the captured times, s, by two results of `angular_speed`.

    And their correlation there. InputError where the motions are not alike.
    """
    (begin_a, a), (begin_b, b) = recorded, captured
    n, m = len(a), len(b)
    size = 1 << (n + m - 1).bit_length()

    def slide(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return the sums of p[i + shift] q[i] for shift = -(m - 1) .. n - 1."""
        sums = np.fft.irfft(np.fft.rfft(p, size) * np.fft.rfft(q[::-1], size), size)
        return sums[: n + m - 1]

    ones_a, ones_b = np.ones(n), np.ones(m)
    number = slide(ones_a, ones_b)
    enough = number >= OVERLAP * min(n, m)
    number = np.maximum(np.round(number), 1.0)
    sum_a, sum_b = slide(a, ones_b), slide(ones_a, b)
    square_a, square_b, mixed = slide(a * a, ones_b), slide(ones_a, b * b), slide(a, b)
    # Rounding leaves equal motions a misfit of a few units in the last place, of either sign.
    rounding = FFT_ROUNDING * (square_a.max() + square_b.max()) / number
    misfit = np.where(
        enough, np.maximum((square_a + square_b - 2.0 * mixed) / number, rounding), np.inf
    )
    # A motion that repeats itself fits at every period: take the one with the longest overlap.
    alike = np.flatnonzero(misfit <= TIE_RATIO * misfit.min())
    most = alike[np.argmax(number[alike])]
    near = slice(max(most - SPEED_WINDOW, 0), most + SPEED_WINDOW)
    best = near.start + int(np.argmin(misfit[near]))
    spread = ((square_a - sum_a**2 / number) * (square_b - sum_b**2 / number))[best]
    covariance = (mixed - sum_a * sum_b / number)[best]
    correlation = covariance / math.sqrt(spread) if spread > 0.0 else 0.0
    if not correlation >= CORRELATION_LIMIT:
        raise InputError(
            'recording and motion capture do not move alike: the best correlation of '
            f'their angular speeds is {correlation:.2f}, expected '
            f'{CORRELATION_LIMIT:g} or more'
        )
    return float(begin_a + (best - (m - 1)) * SPEED_STEP - begin_b), float(correlation)


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """Return the rotations Q with the largest trace(Q^T M): Wahba's problem, Kabsch's solution."""
    left, _, right = np.linalg.svd(matrix)
    left[..., 2] *= (np.linalg.det(left) * np.linalg.det(right))[..., None]
    return left @ right


def constant_frames(
    captured: np.ndarray, recorded: np.ndarray, body_known: bool
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return X and, approximately, Y of captured = X recorded Y, orientations, (n, 3, 3).

    With `body_known` the captured body is the platform: Y is the unit matrix.
    """
    # These sums contain all of the data: the fit costs the same for any n.
    products = np.einsum('nab,ncd->abcd', captured, recorded)
    if body_known:
        return nearest_rotation(np.einsum('abcb->ac', products)), np.eye(3)
    # One of the 24 rotations that map axes to axes is near every solution.
    turns = np.array(
        [
            np.eye(3)[list(columns)].T * signs
            for columns in permutations(range(3))
            for signs in product((1.0, -1.0), repeat=3)
        ]
    )
    body = turns[np.linalg.det(turns) > 0.0]
    frame, fit, going = body.copy(), np.full(len(body), -math.inf), np.arange(len(body))
    for _ in range(FRAME_STEPS):
        frame[going] = nearest_rotation(np.einsum('abcd,kdb->kac', products, body[going]))
        along = np.einsum('abcd,kac->kdb', products, frame[going])
        body[going] = nearest_rotation(along)
        before, fit[going] = fit[going], np.sum(along * body[going], axis=(1, 2))
        going = going[fit[going] - before > FRAME_TOLERANCE * len(captured)]
    best = fit.argmax()
    return frame[best], body[best]


def rotation_vectors(matrices: np.ndarray) -> np.ndarray:
    """Return the rotation vectors, rad, shape (n, 3), of rotations well below half a turn."""
    sine = 0.5 * np.stack(
        [
            matrices[..., 2, 1] - matrices[..., 1, 2],
            matrices[..., 0, 2] - matrices[..., 2, 0],
            matrices[..., 1, 0] - matrices[..., 0, 1],
        ],
        axis=-1,
    )
    size = np.linalg.norm(sine, axis=-1, keepdims=True)
    cosine = 0.5 * (np.trace(matrices, axis1=-2, axis2=-1)[..., None] - 1.0)
    return sine * np.where(size > 0.0, np.arctan2(size, cosine) / np.maximum(size, 1e-300), 1.0)


def align(
    recorded_time: np.ndarray,
    recorded: np.ndarray,
    captured_time: np.ndarray,
    captured: np.ndarray,
    body_known: bool,
) -> Alignment:
    """
    Return the time offset and the constant rotations between a recording and a capture.

    Of unit quaternions at times, s, each by its own clock: first the offset from the angular
    speeds, which no constant rotation changes, then all together from the orientations.
    InputError: too short, not of the same motion, or without overlap.
    """
    # Measured from the first sample, times in floats resolve far less than a microsecond.
    begin, captured_begin = recorded_time[0], captured_time[0]
    recorded_time, captured_time = recorded_time - begin, captured_time - captured_begin
    offset, correlation = coarse_offset(
        angular_speed(recorded_time, recorded), angular_speed(captured_time, captured)
    )
    rotations = matrix_from_quaternion(captured)
    frame = body = np.eye(3)
    for number in range(STEPS):
        at = captured_time + offset
        here, before, after = (
            interpolate(recorded_time, recorded, at + shift)
            for shift in (0.0, -VELOCITY_HALF_WIDTH, VELOCITY_HALF_WIDTH)
        )
        known = np.isfinite(here + before + after).all(axis=-1)
        if known.sum() < ROWS_MINIMUM:
            raise InputError('recording and motion capture hardly overlap')
        here, before, after = (
            matrix_from_quaternion(each[known]) for each in (here, before, after)
        )
        if number == 0:
            frame, body = constant_frames(rotations[known], here, body_known)
        ahead = rotation_vectors(frame.T @ rotations[known] @ body.T @ here.swapaxes(-1, -2))
        velocity = rotation_vectors(after @ before.swapaxes(-1, -2)) / (2.0 * VELOCITY_HALF_WIDTH)
        # Change of an orientation by a later time, a rotated frame and a rotated body.
        columns = [velocity[..., None], np.broadcast_to(np.eye(3), here.shape)]
        if not body_known:
            columns.append(here)
        rows = np.concatenate(columns, axis=-1)
        # A motion about one axis does not separate frame and body: the solution is the least
        # rotation of both.
        step = np.linalg.lstsq(np.concatenate(rows), ahead.ravel(), rcond=None)[0]
        offset += step[0]
        frame = frame @ matrix_from_vector(step[None, 1:4])[0]
        if not body_known:
            body = matrix_from_vector(step[None, 4:])[0] @ body
        if np.abs(step).max() < STEP_TOLERANCE:
            break
    return Alignment(float(offset + (begin - captured_begin)), correlation, frame, body)
