# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A row of the table of limits."""

from __future__ import annotations

from typing import NamedTuple


class Row(NamedTuple):
    """What is found, beside its limit."""

    name: str
    found: float
    limit: float
    unit: str
    more_is_better: bool = False

    @property
    def holds(self) -> bool:
        """Whether the limit holds."""
        if self.more_is_better:
            return self.found >= self.limit
        return self.found <= self.limit
