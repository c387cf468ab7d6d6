# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The speeds from which a motion still stops in time: by the distance that its steps cover."""

import pytest
from spm_haptic_master.teleoperation.braking import braking_speed, closing_speed


@pytest.mark.parametrize(
    ('room', 'dt', 'acceleration', 'speed'),
    [
        (-0.1, 0.1, 2.0, 0.0),
        (0.0, 0.1, 2.0, 0.0),
        # One step of 0.1 s at 1.0 covers 0.1, and braking by 2.0 from 1.0 covers 0.25.
        (0.35, 0.1, 2.0, 1.0),
        (1.5, 0.5, 0.5, 1.0),
    ],
)
def test_one_step_and_the_braking_after_it_cover_the_room(room, dt, acceleration, speed):
    assert braking_speed(room, dt, acceleration) == pytest.approx(speed, abs=1e-12)


@pytest.mark.parametrize(
    ('distance', 'speeds'),
    [
        (0.0, [0.0]),
        (0.04, [0.4]),
        (0.18, [1.8]),
        # In steps of 0.1 s, each slower by 2.0.
        (0.4, [3.0, 1.0]),
        (0.6003, [4.001, 2.001, 0.001]),
        (0.9, [5.0, 3.0, 1.0]),
    ],
)
def test_equal_steps_end_exactly_at_the_distance(distance, speeds):
    assert sum(speeds) * 0.1 == pytest.approx(distance, abs=1e-9)
    assert closing_speed(distance, 0.1, 2.0) == pytest.approx(speeds[0], abs=1e-9)
