# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The grid of deadlines: no drift, missed deadlines counted, a time-out before a far deadline."""

import pytest
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid

PERIOD = 0.01


@pytest.mark.parametrize(('late', 'missed'), [(0.009, 0), (0.0105, 1), (0.0305, 3)])
def test_the_grid_keeps_its_phase_and_counts_what_passed(clock, late, missed):
    grid = DeadlineGrid(PERIOD)
    grid.wait(1.0)
    assert (clock.slept, grid.lateness, grid.missed) == ([], 0.0, 0)
    clock.late = late
    grid.wait(1.0)
    assert grid.missed == missed
    assert grid.lateness == pytest.approx(late, abs=1e-9)
    clock.late = 0.0
    grid.wait(1.0)
    assert clock.now == pytest.approx((2 + missed) * PERIOD, abs=1e-9)
    assert grid.missed == missed


def test_a_deadline_is_waited_for_up_to_the_timeout(clock):
    grid = DeadlineGrid(0.25)
    grid.wait(1.0)
    assert not grid.wait(0.125)
    assert clock.slept == [0.125]
    assert grid.wait(0.125)
    assert clock.now == 0.25
