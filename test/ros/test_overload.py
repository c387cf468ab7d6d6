# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""When a machine is too busy, and what that explains; the test makes the time."""

import pytest
from spm_haptic_master.ros.overload import Overload, TOO_BUSY

PERIOD = 0.02
# Time in which a process starts, for which lost time counts, and which an overload explains (s).
SECOND = 1.0
LOST = f'{TOO_BUSY}: this process was due and did not run for more than'


class Task(Overload):
    """A task that runs when the test lets it."""

    def run(self, late=0.0, count=1, **others):
        for _ in range(count):
            self.now += PERIOD + late
            self.tick(self.now, **others)
        return self.words


@pytest.fixture
def task():
    """Give a task that has started."""
    task = Task(PERIOD)
    task.now = 100.0
    task.run(count=1 + round(2.0 * SECOND / PERIOD))
    return task


@pytest.mark.parametrize(
    ('gap', 'figure'),
    [
        (0.051, '0.05 s'),
        (0.12, '0.1 s'),
        (0.3, '0.2 s'),
        (0.99, '0.5 s'),
        (1.4, '1 s'),
        (30.0, '20 s'),
        (700.0, '500 s'),
    ],
)
def test_one_gap_is_reported_with_its_length_for_a_second(task, gap, figure):
    assert task.run(late=gap) == f'{LOST} {figure}'
    assert task.run(count=round(SECOND / PERIOD) - 1)
    assert task.run(count=2) == ''


def test_a_process_that_starts_is_busy_with_itself():
    overload = Overload(PERIOD)
    words = []
    for now in (5.0, 5.0 + 0.5 * SECOND, 5.0 + SECOND, 5.1 + 2.0 * SECOND):
        overload.tick(now)
        words.append(bool(overload.words))
    assert words == [False, False, False, True]


def test_small_gaps_add_up_within_a_second_only(task):
    # Late by less than a period it has missed no deadline, however often.
    assert task.run(late=0.9 * PERIOD, count=500) == ''
    assert task.run(late=0.03) == ''
    assert task.run(count=round(SECOND / PERIOD) + 2) == ''
    assert task.run(late=0.03) == ''
    # The figure only grows until it ends: each other figure would be a line of the log.
    assert {task.run(late=0.03) for _ in range(200)} == {
        f'{LOST} {figure}' for figure in ('0.05 s', '0.1 s', '0.2 s', '0.5 s')
    }
    assert task.run(count=round(SECOND / PERIOD) - 1)
    assert task.run(count=2) == ''


def test_what_others_lost_counts_once_and_the_words_of_another_process_are_taken_over(task):
    assert task.run(reported='words of the driver') == 'words of the driver'
    assert task.explains('too fast')
    # A process that was stopped has all of its threads late, by the same time.
    assert task.run(late=0.04, elsewhere=0.045) == ''
    assert task.run(elsewhere=0.01) == f'{LOST} 0.05 s'


def test_it_explains_what_appears_meanwhile_and_not_what_was_there_before(task):
    assert not task.explains('bus-off')
    task.run(late=0.3)
    assert not task.explains('bus-off')
    assert task.explains('heartbeat lost')
    task.run(count=10)
    assert task.explains('two answers in one cycle')
    task.run(count=60)
    assert not task.explains('heartbeat lost')
    # What queued up in a long stop is read after it.
    task.run(late=0.3)
    assert task.explains('two answers in one cycle')
    task.run(late=60.0)
    assert task.explains('no frames')


def test_it_does_not_explain_what_stays(task):
    """On a machine that is always somewhat too busy, an encoder without power is no overload."""
    task.run(late=0.3)
    began = task.now
    found = []
    for number in range(400):
        task.run(late=0.06 if number % 10 == 0 else 0.0)
        found.append((task.now - began, task.explains(f'joint_1a silent {number // 20}')))
    assert all(explained for passed, explained in found if passed <= SECOND)
    assert not any(explained for passed, explained in found if passed > 1.5 * SECOND)
