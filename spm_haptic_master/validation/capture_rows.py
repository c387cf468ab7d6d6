# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Rows of a motion capture that no rigid body and no hand can give: found before anything is fitted.

A system that loses or exchanges markers still writes rows. One of them turns the whole comparison,
as the times are found from angular speeds.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.validation.recordings import MARKERS, ROWS_MINIMUM, Track

Array = NDArray[np.float64]

# Largest deviation of a distance between two markers from its median, over the largest distance
# (unit 1): 1 mm at 100 mm, five times what a good capture shows.
RIGID = 0.01
# Largest angular speed of a handle in a hand (rad/s), and what noise adds to a turn (rad).
HAND_SPEED = 20.0
TURN_NOISE = 0.05
# Length of a piece whose change of change is far below the usual one: held, or filled in (rows),
# and that part of the median (unit 1).
STRAIGHT_ROWS = 10
STRAIGHT = 0.1


@dataclass(frozen=True, slots=True)
class Sifted:
    """
    A capture without the rows that cannot be.

    Attributes
    ----------
    track : Track
        The rows that are left.
    left_out : Counter of str
        Number of rows, by reason.

    """

    track: Track
    left_out: Counter[str]


def without_values(track: Track) -> Sifted:
    """
    Return a capture with what was left out because it had no value.

    Parameters
    ----------
    track : Track
        The capture as it was read.

    Returns
    -------
    Sifted
        All its rows, with the number of those left out.

    """
    left_out: Counter[str] = Counter()
    if track.left_out:
        left_out['without a value'] = track.left_out
    return Sifted(track, left_out)


def keep(
    sifted: Sifted,
    good: NDArray[np.bool_],
    reason: str,
) -> Sifted:
    """
    Return a capture with the good rows alone; the others are counted by a reason.

    Parameters
    ----------
    sifted : Sifted
        A capture, with what is left out so far.
    good : ndarray of bool, shape (n,)
        Rows to keep.
    reason : str
        Why the others are left out.

    Returns
    -------
    Sifted
        The good rows, and all reasons.

    """
    track = sifted.track
    bad = int((~good).sum())
    left_out = sifted.left_out.copy()
    if bad:
        left_out[reason] += bad
    return Sifted(
        Track(
            time=track.time[good],
            values=track.values[good],
            left_out=track.left_out,
        ),
        left_out,
    )


def sifted_capture(track: Track) -> Sifted:
    """
    Return a capture without rows that were held or filled in, or are of no rigid body.

    Parameters
    ----------
    track : Track
        Markers (12 columns) or quaternions (4), as read from a file.

    Returns
    -------
    Sifted
        The rows that are left. Only markers are checked for being a rigid body.

    """
    found = without_values(track)
    is_moving = ~straight(found.track.values)
    found = keep(found, is_moving, 'held or filled in by the capture')
    if track.values.shape[1] == len(MARKERS):
        good = rigid(found.track.values)
        found = keep(found, good, 'that no rigid body can give')
    return found


def straight(values: Array) -> NDArray[np.bool_]:
    """
    Return which rows are in a piece without the noise of all others.

    Tracking that is lost writes the last row again; a gap that is filled in is a straight line.
    Both have second differences far below the usual ones, for `STRAIGHT_ROWS` rows or more.

    Parameters
    ----------
    values : ndarray, shape (n, columns)
        Rows of the capture.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for a row that was held or filled in.

    """
    found = np.zeros(len(values), dtype=bool)
    if len(values) < 2 * STRAIGHT_ROWS:
        return found
    change = np.diff(values, n=2, axis=0)
    size = np.linalg.norm(change, axis=1)
    small = size < STRAIGHT * np.median(size)
    within = np.concatenate([[False], small, [False]])
    changes = within[1:] != within[:-1]
    ends = np.flatnonzero(changes).reshape(-1, 2)
    for begin, end in ends:
        if end - begin >= STRAIGHT_ROWS:
            # The second difference at i is of the rows i, i + 1 and i + 2.
            found[begin + 1 : end + 1] = True
    return found


def rigid(values: Array) -> NDArray[np.bool_]:
    """
    Return in which rows the markers have the distances of the others.

    Parameters
    ----------
    values : ndarray, shape (n, 12)
        Coordinates of four markers.

    Returns
    -------
    ndarray of bool, shape (n,)
        True if every distance is within `RIGID` of its median.

    """
    points = values.reshape(len(values), -1, 3)
    first, second = np.triu_indices(points.shape[1], 1)
    between = points[:, first] - points[:, second]
    distances = np.linalg.norm(between, axis=2)
    usual = np.median(distances, axis=0)
    deviations = np.abs(distances - usual)
    is_usual = deviations <= RIGID * usual.max()
    return np.asarray(is_usual.all(axis=1))


def continuous(
    time: Array,
    quaternions: Array,
) -> NDArray[np.bool_]:
    """
    Return which orientations follow each other as a hand can turn a body.

    Exchanged markers turn a body at once, and back. The longest piece without such a turn is
    right; others are if they continue it.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Times, s.
    quaternions : ndarray, shape (n, 4)
        Unit quaternions x, y, z, w.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for a row that is right.

    """
    good = np.zeros(len(time), dtype=bool)
    follows = _follows(
        time=time[:-1],
        quaternion=quaternions[:-1],
        later=time[1:],
        after=quaternions[1:],
    )
    breaks = np.flatnonzero(~follows) + 1
    rows = np.arange(len(time))
    pieces = np.split(rows, breaks)
    lengths = [len(piece) for piece in pieces]
    longest = lengths.index(max(lengths))
    good[pieces[longest]] = True
    for others, edge, first in (
        (pieces[longest + 1 :], -1, 0),
        (pieces[:longest][::-1], 0, -1),
    ):
        last = pieces[longest][edge]
        for piece in others:
            near = piece[first]
            if _follows(
                time=time[last],
                quaternion=quaternions[last],
                later=time[near],
                after=quaternions[near],
            ):
                good[piece] = True
                last = piece[edge]
    return good


def without_jumps(
    sifted: Sifted,
    quaternions: Array,
) -> tuple[Sifted, Array]:
    """
    Return a capture and its orientations without those that no hand can give.

    Parameters
    ----------
    sifted : Sifted
        The capture.
    quaternions : ndarray, shape (n, 4)
        Its orientations, x, y, z, w.

    Returns
    -------
    sifted : Sifted
        The rows that are left, with the reasons of the others.
    quaternions : ndarray, shape (m, 4)
        Their orientations.

    Raises
    ------
    InputError
        Fewer than `ROWS_MINIMUM` are left.

    """
    good = continuous(sifted.track.time, quaternions)
    if good.sum() < ROWS_MINIMUM:
        raise InputError(
            f'{int(good.sum())} captured orientations follow each other as a hand turns a body; '
            f'expected {ROWS_MINIMUM} or more'
        )
    return keep(sifted, good, 'that no hand can give'), quaternions[good]


def _follows(
    time: Array | float,
    quaternion: Array,
    later: Array | float,
    after: Array,
) -> NDArray[np.bool_]:
    """
    Return whether a hand can turn a body from one orientation to another meanwhile.

    Parameters
    ----------
    time : ndarray or float
        Earlier times, s.
    quaternion : ndarray
        Orientations at these, x, y, z, w, shape (..., 4).
    later : ndarray or float
        Later times, s.
    after : ndarray
        Orientations at those, shape (..., 4).

    Returns
    -------
    ndarray of bool
        True if the turn is at most `HAND_SPEED` times the time, plus `TURN_NOISE`.

    """
    products = quaternion * after
    cosine = np.abs(np.sum(products, axis=-1))
    turn = 2.0 * np.arccos(np.minimum(cosine, 1.0))
    seconds = np.abs(np.asarray(later) - time)
    return np.asarray(turn <= HAND_SPEED * seconds + TURN_NOISE)
