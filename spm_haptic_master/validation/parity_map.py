# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a recording says about its sensors: parity by region, and noise and nominal bias from it.

The parity is the one combination of the four angles that no motion changes: n . e in deg, with the
unit vector n in the null space of the Jacobian's transpose and e the errors of the four angles.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master import kinematics
from spm_haptic_master.kinematics.number_backends import Array

# Edges of the regions: tilt from the centre of the workspace, and self-rotation phi (deg).
TILT_EDGES = (0.0, 7.0, 14.0, 21.0, 90.0)
PHI_STEP = 15.0
# Least number of samples of a region whose mean parity counts (samples): the noise of 0.04 deg in
# the mean is then below 0.003 deg.
REGION_SAMPLES = 200
# Largest third difference over the median one that is noise and not an event.
OUTLIER = 8.0
# Largest distance of consecutive samples over the median one: a longer one is a gap.
GAP = 1.5


class RegionRow(NamedTuple):
    """
    Parity of the samples of one region of the workspace.

    Attributes
    ----------
    tilt_from_deg : float
        Smallest tilt from the centre of the workspace, deg.
    tilt_to_deg : float
        Largest tilt, deg.
    phi_from_deg : float
        Smallest self-rotation phi, deg.
    phi_to_deg : float
        Largest self-rotation, deg.
    samples : int
        Number of samples.
    published : float
        Share of them whose orientation is published (unit 1).
    mean_deg : float
        Mean parity, deg.
    rms_deg : float
        Root mean square of the parity, deg.
    level_deg : float
        Median protection level, deg; NaN where nothing is published.

    """

    tilt_from_deg: float
    tilt_to_deg: float
    phi_from_deg: float
    phi_to_deg: float
    samples: int
    published: float
    mean_deg: float
    rms_deg: float
    level_deg: float


@dataclass(frozen=True, slots=True)
class ParityMap:
    """
    Parity of n samples, and where the platform was; NaN where they have no orientation.

    Attributes
    ----------
    parity_deg : ndarray, shape (n,)
        Parity, deg.
    tilt_deg : ndarray, shape (n,)
        Tilt from the centre of the workspace, deg.
    phi_deg : ndarray, shape (n,)
        Self-rotation phi, deg.

    """

    parity_deg: Array
    tilt_deg: Array
    phi_deg: Array


def parity_map(
    angles: Array,
    sigma: tuple[float, ...],
    geometry: kinematics.Geometry,
    working_mode: tuple[int, int, int],
) -> ParityMap:
    """
    Return the parity of samples in deg, and where the platform was.

    The estimate gives the parity in standard deviations; that of n . e is sqrt(sum n_i^2
    sigma_i^2), with the null vector n of the Jacobian's transpose by singular value decomposition.

    Parameters
    ----------
    angles : ndarray, shape (n, N)
        Joint angles, rad; the first four of each sample are used.
    sigma : tuple of float
        Standard deviations of the N sensors, rad.
    geometry : Geometry
        Link angles and axes of the mechanism.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.

    Returns
    -------
    ParityMap
        Parity, tilt and self-rotation of each sample.

    """
    n = len(angles)
    angles = angles[:, :4]
    sigma = sigma[:4]
    parity = np.full(n, np.nan)
    tilt = np.full(n, np.nan)
    phi = np.full(n, np.nan)
    is_whole = np.isfinite(angles).all(axis=1)
    finite = np.flatnonzero(is_whole)
    found = kinematics.estimate(
        angles[finite, :3],
        angles[finite, 3],
        sigma,
        geometry,
    )
    known = np.isfinite(found.parity)
    rows = finite[known]
    rotation = found.rotation[known]
    matrices = kinematics.jacobian(rotation, geometry, working_mode, sensors=4)
    usable = np.isfinite(matrices).all(axis=(1, 2))
    rows = rows[usable]
    rotation = rotation[usable]
    # The null vector of the Jacobian's transpose: the last left singular vector.
    left, _, _ = np.linalg.svd(matrices[usable])
    normal = left[:, :, 3]
    variances = normal**2 * np.square(sigma)
    deviation = np.sqrt(variances.sum(axis=1))
    in_deviations = found.parity[known][usable]
    parity[rows] = np.degrees(in_deviations * deviation)
    tilt_rad, turn_rad = tilt_and_turn(rotation)
    tilt[rows] = np.degrees(tilt_rad)
    phi[rows] = np.degrees(turn_rad)
    return ParityMap(
        parity_deg=parity,
        tilt_deg=tilt,
        phi_deg=phi,
    )


def tilt_and_turn(rotation: Array) -> tuple[Array, Array]:
    """
    Return how far orientations are tilted and turned.

    Parameters
    ----------
    rotation : ndarray, shape (n, 3, 3)
        R_base_platform.

    Returns
    -------
    tilt : ndarray, shape (n,)
        Tilt from the centre of the workspace, rad.
    turn : ndarray, shape (n,)
        Self-rotation phi (ZXZ), rad.

    """
    axis = kinematics.workspace_pose(0.0, 0.0, 0.0)[:, 2]
    cosine = rotation[:, :, 2] @ axis
    tilt = np.arccos(np.clip(cosine, -1.0, 1.0))
    _, _, turn = kinematics.zxz_from_matrix(rotation)
    return tilt, turn


def regions(
    found: ParityMap,
    published: NDArray[np.bool_],
    level_deg: Array,
) -> list[RegionRow]:
    """
    Return the regions that have samples, by tilt and self-rotation.

    Parameters
    ----------
    found : ParityMap
        Parity of n samples, and where the platform was.
    published : ndarray of bool, shape (n,)
        Whether the orientation of each is published.
    level_deg : ndarray, shape (n,)
        Protection level of each, deg.

    Returns
    -------
    list of RegionRow
        Rows of regions.csv.

    """
    known = np.isfinite(found.parity_deg)
    phi = np.floor(found.phi_deg / PHI_STEP)
    table = []
    for low, high in pairwise(TILT_EDGES):
        above = found.tilt_deg >= low
        below = found.tilt_deg < high
        ring = known & above & below
        for step in np.unique(phi[ring]):
            inside = ring & (phi == step)
            parity = found.parity_deg[inside]
            squares = parity**2
            of_published = level_deg[inside & published]
            table.append(
                RegionRow(
                    tilt_from_deg=low,
                    tilt_to_deg=high,
                    phi_from_deg=float(step * PHI_STEP),
                    phi_to_deg=float((step + 1.0) * PHI_STEP),
                    samples=int(inside.sum()),
                    published=float(published[inside].mean()),
                    mean_deg=float(parity.mean()),
                    rms_deg=float(np.sqrt(np.mean(squares))),
                    level_deg=_median(of_published),
                )
            )
    return table


def _median(values: Array) -> float:
    """Return the median; NaN where there are no values."""
    if len(values):
        return float(np.median(values))
    return float('nan')


def white_noise(
    stamps: NDArray[np.int64],
    angles: Array,
) -> Array:
    """
    Return the white noise of each sensor, as a standard deviation.

    From third divided differences of four readings at their own times, which a motion of the
    device hardly changes (Newton): times need not be equally spaced.

    Parameters
    ----------
    stamps : ndarray of int, shape (n,)
        Increasing times, ns.
    angles : ndarray, shape (n, N)
        Readings without jumps by a turn, rad.

    Returns
    -------
    ndarray, shape (N,)
        Noise of a reading, rad; at least the deviation of a rounding to the smallest step. NaN
        where no four readings follow each other without a gap.

    """
    noise = np.full(angles.shape[1], np.nan)
    if len(stamps) < 4:
        return noise
    differences = _third_differences(stamps, angles)
    for sensor, column in enumerate(differences.T):
        is_known = np.isfinite(column)
        size = np.abs(column[is_known])
        if not len(size):
            continue
        typical = 0.0
        if size.any():
            typical = np.median(size[size > 0.0])
        usual = size[size <= OUTLIER * typical]
        squares = usual**2
        spread = np.sqrt(np.mean(squares))
        noise[sensor] = max(spread, _rounding(angles[:, sensor]))
    return noise


def _third_differences(
    stamps: NDArray[np.int64],
    angles: Array,
) -> Array:
    """
    Return third divided differences of four readings that follow each other.

    Each is scaled so that its standard deviation is the noise of one reading.

    Parameters
    ----------
    stamps : ndarray of int, shape (n,)
        Increasing times, ns.
    angles : ndarray, shape (n, N)
        Readings, rad.

    Returns
    -------
    ndarray, shape (m, N)
        rad; none across a gap longer than `GAP` times the median step.

    """
    steps = np.diff(stamps)
    period = np.median(steps)
    without_gap = (steps > 0) & (steps <= GAP * period)
    three_steps = without_gap[:-2] & without_gap[1:-1] & without_gap[2:]
    first = np.flatnonzero(three_steps)
    rows = first[:, None] + np.arange(4)
    # Periods from the first of the four; a reading's weight is 1 / product of its distances.
    since_first = stamps[rows] - stamps[first][:, None]
    times = since_first / period
    distances = times[:, :, None] - times[:, None, :]
    distances = distances + np.eye(4)
    weights = 1.0 / distances.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    differences = np.einsum('mk,mki->mi', weights, angles[rows])
    return np.asarray(differences)


def _rounding(readings: Array) -> float:
    """Return the standard deviation of a rounding to the smallest step of readings, rad."""
    changes = np.abs(np.diff(readings))
    smallest = changes[changes > 0.0].min(initial=np.inf)
    if np.isfinite(smallest):
        return float(smallest / np.sqrt(12.0))
    return 0.0


def nominal_bias(table: list[RegionRow]) -> float | None:
    """
    Return the nominal bias of each sensor that a recording supports.

    The largest mean parity of a region: independent errors of that size in each of the four
    sensors cause a parity of that size, as n is a unit vector.

    Parameters
    ----------
    table : list of RegionRow
        Parity by region.

    Returns
    -------
    float or None
        Bias, deg; None where no region has `REGION_SAMPLES` samples.

    """
    sizes = [abs(region.mean_deg) for region in table if region.samples >= REGION_SAMPLES]
    return max(sizes, default=None)


def write_regions(path: Path, table: list[RegionRow]) -> None:
    """
    Write the regions as CSV, with the names of `RegionRow` as header.

    Parameters
    ----------
    path : Path
        The file to write.
    table : list of RegionRow
        Parity by region.

    """
    with open(
        path,
        'w',
        newline='',
        encoding='utf-8',
    ) as file:
        writer = csv.writer(file)
        writer.writerow(RegionRow._fields)
        writer.writerows(table)
