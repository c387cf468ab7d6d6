# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The time of the samples: one that never goes back, from which every age is derived.

A stamp comes from the driver's clock, which may be set back, and samples that waited for each
other arrive in a burst. No other module derives an age from a stamp as it came.
"""

from __future__ import annotations

from dataclasses import dataclass

RESTART_GAP = 0.5  # s; the motion before a longer gap is of no use
# The clock was set back if so many samples in a row, over so long (s), have older stamps.
OLDER_SAMPLES = 3
OLDER_TIME = 0.1
# Samples over which period and jitter are averaged. Until so many came the period is at least
# `LEAST_PERIOD` (s), because the first stamps may be those of a burst.
PERIOD_SAMPLES = 50
LEAST_PERIOD = 0.001
LONGEST_GAP = 20.0  # periods that a gap counts for in the average at most
# Periods beyond which samples are missing between two stamps, which is no jitter; and periods
# below which the samples waited for each other and came in a burst.
LOST_PERIODS = 1.5
BURST_PERIODS = 0.5


@dataclass(slots=True)
class Tick:
    """
    The step from the last sample to this one.

    Attributes
    ----------
    elapsed : float
        Time since the last sample, s; 0 at the first one, after a pause and after a clock that was
        set back; negative if the stamp does not grow.
    restarts : bool
        Whether the motion before is of no use: a pause of more than `RESTART_GAP`, or a clock that
        was set back.

    """

    elapsed: float
    restarts: bool = False

    @property
    def is_old(self) -> bool:
        """Whether the stamp does not grow: the sample is withheld."""
        return self.elapsed < 0.0


class SampleClock:
    """
    Times between samples.

    Attributes
    ----------
    now : int
        Time of the latest sample, ns: that since the first stamp, and `LEAST_PERIOD`. While the
        clock is set back it goes on by a period a sample. 0 before the first sample.
    period : float
        Usual time between samples, s: a mean over `PERIOD_SAMPLES`; 0 before the second sample.
    jitter : float
        Mean deviation of the time between samples from the period, s; longer gaps do not count.

    """

    def __init__(self) -> None:
        self._stamp: int | None = None
        # The last stamp, ns; None where the next one continues `now`, whatever its value is. What
        # `now` is ahead of the stamps, ns, and how many stamps in a row did not grow.
        self._offset = 0
        self._older = 0
        self.now = 0
        self.restart()

    def restart(self) -> None:
        """Forget the period and the jitter, as after a pause; `now` goes on."""
        self.jitter = 0.0
        self.period = 0.0
        # Mean time between samples, s, and how many it averages, `PERIOD_SAMPLES` at most.
        self._mean = 0.0
        self._samples = 0
        # Time by which the latest sample came late, s: a burst catches up with it.
        self._late = 0.0

    def step(self, stamp: int) -> Tick:
        """
        Advance to the stamp of a sample.

        The first one of all, and after a clock that was set back, continues `now`, `LEAST_PERIOD`
        later.

        Parameters
        ----------
        stamp : int
            Stamp of the sample, ns.

        Returns
        -------
        Tick
            Time since the last sample, and whether the motion before it is of use.

        """
        if self._stamp is None:
            self._offset += round(LEAST_PERIOD * 1e9) - stamp
            self._stamp = stamp
            self.now = stamp + self._offset
            return Tick(0.0)
        elapsed = (stamp - self._stamp) * 1e-9
        if elapsed <= 0.0:
            return self._step_back(self._stamp, min(elapsed, -1e-9))
        self._stamp = stamp
        self._older = 0
        self.now = stamp + self._offset
        if elapsed > RESTART_GAP:
            return Tick(0.0, restarts=True)
        self._follow_period(elapsed)
        return Tick(self._sampling_time(elapsed))

    def _step_back(self, last: int, elapsed: float) -> Tick:
        """
        Count a stamp that does not grow: `elapsed` s (negative) after `last` (ns).

        Single ones are old samples. `OLDER_SAMPLES` in a row, and as many as come in `OLDER_TIME`,
        are a clock that was set back: the next stamp, of any value, then continues `now`. Right
        after a restart the period is not known, and the number of samples suffices.
        """
        self._older += 1
        self.now = last + self._offset + self._older * round(self.period * 1e9)
        if self._older < OLDER_SAMPLES or 0.0 < self._older * self.period < OLDER_TIME:
            return Tick(elapsed)
        self._offset = self.now
        self._stamp = None
        self._older = 0
        return Tick(elapsed, restarts=True)

    def _follow_period(self, elapsed: float) -> None:
        """Average the time between samples, s, and its deviation from the period."""
        if self._samples:
            elapsed = min(elapsed, LONGEST_GAP * self.period)
        if self._samples < PERIOD_SAMPLES:
            self._samples += 1
        self._mean += (elapsed - self._mean) / self._samples
        self.period = self._mean
        if self._samples < PERIOD_SAMPLES:
            self.period = max(self._mean, LEAST_PERIOD)
        if elapsed < LOST_PERIODS * self.period:
            self.jitter += (abs(elapsed - self.period) - self.jitter) / PERIOD_SAMPLES

    def _sampling_time(self, elapsed: float) -> float:
        """
        Return the time between the samplings of two samples, s, whose stamps are `elapsed` apart.

        Samples that waited for each other come in a burst after a gap, with stamps shortly one
        after the other, although they were sampled a period apart. The burst is over with the
        first usual distance.
        """
        period = self.period
        if elapsed > LOST_PERIODS * period:
            self._late = elapsed - period
        elif elapsed >= BURST_PERIODS * period:
            self._late = 0.0
        elif self._late >= period - elapsed:
            self._late -= period - elapsed
            return period
        return elapsed
