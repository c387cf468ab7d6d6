# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The angles against each other: the parity of one sample, and its mean over a window."""

from __future__ import annotations

from collections import deque
from math import sqrt

from spm_haptic_master.supervision.symptom import Symptom

# Samples that the window has at least, where they come slowly (samples).
WINDOW_SAMPLES = 10
# Samples from which on they are tested together (samples).
FIRST_TOGETHER = 5


class ConsistencyMonitor:
    """
    Tests of the parity against noise and nominal bias (RAIM: detection threshold).

    Parameters
    ----------
    threshold : float
        Standard deviations that healthy noise never exceeds (unit 1).
    window : float
        Time over which the parity is averaged, s: the time to alert of a small fault.

    Attributes
    ----------
    count : int
        Samples in the window.
    root : float
        Square root of their number, of `WINDOW_SAMPLES` at least.

    """

    def __init__(self, threshold: float, window: float) -> None:
        self._threshold = threshold
        self._window = round(window * 1e9)
        self._parities: deque[tuple[int, float]] = deque()
        self._sum = 0.0
        self._since_summed = 0
        self.count = 0
        self.root = sqrt(WINDOW_SAMPLES)

    def restart(self) -> None:
        """Forget the samples."""
        self._parities.clear()
        self._sum = 0.0
        self.count = 0
        self.root = sqrt(WINDOW_SAMPLES)

    @property
    def mean(self) -> float:
        """Mean parity of the window, in standard deviations of one sample; 0 without samples."""
        return self._sum / self.count if self.count else 0.0

    def check(self, stamp: int, parity: float, bias: float, noise: float) -> Symptom | None:
        """
        Test a sample by itself, then with those of the window.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        parity : float
            Normalised residual, unit variance with the configured noise.
        bias : float
            What the nominal biases may do to the parity (same unit).
        noise : float
            Measured noise over the configured one, at least 1.

        """
        limit = self._threshold * noise + bias
        if not -limit <= parity <= limit:
            return Symptom('inconsistent angles', f'parity {parity:.1f} sigma, limit {limit:.1f}')
        parities = self._parities
        parities.append((stamp, parity))
        self._sum += parity
        first = stamp - self._window
        while len(parities) > WINDOW_SAMPLES and parities[0][0] < first:
            self._sum -= parities.popleft()[1]
        count = len(parities)
        if count != self.count:
            self.count = count
            self.root = sqrt(max(count, WINDOW_SAMPLES))
        self._since_summed += 1
        if self._since_summed >= 1000:
            # Rounding must not add up over days.
            self._sum, self._since_summed = sum(each for _, each in parities), 0
        if count >= FIRST_TOGETHER:
            root = self.root if count >= WINDOW_SAMPLES else sqrt(count)
            limit = self._threshold * noise / root + bias
            if not -limit <= self._sum / count <= limit:
                return Symptom(
                    'angles drifted apart', f'mean parity of {count} samples '
                    f'{self._sum / count:.2f} sigma, limit {limit:.2f}', fault=True)
        return None
