# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motion that a tool evaluates: a log at once, a bus while the user moves the device."""

from __future__ import annotations

from collections.abc import Callable
import sys
from typing import Any

from spm_haptic_master.calibration.motion_recording import read_log, record_motion, Recording
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.source_factory import make_replay, make_source
from spm_haptic_master.tools.progress_bar import CountBar

# Shows a recording's state; returns whether it is enough.
Evaluate = Callable[[Recording, float], bool]


def check_source(source: str, nothing_to: str) -> None:
    """Raise InputError for a source that has no motion of a real device."""
    if source not in ('can', 'replay'):
        raise InputError(f"parameter 'source' is {source!r}; expected can or replay "
                         f'(a simulation has nothing to {nothing_to})')


def read_motion(source: str, values: dict[str, Any], seconds: float, instruction: str,
                show: Callable[[EncoderSource], tuple[Evaluate, Callable[[], None]]]
                ) -> Recording:
    """
    Return the recording of a motion.

    Parameters
    ----------
    source : str
        'can' or 'replay'.
    values : dict
        Checked settings of the source.
    seconds : float
        Longest time of a live recording, s.
    instruction : str
        What the user is asked to do, on stderr.
    show : callable
        Takes the live source; returns what shows and evaluates its recording, and what ends that.

    Raises
    ------
    CalibrationError, ReplayError
        No set came, or the log is broken.

    """
    if source == 'replay':
        bar = CountBar('calibrate', None, 'sets read')
        replay = make_replay(values)
        try:
            return read_log(replay, bar.show)
        finally:
            bar.end()
            replay.close()
    live = make_source(source, values)
    print(f'calibrate: {instruction}', file=sys.stderr, flush=True)
    evaluate, end = show(live)
    try:
        stamps, angles, ended = record_motion(live, seconds, evaluate)
    finally:
        end()
        live.close()
    if ended:
        print(f'calibrate: {ended}; what came until then is used', file=sys.stderr, flush=True)
    return stamps, angles
