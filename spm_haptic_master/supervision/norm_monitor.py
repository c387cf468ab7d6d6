# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Five or six angles against each other: the norm of the parity vector, and of its mean."""

from __future__ import annotations

from collections import deque
from math import hypot, sqrt

from spm_haptic_master.supervision.consistency_monitor import FIRST_TOGETHER, WINDOW_SAMPLES
from spm_haptic_master.supervision.symptom import Symptom

# Samples after which the sums are made anew: rounding must not add up over days.
SUMMED_SAMPLES = 1000


class NormMonitor:
    """
    Tests of the parity vector against noise and nominal bias, as `ConsistencyMonitor` for one.

    Parameters
    ----------
    threshold : float
        Norm that healthy noise never exceeds (unit 1).
    window : float
        Time over which the vector is averaged, s.

    Attributes
    ----------
    root : float
        Square root of the number of samples in the window, of `WINDOW_SAMPLES` at least.

    """

    __slots__ = ('_parities', '_since_summed', '_sums', '_threshold', '_window', 'root')

    def __init__(self, threshold: float, window: float) -> None:
        self._threshold = threshold
        self._window = round(window * 1e9)
        self._parities: deque[tuple[int, tuple[float, ...]]] = deque()
        self.restart()

    def restart(self) -> None:
        """Forget the samples."""
        self._parities.clear()
        self._sums: tuple[float, ...] = ()
        self._since_summed = 0
        self.root = sqrt(WINDOW_SAMPLES)

    @property
    def size(self) -> float:
        """Norm of the window's mean parity vector (unit 1); 0 without samples."""
        return hypot(*self._sums) / len(self._parities) if self._parities else 0.0

    def check(self, stamp: int, parity: tuple[float, ...], bias: float,
              noise: float) -> Symptom | None:
        """
        Test a sample by itself, then with those of the window.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        parity : tuple of float
            Parity vector: independent entries of unit variance with the configured noise.
        bias : float
            What the nominal biases may do to its norm (same unit).
        noise : float
            Measured noise over the configured one, at least 1.

        """
        limit = self._threshold * noise + bias
        size = hypot(*parity)
        if not size <= limit:
            return Symptom('inconsistent angles', f'parity {size:.1f} sigma, limit {limit:.1f}')
        parities = self._parities
        parities.append((stamp, parity))
        sums = self._sums or (0.0,) * len(parity)
        sums = tuple([total + each for total, each in zip(sums, parity, strict=True)])
        first = stamp - self._window
        while len(parities) > WINDOW_SAMPLES and parities[0][0] < first:
            _, old = parities.popleft()
            sums = tuple([total - each for total, each in zip(sums, old, strict=True)])
        self._since_summed += 1
        if self._since_summed >= SUMMED_SAMPLES:
            self._since_summed = 0
            sums = tuple(map(sum, zip(*(each for _, each in parities), strict=True)))
        self._sums = sums
        count = len(parities)
        self.root = sqrt(max(count, WINDOW_SAMPLES))
        if count >= FIRST_TOGETHER:
            size = hypot(*sums) / count
            limit = self._threshold * noise / sqrt(count) + bias
            if not size <= limit:
                return Symptom(
                    'angles drifted apart', f'mean parity of {count} samples {size:.2f} sigma, '
                    f'limit {limit:.2f}', fault=True)
        return None
