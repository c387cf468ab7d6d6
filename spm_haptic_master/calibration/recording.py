# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The raw angles that a calibration evaluates: of a log at once, of a source while it happens."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from math import inf, isnan
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


class _Sets:
    """The sets with a reading of every joint, up to `seconds` after the first; others counted."""

    def __init__(self, seconds: float) -> None:
        self._length = seconds * 1e9
        self._count = 0  # with those that lack a reading
        self._missing: Counter[int] = Counter()
        self._stamps: list[int] = []
        self._angles: list[tuple[float, ...]] = []

    def take(self, sample: JointSample) -> bool:
        """Take a set; return whether it is not too late."""
        if self._stamps and sample.stamp - self._stamps[0] > self._length:
            return False
        self._count += 1
        missing = [index for index, angle in enumerate(sample.angles) if isnan(angle)]
        self._missing.update(missing)
        if not missing:
            # The angles last: `recording` takes as many stamps as there are angles.
            self._stamps.append(sample.stamp)
            self._angles.append(sample.angles)
        return True

    def recording(self) -> Recording:
        """Return what came so far."""
        count = len(self._angles)
        return (np.array(self._stamps[:count], dtype=np.int64),
                np.array(self._angles[:count]))

    def lacking(self, share: float = MISSING_MAXIMUM) -> str:
        """Return which joints lack readings in more than a share of the sets, and in how many."""
        return '; '.join(
            f'{ALL_JOINT_NAMES[index]} has no reading in {count} of {self._count} sets'
            for index, count in sorted(self._missing.items()) if count > share * self._count)

    def complete(self) -> tuple[Recording, list[str]]:
        """Return the recording, and what is left out; CalibrationError if that is too much."""
        if self.lacking():
            raise CalibrationError(
                f'{self.lacking()}; expected readings of all joints: check the encoder, or give '
                '`sensors` without it')
        lacking = self.lacking(0.0)
        return self.recording(), [f'{lacking}; these are left out'] if lacking else []


def raw_counts(sensors: int) -> dict[str, object]:
    """Return the settings of a source whose angles are raw counts times 2 pi per turn."""
    return {'encoders.direction': (1,) * sensors, 'encoders.zero_count': (0,) * sensors,
            **{setting.name: (0.0,) * (setting.count or 1)
               for setting in for_sensors(HARMONIC_SETTINGS, sensors)}}


def read_log(source: ReplaySource, progress: Callable[[int], None] = lambda count: None,
             seconds: float = inf) -> tuple[Recording, list[str]]:
    """
    Return the sets of a log in which every joint has a reading, and what is left out, in words.

    ReplayError where the log is broken or has no set, CalibrationError where a joint lacks
    readings.
    """
    sets = _Sets(seconds)
    for number, sample in enumerate(source.recorded(), 1):
        progress(number)
        if not sets.take(sample):
            break
    return sets.complete()


def record(source: EncoderSource, seconds: float, evaluate: Callable[[Recording, float], bool],
           period: float = 1.0, keep: bool = True) -> tuple[Recording, list[str]]:
    """
    Record until an evaluation is content, for some seconds from the first set, or until Ctrl-C.

    `evaluate` takes, about each `period` s, what came so far and the time, s, and returns whether
    that is enough. With `keep`, what came before Ctrl-C or an error of the source is returned.
    The texts say what is left out, and why no more came. CalibrationError where no set arrives,
    or a joint lacks readings.
    """
    sets, stop = _Sets(seconds), threading.Event()
    ended = ''
    begin, count, came = 0.0, 0, time.monotonic()
    # In a thread of its own, so that an evaluation costs no sample.
    with ThreadPoolExecutor(1) as pool:
        collecting = pool.submit(_collect, source, sets, stop)
        try:
            while not collecting.done() and not ended:
                time.sleep(period)
                found = sets.recording()
                now = time.monotonic()
                if len(found[0]) > count:
                    count, came = len(found[0]), now
                    begin = begin or now
                elif now - came > PATIENCE:
                    ended = 'no set of the encoders comes any more: ' \
                        f'{sets.lacking() or source.fault}'
                if count and (evaluate(found, now - begin) or now - begin > seconds):
                    break
        except KeyboardInterrupt:
            if not keep:
                raise
        finally:
            stop.set()
    recording, notes = sets.complete()
    error = collecting.exception()
    if error and not (keep and len(recording[0]) and isinstance(error, SpmError)):
        raise error
    if not len(recording[0]):
        raise CalibrationError(f'no set of the encoders came: {source.fault}')
    if error or ended:
        notes.append(f'{error or ended}; what came until then is used')
    return recording, notes


def _collect(source: EncoderSource, sets: _Sets, stop: threading.Event) -> None:
    """Collect sets until the end of the source or of the recording, or until `stop`."""
    with suppress(SourceEnded):
        while not stop.is_set():
            sample = source.read(READ_TIMEOUT)
            if sample is not None and not sets.take(sample):
                break
