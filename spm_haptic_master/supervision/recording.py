# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded joint samples through exactly the supervision that fkm runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees, inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import mounting_from
from spm_haptic_master.parameters.setting import complete, SENSORS_SETTING, Values
from spm_haptic_master.supervision.supervisor import make_supervisor

# Samples between two reports of the progress.
PROGRESS_SAMPLES = 1000


@dataclass(frozen=True, slots=True)
class Supervised:
    """
    Result of the supervision of n samples of N sensors.

    Attributes
    ----------
    published : ndarray of bool, shape (n,)
        Whether the orientation is published.
    quaternion : ndarray, shape (n, 4)
        x, y, z, w of R_base_platform, or of R_table_handle with a mounting, continuous in sign;
        NaN where it is withheld.
    covariance : ndarray, shape (n, 3, 3)
        Covariance of the rotation error in the base frame, or in the table's with a mounting,
        rad^2; NaN where it is withheld.
    protection_level : ndarray, shape (n,)
        Protection level, deg; NaN where the orientation is withheld.
    unchecked : ndarray, shape (n, N)
        Time since each sensor was last checked by the others, s; inf before the first time.
    bounds : ndarray, shape (n, N)
        What an undetected fault of each sensor is bounded by, its own part of the protection
        level, deg; inf where nothing bounds it.
    state : list of (int, str)
        Index and text at each change of `state`.
    reasons : Counter of str
        Number of withheld samples by reason.

    """

    published: NDArray[np.bool_]
    quaternion: NDArray[np.float64]
    covariance: NDArray[np.float64]
    protection_level: NDArray[np.float64]
    unchecked: NDArray[np.float64]
    bounds: NDArray[np.float64]
    state: list[tuple[int, str]] = field(default_factory=list)
    reasons: Counter[str] = field(default_factory=Counter)


def supervise(stamps: ArrayLike, angles: ArrayLike, **parameters: Any) -> Supervised:
    """
    Run recorded samples through the supervision, with the parameters and defaults of fkm.

    Parameters
    ----------
    stamps : array_like of int, shape (n,)
        Times of the samples, ns.
    angles : array_like, shape (n, N)
        th1A, th1B, th1C, th3A, of five sensors th3B, of six th3C, rad; NaN of a sensor without a
        reading.
    **parameters
        Parameters of fkm; a double underscore replaces a dot (``geometry__alpha_deg``). Axes may
        have the shape (3, 3) (``geometry__base_axes``). The mounting is applied, as fkm does.
        Those that do not concern the result (``frame_id``) are checked and have no effect.

    Returns
    -------
    Supervised
        What `fkm` publishes for each sample, and the state at each change.

    Raises
    ------
    SettingError
        A parameter that fkm does not have, or a value that it cannot have.
    InputError
        Arrays of another shape or kind.

    """
    times, readings = _checked(stamps, angles)
    sensors = readings.shape[1]
    values = complete(
        FKM_SETTINGS,
        {'sensors': sensors}
        | {name.replace('__', '.'): _plain(value) for name, value in parameters.items()},
    )
    if values['sensors'] != sensors:
        raise SettingError('sensors', values['sensors'], f'{sensors}, as angles have')
    return run(times, readings, values)


def _plain(value: Any) -> Any:
    """Return numbers of numpy as Python's, a matrix as the list of its numbers, row by row."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.ravel().tolist() if value.ndim else value.item()
    if isinstance(value, (list, tuple)):
        plain = [_plain(item) for item in value]
        if all(isinstance(item, list) for item in plain):
            return [number for row in plain for number in row]
        return plain
    return value


def run(
    times: NDArray[np.int64],
    readings: NDArray[np.float64],
    values: Values,
    progress: Callable[[int], None] | None = None,
    most_withheld: float = inf,
) -> Supervised:
    """
    Run recorded samples through the supervision that checked settings describe.

    Parameters
    ----------
    times : ndarray of int, shape (n,)
        Stamps, ns.
    readings : ndarray, shape (n, N)
        Angles of the N sensors, rad; NaN of a sensor without a reading.
    values : mapping
        Checked values of `FKM_SETTINGS` by name.
    progress : callable, optional
        Called with the number of samples done, every `PROGRESS_SAMPLES`.
    most_withheld : float
        The run stops with the next sample that is withheld after so many; the rest is not
        published.

    Returns
    -------
    Supervised
        As of `supervise`.

    Raises
    ------
    SettingError
        Settings contradict each other.

    """
    supervisor = make_supervisor(values)
    mounting = mounting_from(values)
    n, sensors = readings.shape
    result = Supervised(
        published=np.zeros(n, bool),
        quaternion=np.full((n, 4), np.nan),
        covariance=np.full((n, 3, 3), np.nan),
        protection_level=np.full(n, np.nan),
        unchecked=np.full((n, sensors), np.inf),
        bounds=np.full((n, sensors), np.inf),
    )
    announced = None
    samples = zip(times.tolist(), readings.tolist(), strict=True)
    for index, (stamp, row) in enumerate(samples):
        if progress is not None and index % PROGRESS_SAMPLES == 0:
            progress(index)
        verdict = supervisor.take(stamp, tuple(row))
        estimate = verdict.estimate
        if estimate is not None:
            if mounting is not None:
                estimate = mounting.applied(estimate)
            result.published[index] = True
            result.quaternion[index] = estimate.quaternion
            result.covariance[index] = np.reshape(estimate.covariance, (3, 3))
            result.protection_level[index] = degrees(verdict.protection_level)
        elif verdict.cause is not None:
            result.reasons[verdict.cause.words] += 1
            if result.reasons.total() > most_withheld:
                break
        result.unchecked[index] = supervisor.unchecked()
        result.bounds[index] = np.degrees(supervisor.parts)
        if verdict.announced is not announced:
            announced = verdict.announced
            result.state.append((index, announced.text))
    return result


def _checked(stamps: ArrayLike, angles: ArrayLike) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Return stamps (ns) and angles (rad) as arrays; InputError for another shape or kind."""
    try:
        times = np.asarray(stamps)
        readings = np.asarray(angles)
    except (TypeError, ValueError) as error:
        raise InputError(f'stamps and angles: expected arrays of numbers ({error})') from error
    if times.dtype.kind not in 'iu' or times.ndim != 1:
        raise InputError(
            f'stamps of type {times.dtype} and shape {times.shape}: expected '
            'integers (ns) of shape (n,)'
        )
    if readings.dtype.kind not in 'fiu':
        raise InputError(f'angles of type {readings.dtype}: expected real numbers (rad)')
    shapes = [(len(times), sensors) for sensors in SENSORS_SETTING.allowed]
    if readings.shape not in shapes:
        raise InputError(
            f'angles have shape {readings.shape}: expected ({len(times)}, N) with N = 4, 5 or 6'
        )
    return times, readings.astype(float)
