# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measurements on a machine that may be busy: how busy it was, and what that makes of them."""

from __future__ import annotations

from collections.abc import Callable
import os
import time
from typing import TypeVar

import numpy as np
import pytest
from spm_haptic_master.benchmark.process_load import Control, machine_ticks, TICK, tree_ticks

# Lateness of a thread that only wakes up, from which the machine was disturbed (s): a fifth of
# what the queues of the topics hold.
DISTURBED_LATENESS = 0.02
# CPU time of other programs from which the machine was disturbed (% of a core).
DISTURBED_LOAD = 20.0
# Measurements until one is valid.
ATTEMPTS = 2

Result = TypeVar('Result')


class Disturbance:
    """
    How busy the machine was in a `with` block.

    Attributes
    ----------
    lateness : float
        Largest lateness of a control thread, s.
    load : float
        CPU time of programs that this process has not started, % of a core.

    """

    def __enter__(self):
        self._began, self._others = time.monotonic(), machine_ticks() - tree_ticks(os.getpid())
        self._control = Control()
        return self

    def __exit__(self, *_):
        self.lateness = 1e-6 * float(np.max(self._control.stop(), initial=0.0))
        others = machine_ticks() - tree_ticks(os.getpid()) - self._others
        self.load = 100.0 * TICK * others / (time.monotonic() - self._began)

    @property
    def disturbed(self) -> bool:
        """Whether the machine was too busy for a measurement at 1 kHz."""
        return self.lateness > DISTURBED_LATENESS or self.load > DISTURBED_LOAD

    def __str__(self):
        return (f'control thread up to {1e3 * self.lateness:.0f} ms late, '
                f'other programs {self.load:.0f} % of a core')


def measure_undisturbed(measure: Callable[[], Result],
                        complete: Callable[[Result], bool]) -> Result:
    """
    Return a measurement that a disturbed machine did not spoil.

    A disturbance can only lose or delay samples: a complete measurement is valid, and so is any
    other of an undisturbed machine, which the test then evaluates. Where the machine was disturbed
    at each attempt, the test is skipped.
    """
    for attempt in range(1, ATTEMPTS + 1):
        with Disturbance() as machine:
            result = measure()
        if complete(result) or not machine.disturbed:
            return result
        print(f'measurement {attempt} of {ATTEMPTS} is incomplete on a disturbed machine: '
              f'{machine}')
    pytest.skip(f'no complete measurement in {ATTEMPTS} on a disturbed machine: {machine}')
