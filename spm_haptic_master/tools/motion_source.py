# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motion that a tool evaluates: a log at once, a bus while the user moves the device."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from pathlib import Path
import sys
from typing import Any

from spm_haptic_master.calibration.motion.recording import read_log, record_motion, Recording
from spm_haptic_master.calibration.recording import Completeness
from spm_haptic_master.encoders.can_source import CanSource
from spm_haptic_master.encoders.frame_log import FrameLog, free_path
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes.source_factory import make_replay, make_source
from spm_haptic_master.tools.progress_bar import LINE_PERIOD, ProgressBar

# Shows a recording's state; returns whether it is enough.
Evaluate = Callable[[Recording, float], bool]


def check_source(source: str, nothing_to: str) -> None:
    """Raise InputError for a source that has no motion of a real device."""
    if source not in ('can', 'replay'):
        raise InputError(f"parameter 'source' is {source!r}; expected can or replay "
                         f'(a simulation has nothing to {nothing_to})')


def read_motion(source: str, values: dict[str, Any], given: float | None, live_seconds: float,
                instruction: str,
                show: Callable[[EncoderSource], tuple[Evaluate, Callable[[], None]]],
                keep: Path | None = None) -> Recording:
    """
    Return the recording of a motion.

    Parameters
    ----------
    source : str
        'can' or 'replay'.
    values : dict
        Checked settings of the source.
    given : float or None
        Longest time that the user wants, s.
    live_seconds : float
        Longest time of a live recording where none is given, s; of a log it is the whole.
    instruction : str
        What the user is asked to do, on stderr.
    show : callable
        Takes the live source; returns what shows and evaluates its recording, and what ends that.
    keep : Path, optional
        File of the frames of a live source, written while they come; where it exists, the next
        free number is appended to its name.

    Raises
    ------
    CalibrationError, ReplayError
        No set came, or the log is broken.

    """
    completeness = Completeness()
    if source == 'replay':
        bar = ProgressBar('calibrate', LINE_PERIOD)
        replay = make_replay(values)
        try:
            recording = read_log(replay, lambda count: bar.show(f'{count} sets read'),
                                 completeness, given or inf)
        finally:
            bar.end()
            replay.close()
        report_left_out(completeness)
        return recording
    live = make_source(source, values)
    print(f'calibrate: {instruction}', file=sys.stderr, flush=True)
    kept = _kept(live, keep)
    evaluate, end = show(live)
    try:
        stamps, angles, ended = record_motion(live, given or live_seconds, evaluate, completeness)
    finally:
        end()
        live.close()
        _finish(kept)
    report_left_out(completeness)
    if ended:
        print(f'calibrate: {ended}; what came until then is used', file=sys.stderr, flush=True)
    return stamps, angles


def report_left_out(completeness: Completeness) -> None:
    """Print which joints lack readings, if any do: a calibration is made without these sets."""
    if completeness.left_out:
        print(f'calibrate: {completeness.left_out}; these are left out', file=sys.stderr,
              flush=True)


def _kept(live: EncoderSource, path: Path | None) -> FrameLog | None:
    """Return the log that keeps the frames of a live source, None without a path; print it."""
    if path is None or not isinstance(live, CanSource):
        return None
    log = FrameLog(free_path(path))
    live.keep(log.take)
    print(f'calibrate: the motion is kept in {log.path}; from it again: -p source:=replay -p '
          f'replay.path:={log.path}', file=sys.stderr, flush=True)
    return log


def _finish(log: FrameLog | None) -> None:
    """End a log; print why it could not be written."""
    if log is not None:
        log.close()
        if log.error:
            print(f'calibrate: {log.path}: cannot be written: {log.error}; the motion is not kept '
                  'from then on', file=sys.stderr, flush=True)
