# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recording that a calibration evaluates: raw counts of the four encoders at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time

from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.encoders.settings import HARMONIC_SETTINGS
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import CalibrationError, SourceEnded

# Settings of a source whose angles are the raw counts, times 2 pi over the counts per turn; and of
# a tool that needs no calibration.
RAW_COUNTS: dict[str, object] = {
    'encoders.direction': (1,) * 4, 'encoders.zero_count': (0,) * 4,
    **{setting.name: (0.0,) * (setting.count or 1) for setting in HARMONIC_SETTINGS}}
# Longest wait for one set (s), so that the progress is shown in time.
READ_TIMEOUT = 0.1
# Time without any set (s) after which the recording gives up and reports why.
PATIENCE = 5.0


def record_counts(source: EncoderSource, counts_per_turn: Sequence[int], seconds: float,
                  progress: Callable[[float, int], None]) -> list[list[int]]:
    """
    Return the counts of all sets that arrive within some seconds.

    The time runs from the first set: the nodes may still have to be started. A recorded source
    that ends earlier gives fewer sets.

    Parameters
    ----------
    source : EncoderSource
        Made with the settings `RAW_COUNTS`; the caller closes it.
    counts_per_turn : sequence of 4 int
        Scale of each encoder.
    seconds : float
        Length of the recording, s.
    progress : callable
        Called after each read with the recorded time (s) and the number of sets.

    Returns
    -------
    list of list of 4 int
        In the order of JOINT_NAMES, each in [0, counts_per_turn).

    Raises
    ------
    CalibrationError
        No set arrived.

    """
    counts: list[list[int]] = []
    end = None
    give_up = time.monotonic() + PATIENCE
    try:
        while (now := time.monotonic()) < (end or give_up):
            sample = source.read(READ_TIMEOUT)
            if sample is not None:
                end = end or now + seconds
                give_up = now + PATIENCE
                counts.append([round(angle * per_turn / TURN) % per_turn for angle, per_turn
                               in zip(sample.angles, counts_per_turn, strict=True)])
            elif now > give_up:
                break
            progress(0.0 if end is None else seconds - (end - now), len(counts))
    except SourceEnded:
        pass  # read_still reports a recording that is too short
    if not counts:
        raise CalibrationError(f'no set of four encoders came: {source.fault}')
    return counts
