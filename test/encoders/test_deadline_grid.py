# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The grid of deadlines: no drift, missed deadlines counted, a time-out before a far deadline."""

import time

from spm_haptic_master.encoders.deadline_grid import DeadlineGrid


def test_a_grid_counts_what_it_missed_and_never_drifts():
    grid = DeadlineGrid(0.01)
    began = time.monotonic()
    for _ in range(5):
        assert grid.wait(1.0)
    missed_before = grid.missed
    time.sleep(0.055)
    assert grid.wait(1.0)
    # 55 ms asleep right after a deadline: four to six of the next ones passed.
    assert 4 <= grid.missed - missed_before
    while grid.wait(1.0) and time.monotonic() - began < 0.3:
        pass
    taken = time.monotonic() - began
    # Where it stands now is on the grid that began with the first wait.
    assert 0.0 <= taken % 0.01 < 0.009 or grid.missed > missed_before


def test_a_wait_ends_before_a_far_deadline():
    grid = DeadlineGrid(10.0)
    assert grid.wait(0.0)
    began = time.monotonic()
    assert not grid.wait(0.02)
    assert time.monotonic() - began < 1.0
