# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The raw angles that a calibration evaluates: of a log at once, of a source while it happens."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from math import inf, isnan
import threading
import time

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.encoders.replay_source import ReplaySource
from spm_haptic_master.encoders.source import EncoderSource
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


class Completeness:
    """Counts the joints without a reading: a calibration takes only sets with all of them."""

    def __init__(self) -> None:
        self.sets = 0  # with those that lack a reading
        self._missing: Counter[int] = Counter()

    def has_all(self, angles: Sequence[float]) -> bool:
        """Count a set; return whether every joint has a reading."""
        self.sets += 1
        missing = [index for index, angle in enumerate(angles) if isnan(angle)]
        self._missing.update(missing)
        return not missing

    @property
    def trouble(self) -> str:
        """Which joints lack too many readings, and how many; or empty."""
        return self._lacking(MISSING_MAXIMUM)

    @property
    def left_out(self) -> str:
        """Which joints lack readings, and in how many sets: these are left out; or empty."""
        return self._lacking(0.0)

    def _lacking(self, share: float) -> str:
        """Return which joints lack readings in more than a share of the sets, and in how many."""
        return '; '.join(
            f'{ALL_JOINT_NAMES[index]} has no reading in {count} of {self.sets} sets'
            for index, count in sorted(self._missing.items()) if count > share * self.sets)

    def check(self) -> None:
        """Raise CalibrationError if a joint lacks too many readings."""
        if self.trouble:
            raise CalibrationError(
                f'{self.trouble}; expected readings of all joints: check the encoder, or give '
                '`sensors` without it')


def raw_counts(sensors: int) -> dict[str, object]:
    """
    Return the settings of a source of raw counts: its angles are 2 pi over the counts per turn.

    A tool that needs no calibration takes them, too.
    """
    return {'encoders.direction': (1,) * sensors, 'encoders.zero_count': (0,) * sensors,
            **{setting.name: (0.0,) * (setting.count or 1)
               for setting in for_sensors(HARMONIC_SETTINGS, sensors)}}


def read_log(source: ReplaySource, progress: Callable[[int], None],
             completeness: Completeness, seconds: float = inf) -> Recording:
    """
    Return the sets of a log in which every joint has a reading, up to `seconds` after the first.

    ReplayError where the log is broken or has no set, CalibrationError where a joint lacks
    readings.
    """
    stamps: list[int] = []
    angles: list[tuple[float, ...]] = []
    for sample in source.recorded():
        progress(completeness.sets + 1)
        if stamps and sample.stamp - stamps[0] > seconds * 1e9:
            break
        if completeness.has_all(sample.angles):
            stamps.append(sample.stamp)
            angles.append(sample.angles)
    completeness.check()
    return np.array(stamps, dtype=np.int64), np.array(angles)


class _Recorder(threading.Thread):
    """
    Reads a source of raw angles in a thread of its own, so that an evaluation costs no sample.

    It ends by itself `seconds` after the first stamp, at the source's end or at its error.
    """

    def __init__(self, source: EncoderSource, seconds: float, completeness: Completeness):
        super().__init__(name='motion recorder', daemon=True)
        self._source = source
        self._length = round(seconds * 1e9)
        self._ended = threading.Event()
        self._stamps: list[int] = []
        self._angles: list[tuple[float, ...]] = []
        self._completeness = completeness
        self.error: SpmError | None = None

    def run(self) -> None:
        """Collect samples until `stop`."""
        try:
            while not self._ended.is_set():
                sample = self._source.read(READ_TIMEOUT)
                if sample is None:
                    continue
                if self._stamps and sample.stamp - self._stamps[0] > self._length:
                    break
                if self._completeness.has_all(sample.angles):
                    # The angles last: `recording` takes as many stamps as there are angles.
                    self._stamps.append(sample.stamp)
                    self._angles.append(sample.angles)
        except SourceEnded:
            pass
        except SpmError as error:
            self.error = error

    def stop(self) -> None:
        """End the thread."""
        self._ended.set()
        self.join()

    def recording(self) -> Recording:
        """Return what came so far."""
        count = len(self._angles)
        return (np.array(self._stamps[:count], dtype=np.int64),
                np.array(self._angles[:count]))


def record(source: EncoderSource, seconds: float, evaluate: Callable[[Recording, float], bool],
           completeness: Completeness, period: float = 1.0,
           keep: bool = True) -> tuple[Recording, str]:
    """
    Record until an evaluation is content, for some seconds from the first set, or until Ctrl-C.

    `evaluate` takes, about each `period` s, what came so far and the time, s, and returns whether
    that is enough. With `keep`, what came before Ctrl-C or an error of the source is returned;
    the text says why no more came, and is empty otherwise. CalibrationError where no set arrives,
    or a joint lacks readings.
    """
    recorder = _Recorder(source, seconds, completeness)
    recorder.start()
    ended = ''
    begin, count, came = 0.0, 0, time.monotonic()
    try:
        while recorder.is_alive() and not ended:
            time.sleep(period)
            found = recorder.recording()
            now = time.monotonic()
            if len(found[0]) > count:
                count, came = len(found[0]), now
                begin = begin or now
            elif now - came > PATIENCE:
                ended = 'no set of the encoders comes any more: ' \
                    f'{completeness.trouble or source.fault}'
            if count and (evaluate(found, now - begin) or now - begin > seconds):
                break
    except KeyboardInterrupt:
        if not keep:
            raise
    finally:
        recorder.stop()
    recording = recorder.recording()
    completeness.check()
    if recorder.error and not (keep and len(recording[0])):
        raise recorder.error
    if not len(recording[0]):
        raise CalibrationError(f'no set of the encoders came: {source.fault}')
    return recording, str(recorder.error or ended)
