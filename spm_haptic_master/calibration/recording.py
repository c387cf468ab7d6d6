# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recording that a calibration evaluates: raw counts of the encoders at rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from math import isnan
import time

from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.encoders.source import EncoderSource
from spm_haptic_master.exceptions import CalibrationError, SourceEnded
from spm_haptic_master.joints import ALL_JOINT_NAMES, NUMBER_WORDS
from spm_haptic_master.parameters.encoders import for_sensors, HARMONIC_SETTINGS

# Longest wait for one set (s), so that the progress is shown in time.
READ_TIMEOUT = 0.1
# Time without any set (s) after which the recording gives up and reports why.
PATIENCE = 5.0
# Largest share of the sets in which a joint may lack a reading (unit 1): frames that are lost now
# and then; an encoder that is not there lacks them all.
MISSING_MAXIMUM = 0.2


class Completeness:
    """
    Counts of the joints without a reading: a calibration takes only sets with all of them.

    Attributes
    ----------
    sets : int
        Number of sets, with those that lack a reading.

    """

    def __init__(self) -> None:
        self.sets = 0
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


def record_counts(source: EncoderSource, counts_per_turn: Sequence[int], seconds: float,
                  progress: Callable[[float, int], None],
                  completeness: Completeness | None = None) -> list[list[int]]:
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
    completeness : Completeness, optional
        Counts the sets that are left out because a joint has no reading.

    Returns
    -------
    list of list of N int
        In the order of ALL_JOINT_NAMES, each in [0, counts_per_turn).

    Raises
    ------
    CalibrationError
        No set arrived, or a joint lacks readings.

    """
    counts: list[list[int]] = []
    completeness = completeness or Completeness()
    end = None
    give_up = time.monotonic() + PATIENCE
    try:
        while (now := time.monotonic()) < (end or give_up):
            sample = source.read(READ_TIMEOUT)
            if sample is not None:
                end = end or now + seconds
                give_up = now + PATIENCE
                if not completeness.has_all(sample.angles):
                    continue
                counts.append([round(angle * per_turn / TURN) % per_turn for angle, per_turn
                               in zip(sample.angles, counts_per_turn, strict=True)])
            elif now > give_up:
                break
            progress(0.0 if end is None else seconds - (end - now), len(counts))
    except SourceEnded:
        pass  # read_still reports a recording that is too short
    completeness.check()
    if not counts:
        raise CalibrationError(f'no set of {NUMBER_WORDS[len(counts_per_turn)]} encoders came: '
                               f'{source.fault}')
    return counts
