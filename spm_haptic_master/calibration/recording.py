# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The raw angles that a calibration evaluates: of a log at once, of a source while it happens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from math import inf
import threading
import time

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.encoders.replay_source import ReplaySource
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.exceptions import CalibrationError, SourceEnded, SpmError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.encoders import for_sensors, HARMONIC_SETTINGS

# Stamps, ns, shape (n,), and angles, rad, shape (n, N).
Recording = tuple[NDArray[np.int64], NDArray[np.float64]]

# Longest wait for one set (s), so that a recording ends in time.
READ_TIMEOUT = 0.1
# Time without any set (s) after which the recording gives up and reports why.
PATIENCE = 5.0
# Largest share of the sets in which a joint may lack a reading (unit 1): frames that are lost now
# and then; an encoder that is not there lacks them all.
MISSING_MAXIMUM = 0.2


def _whole_sets(
    samples: Sequence[JointSample],
    share: float = 0.0,
) -> tuple[Recording, str]:
    """
    Return the sets with a reading of every joint, and which joints lack readings.

    Parameters
    ----------
    samples : sequence of JointSample
        Sets of readings, in which a missing one is NaN.
    share : float, optional
        Share of the sets, 0 to 1, in which a reading may be missing without being named.

    Returns
    -------
    recording : Recording
        Stamps and angles of the complete sets.
    lacking : str
        Joints that lack readings more often than that, in words; empty if there is none.

    """
    rows = [sample.angles for sample in samples]
    if rows:
        angles = np.array(rows)
    else:
        angles = np.empty((0, len(ALL_JOINT_NAMES)))
    missing = np.isnan(angles)
    lacking = '; '.join(
        f'{joint} has no reading in {count} of {len(samples)} sets'
        for joint, count in zip(ALL_JOINT_NAMES, missing.sum(axis=0), strict=False)
        if count > share * len(samples)
    )
    stamps = np.array([sample.stamp for sample in samples], dtype=np.int64)
    whole = ~missing.any(axis=1)
    return (stamps[whole], angles[whole]), lacking


def _complete(samples: Sequence[JointSample]) -> tuple[Recording, list[str]]:
    """
    Return the complete sets, and a note on those that are left out.

    Parameters
    ----------
    samples : sequence of JointSample
        Sets of readings, in which a missing one is NaN.

    Returns
    -------
    recording : Recording
        Stamps and angles of the complete sets.
    notes : list of str
        One line on sets that are left out, if there are any.

    Raises
    ------
    CalibrationError
        A joint lacks a reading in more than `MISSING_MAXIMUM` of the sets.

    """
    _, too_often = _whole_sets(samples, MISSING_MAXIMUM)
    if too_often:
        raise CalibrationError(
            f'{too_often}; expected readings of all joints: check the encoder, '
            'or give `sensors` without it'
        )
    recording, lacking = _whole_sets(samples)
    return recording, [f'{lacking}; these are left out'] if lacking else []


def raw_counts(sensors: int) -> dict[str, object]:
    """
    Return the settings of a source whose angles are raw counts times 2 pi per turn.

    Direction 1, zero count 0 and no harmonics: what is not calibrated yet.

    Parameters
    ----------
    sensors : int
        Number N of sensors.

    Returns
    -------
    dict of str to object
        Values by the name of the parameter.

    """
    return {
        'encoders.direction': (1,) * sensors,
        'encoders.zero_count': (0,) * sensors,
        **{
            setting.name: (0.0,) * (setting.count or 1)
            for setting in for_sensors(HARMONIC_SETTINGS, sensors)
        },
    }


def read_log(
    source: ReplaySource,
    progress: Callable[[int], None] = lambda count: None,
    seconds: float = inf,
) -> tuple[Recording, list[str]]:
    """
    Read a log at once.

    Parameters
    ----------
    source : ReplaySource
        The log.
    progress : callable, optional
        Takes the number of sets read so far, after each of them.
    seconds : float, optional
        Length of the part from the first set that is read, s; by default all of it.

    Returns
    -------
    recording : Recording
        Stamps, ns, and angles, rad, of the complete sets.
    notes : list of str
        One line on sets that are left out, if there are any.

    Raises
    ------
    CalibrationError
        A joint lacks a reading in more than `MISSING_MAXIMUM` of the sets.

    """
    samples: list[JointSample] = []
    for sample in source.recorded():
        if samples and sample.stamp - samples[0].stamp > seconds * 1e9:
            break
        samples.append(sample)
        progress(len(samples))
    return _complete(samples)


def record(
    source: EncoderSource,
    seconds: float,
    evaluate: Callable[[Recording, float], bool],
    period: float = 1.0,
    keep: bool = True,
) -> tuple[Recording, list[str]]:
    """
    Record until an evaluation is content, for some seconds from the first set, or until Ctrl-C.

    A thread collects the sets, so that an evaluation costs no sample. The recording also ends if
    no set arrives for `PATIENCE` seconds.

    Parameters
    ----------
    source : EncoderSource
        The source; it is not closed.
    seconds : float
        Longest time from the first set, s.
    evaluate : callable
        Takes the complete sets so far and the time since the first, s; returns whether they are
        enough.
    period : float, optional
        Time between two evaluations, s.
    keep : bool, optional
        Whether the sets before Ctrl-C or before an error of the source are returned. Without it
        Ctrl-C and the error are raised.

    Returns
    -------
    recording : Recording
        Stamps, ns, and angles, rad, of the complete sets.
    notes : list of str
        Which sets are left out, and why the recording ended.

    Raises
    ------
    CalibrationError
        No set arrives, or a joint lacks too many readings.

    """
    samples: list[JointSample] = []
    stop = threading.Event()
    ended = ''
    # In a thread of its own, so that an evaluation costs no sample.
    with ThreadPoolExecutor(1) as pool:
        collecting = pool.submit(_collect, source, seconds, samples, stop)
        try:
            ended = _follow(collecting, source, samples, seconds, evaluate, period)
        except KeyboardInterrupt:
            if not keep:
                raise
        finally:
            stop.set()
    recording, notes = _complete(samples)
    count = len(recording[0])
    error = collecting.exception()
    if error is not None:
        is_fault = isinstance(error, SpmError)
        if not (keep and count and is_fault):
            raise error
        ended = str(error)
    if not count:
        raise CalibrationError(f'no set of readings arrived: {source.fault}')
    if ended:
        notes.append(f'{ended}; what arrived before that is used')
    return recording, notes


def _follow(
    collecting: Future[None],
    source: EncoderSource,
    samples: Sequence[JointSample],
    seconds: float,
    evaluate: Callable[[Recording, float], bool],
    period: float,
) -> str:
    """
    Evaluate the sets while they are collected, until they are enough.

    Parameters
    ----------
    collecting : Future
        The thread that collects the sets.
    source : EncoderSource
        Where they come from.
    samples : sequence of JointSample
        The sets so far; it grows.
    seconds : float
        Longest time from the first set, s.
    evaluate : callable
        As of `record`.
    period : float
        Time between two evaluations, s.

    Returns
    -------
    str
        Why no further sets arrive; empty where they are enough, or the source has ended.

    """
    begin = 0.0
    count = 0
    last_arrival = time.monotonic()
    while not collecting.done():
        wait([collecting], period)
        found, lacking = _whole_sets(samples[:], MISSING_MAXIMUM)
        now = time.monotonic()
        silence = ''
        if len(found[0]) > count:
            count = len(found[0])
            last_arrival = now
            begin = begin or now
        elif now - last_arrival > PATIENCE:
            silence = f'no more sets of readings arrive: {lacking or source.fault}'
        is_enough = count > 0 and (evaluate(found, now - begin) or now - begin > seconds)
        if silence or is_enough:
            return silence
    return ''


def _collect(
    source: EncoderSource,
    seconds: float,
    samples: list[JointSample],
    stop: threading.Event,
) -> None:
    """Collect samples until the end of the source or of the recording, or until `stop`."""
    with suppress(SourceEnded):
        while not stop.is_set():
            sample = source.read(READ_TIMEOUT)
            if sample is None:
                continue
            if samples and sample.stamp - samples[0].stamp > seconds * 1e9:
                break
            samples.append(sample)
