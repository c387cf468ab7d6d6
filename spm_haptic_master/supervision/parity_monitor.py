# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The four angles against each other: the parity of a single sample and over a window."""

from __future__ import annotations

from collections import deque
from math import sqrt

from spm_haptic_master.supervision.symptom import Symptom

# Window of the parity's duration test (samples): 20 ms at 1 kHz.
WINDOW = 20
# Shortest window (samples) that is tested, while the window fills.
FIRST_WINDOW = 5


class ParityMonitor:
    """
    Tests whether the four angles contradict each other, at once or a little for a while.

    The parity is the one combination of the four angles that no motion changes, in units of its
    standard deviation. It shows that one of four sensors is faulty, and not which.

    Parameters
    ----------
    threshold : float
        Limit of the parity and of the window's normalised sum, standard deviations.

    """

    def __init__(self, threshold: float):
        self._threshold = threshold
        self._parities: deque[float] = deque(maxlen=WINDOW)

    def restart(self) -> None:
        """Empty the window."""
        self._parities.clear()

    def evaluate(self, parity: float) -> list[Symptom]:
        """Return the symptom that the parity of a sample shows, alone or with those before."""
        if not abs(parity) <= self._threshold:
            return [Symptom('inconsistent angles',
                            f'parity {parity:.1f} sigma, limit {self._threshold:.1f}')]
        self._parities.append(parity)
        count = len(self._parities)
        together = sum(self._parities) / sqrt(count)
        if count >= FIRST_WINDOW and abs(together) > self._threshold:
            return [Symptom('angles drifted apart', f'parity of {count} samples '
                            f'{together:.1f} sigma, limit {self._threshold:.1f}', fault=True)]
        return []
