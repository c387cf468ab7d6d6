# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The angles against each other: the parity vector of one sample, and its mean over a window.

N readings of three degrees of freedom have N - 3 combinations that no motion changes: the
parities. Healthy readings leave noise in them, a fault moves them. One sample shows a large fault
at once; the mean of the window shows a small one, because noise averages out and a fault does not.
"""

from __future__ import annotations

from collections import deque
from math import sqrt

from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom

WINDOW_SAMPLES = 10  # fewest samples of the window, at any rate
FIRST_TOGETHER = 5  # fewest samples that are tested together
SUMMED_SAMPLES = 1000  # after which sums are computed anew: rounding must not add up over days
# Samples over which the variance is averaged, and how many the expected variance counts for at the
# start.
VARIANCE_SAMPLES = 256.0
LEARNT_SAMPLES = 64.0
OUTLIER = 16.0  # largest square of a deviation, over the mean square, that the variance counts


class ParityWindow:
    """
    Tests of the parity vector against noise and nominal bias (RAIM: detection threshold).

    Parameters
    ----------
    threshold : float
        Norm that healthy noise of unit variance never exceeds (unit 1).
    entries : int
        Length of the parity vector, 1 to 3.
    window : float
        Time to alert of a small fault, s.

    Attributes
    ----------
    root : float
        Square root of the number of samples in the window, counted as `WINDOW_SAMPLES` at least:
        the mean has 1 / root of the deviation of a sample.
    variance : float
        Variance of an entry, measured about the window's mean (unit 1).

    """

    def __init__(self, threshold: float, entries: int, window: float) -> None:
        self._threshold = threshold
        self._entries = entries
        self._window = round(window * 1e9)
        # Of each sample in the window: stamp (ns), three entries and bias of the parity (unit 1).
        self._parities: deque[tuple[int, float, float, float, float]] = deque()
        self.variance = 1.0
        self._learnt = LEARNT_SAMPLES
        self.restart()

    def restart(self) -> None:
        """Forget the samples; the variance stays."""
        self._parities.clear()
        # Sums of the entries and of the biases over the window.
        self._x = self._y = self._z = self._bias = 0.0
        self._since_summed = 0
        self.root = sqrt(WINDOW_SAMPLES)

    @property
    def mean(self) -> tuple[float, float, float]:
        """Return the mean parity vector of the window, zeros behind its entries (unit 1)."""
        weight = 1.0 / (len(self._parities) or 1)
        return weight * self._x, weight * self._y, weight * self._z

    @property
    def mean_bias(self) -> float:
        """Return the mean of the biases that the samples of the window were allowed (unit 1)."""
        return self._bias / (len(self._parities) or 1)

    def limit(
        self,
        noise: float,
        bias: float,
        samples: int = 1,
    ) -> float:
        """
        Return the limit of the norm of a mean of samples.

        Parameters
        ----------
        noise : float
            Bound of the measured deviation of an entry (unit 1).
        bias : float
            What the nominal biases do to the norm at most, in standard deviations.
        samples : int
            Number of samples that are averaged.

        Returns
        -------
        float
            k_fa noise / sqrt(samples) + bias, in standard deviations.

        """
        return self._threshold * noise / sqrt(samples) + bias

    def test(
        self,
        stamp: int,
        parity: tuple[float, ...],
        noise: float,
        bias: float,
    ) -> Symptom | None:
        """
        Test a sample by itself, then with those of the window.

        With the configured noise the entries are independent and have unit variance. A sample that
        fails by itself does not enter the window, and fewer than `FIRST_TOGETHER` are not tested
        together.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        parity : tuple of float
            Parity vector, one to three entries (unit 1).
        noise : float
            Bound of the measured deviation of an entry (unit 1).
        bias : float
            What the nominal biases do to the norm at most, in standard deviations.

        Returns
        -------
        Symptom or None
            INCONSISTENT for the sample, DRIFTED for the mean, which latches at once; None if both
            are within their limits.

        """
        x, y, z = (*parity, 0.0, 0.0)[:3]
        square = x * x + y * y + z * z
        limit = self.limit(noise, bias)
        # The negation lets NaN fail.
        if not square <= limit * limit:
            detail = f'parity {sqrt(square):.1f} sigma, limit {limit:.1f}'
            return Symptom(Reason.INCONSISTENT, detail)
        self._append(stamp, x, y, z, bias)
        count = len(self._parities)
        if count < FIRST_TOGETHER:
            return None
        mean_x, mean_y, mean_z = self.mean
        self._follow_variance(x - mean_x, y - mean_y, z - mean_z)
        mean_square = mean_x * mean_x + mean_y * mean_y + mean_z * mean_z
        # The nominal biases of a moving device may do less to this sample than to the others.
        mean_limit = self.limit(noise, max(bias, self.mean_bias), count)
        if mean_square <= mean_limit * mean_limit:
            return None
        size = sqrt(mean_square)
        detail = f'mean parity of {count} samples {size:.2f} sigma, limit {mean_limit:.2f}'
        return Symptom(Reason.DRIFTED, detail, severity=Severity.LATCH)

    def _append(
        self,
        stamp: int,
        x: float,
        y: float,
        z: float,
        bias: float,
    ) -> None:
        """Add a sample to the window and its sums; drop those that are older than the window."""
        parities = self._parities
        parities.append((stamp, x, y, z, bias))
        self._x += x
        self._y += y
        self._z += z
        self._bias += bias
        first = stamp - self._window
        while len(parities) > WINDOW_SAMPLES and parities[0][0] < first:
            _, old_x, old_y, old_z, old_bias = parities.popleft()
            self._x -= old_x
            self._y -= old_y
            self._z -= old_z
            self._bias -= old_bias
        self.root = sqrt(max(len(parities), WINDOW_SAMPLES))
        self._since_summed += 1
        if self._since_summed >= SUMMED_SAMPLES:
            self._sum_anew()

    def _sum_anew(self) -> None:
        """Compute the sums anew from the samples of the window: rounding errors had added up."""
        self._since_summed = 0
        _, xs, ys, zs, biases = zip(*self._parities, strict=True)
        self._x = sum(xs)
        self._y = sum(ys)
        self._z = sum(zs)
        self._bias = sum(biases)

    def _follow_variance(self, x: float, y: float, z: float) -> None:
        """Average the squared deviation of a sample from the mean; an outlier counts little."""
        mean = self.variance
        square = min((x * x + y * y + z * z) / self._entries, OUTLIER * mean)
        if self._learnt < VARIANCE_SAMPLES:
            self._learnt += 1.0
        self.variance = mean + (square - mean) / self._learnt
