# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The last values of some quantities, for a plot over time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


class History:
    """
    Rows of values with their times; the oldest leave.

    Parameters
    ----------
    columns : int
        Values in a row.
    length : int
        Rows kept.

    """

    def __init__(self, columns: int, length: int) -> None:
        self._columns = columns
        self._rows: deque[tuple[float, ...]] = deque(maxlen=length)

    def add(self, time: float, values: Sequence[float] | None) -> None:
        """Add a row at a time, s; None: a gap."""
        self._rows.append((time, *(values or (float('nan'),) * self._columns)))

    def columns(self, now: float) -> tuple[NDArray[np.float64], ...]:
        """Return times relative to now, s, and the values of each column."""
        if not self._rows:
            return tuple(np.zeros(1) if k == 0 else np.full(1, np.nan)
                         for k in range(self._columns + 1))
        table = np.array(self._rows).T
        return (table[0] - now, *table[1:])
