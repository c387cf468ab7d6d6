# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recording that a calibration evaluates: raw counts of the encoders at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time

from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.encoders.settings import for_sensors, HARMONIC_SETTINGS
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import CalibrationError, SourceEnded
from spm_haptic_master.joints import NUMBER_WORDS

# Longest wait for one set (s), so that the progress is shown in time.
READ_TIMEOUT = 0.1
# Time without any set (s) after which the recording gives up and reports why.
PATIENCE = 5.0


def raw_counts(sensors: int) -> dict[str, object]:
    """
    Return the settings of a source of raw counts: its angles are 2 pi over the counts per turn.

    A tool that needs no calibration takes them, too.
    """
    return {'encoders.direction': (1,) * sensors, 'encoders.zero_count': (0,) * sensors,
            **{setting.name: (0.0,) * (setting.count or 1)
               for setting in for_sensors(HARMONIC_SETTINGS, sensors)}}


def record_counts(source: EncoderSource, counts_per_turn: Sequence[int], seconds: float,
                  progress: Callable[[float, int], None]) -> list[list[int]]:
    """
    Return the counts of all sets that arrive within some seconds.

    The time runs from the first set: the nodes may still have to be started. A recorded source
    that ends earlier gives fewer sets.

    Parameters
    ----------
    source : EncoderSource
        Made with the settings `raw_counts`; the caller closes it.
    counts_per_turn : sequence of N int
        Scale of each encoder.
    seconds : float
        Length of the recording, s.
    progress : callable
        Called after each read with the recorded time (s) and the number of sets.

    Returns
    -------
    list of list of N int
        In the order of ALL_JOINT_NAMES, each in [0, counts_per_turn).

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
        raise CalibrationError(f'no set of {NUMBER_WORDS[len(counts_per_turn)]} encoders came: '
                               f'{source.fault}')
    return counts
