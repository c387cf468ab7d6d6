# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records the raw angles of a motion, from a log at once or from a bus while it happens."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
import threading
import time

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.recording import Completeness, PATIENCE, READ_TIMEOUT
from spm_haptic_master.encoders.replay_source import ReplaySource
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import CalibrationError, SourceEnded, SpmError

Array = NDArray[np.float64]
Recording = tuple[NDArray[np.int64], Array]

# Stamps, ns, shape (n,), angles, rad, shape (n, N), and why the source ended, or empty.
LiveRecording = tuple[NDArray[np.int64], Array, str]

# Time between two evaluations of a motion (s).
EVALUATION_PERIOD = 1.0


def read_log(source: ReplaySource, progress: Callable[[int], None],
             completeness: Completeness | None = None, seconds: float = inf) -> Recording:
    """
    Return stamps, ns, shape (n,), and angles, rad, shape (n, N), of a whole log.

    Sets in which a joint has no reading are left out, and counted by `completeness`; those later
    than `seconds` after the first one are left out, too.

    Raises
    ------
    ReplayError
        The log is broken or has no set.
    CalibrationError
        A joint lacks readings.

    """
    stamps: list[int] = []
    angles: list[tuple[float, ...]] = []
    completeness = completeness or Completeness()
    for sample in source.recorded():
        progress(completeness.sets + 1)
        if stamps and sample.stamp - stamps[0] > seconds * 1e9:
            break
        if completeness.has_all(sample.angles):
            stamps.append(sample.stamp)
            angles.append(sample.angles)
    completeness.check()
    return np.array(stamps, dtype=np.int64), np.array(angles)


class MotionRecorder(threading.Thread):
    """
    Reads a source in a thread of its own, so that an evaluation costs no sample.

    Parameters
    ----------
    source : EncoderSource
        Of raw angles; the caller closes it after `stop`.
    seconds : float
        Longest time from the first stamp to the last, s; it then ends by itself.
    completeness : Completeness
        Counts the sets that are left out because a joint has no reading.

    Attributes
    ----------
    error : SpmError or None
        Why it ended by itself.
    completeness : Completeness
        As given.

    """

    def __init__(self, source: EncoderSource, seconds: float, completeness: Completeness):
        super().__init__(name='motion recorder', daemon=True)
        self._source = source
        self._length = round(seconds * 1e9)
        self._ended = threading.Event()
        self._stamps: list[int] = []
        self._angles: list[tuple[float, ...]] = []
        self.error: SpmError | None = None
        self.completeness = completeness

    def run(self) -> None:
        """Collect samples until `stop`."""
        try:
            while not self._ended.is_set():
                sample = self._source.read(READ_TIMEOUT)
                if sample is None:
                    continue
                if self._stamps and sample.stamp - self._stamps[0] > self._length:
                    break
                if self.completeness.has_all(sample.angles):
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
        """Return what came so far: stamps, ns, shape (n,), and angles, rad, shape (n, N)."""
        count = len(self._angles)
        return (np.array(self._stamps[:count], dtype=np.int64),
                np.array(self._angles[:count]))


def record_motion(source: EncoderSource, seconds: float,
                  evaluate: Callable[[Recording, float], bool],
                  completeness: Completeness | None = None) -> LiveRecording:
    """
    Record until an evaluation is content, for some seconds at most, or until Ctrl-C.

    Where the source ends or fails after some sets, these are returned.

    Parameters
    ----------
    source : EncoderSource
        Of raw angles; the caller closes it.
    seconds : float
        Longest time from the first set on, s.
    evaluate : callable
        Called about each `EVALUATION_PERIOD` with what came so far and the time in s; returns
        whether that is enough.
    completeness : Completeness, optional
        Counts the sets that are left out because a joint has no reading.

    Returns
    -------
    stamps, angles
        As of `read_log`.
    ended : str
        Why no more sets came; empty where enough came.

    Raises
    ------
    CalibrationError
        No set arrived, or a joint lacks readings.

    """
    recorder = MotionRecorder(source, seconds, completeness or Completeness())
    recorder.start()
    ended = ''
    try:
        ended = _wait(recorder, source, seconds, evaluate)
    except KeyboardInterrupt:
        pass  # what came until then is used
    finally:
        recorder.stop()
    stamps, angles = recorder.recording()
    recorder.completeness.check()
    if not len(stamps):
        raise recorder.error or CalibrationError(
            f'no set of the encoders came: {source.fault}')
    return stamps, angles, str(recorder.error or ended)


def _wait(recorder: MotionRecorder, source: EncoderSource, seconds: float,
          evaluate: Callable[[Recording, float], bool]) -> str:
    """Wait for the end of a recording; return why no more sets come, or an empty text."""
    begin = None
    count, came = 0, time.monotonic()
    while recorder.is_alive():
        time.sleep(EVALUATION_PERIOD)
        found = recorder.recording()
        now = time.monotonic()
        if len(found[0]) > count:
            count, came = len(found[0]), now
        elif now - came > PATIENCE:
            return 'no set of the encoders comes any more: ' \
                f'{recorder.completeness.trouble or source.fault}'
        if not count:
            continue
        begin = begin or now
        if evaluate(found, now - begin) or now - begin > seconds:
            return ''
    return ''
