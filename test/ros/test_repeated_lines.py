# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lines that come again: what is printed when, on a clock of the test."""

from math import inf
import random

import pytest
from spm_haptic_master.ros.repeated_lines import QUIET, REPEAT_PERIOD, RepeatedLines


class Log:
    """What is printed of the lines of a node."""

    def __init__(self):
        self.lines = RepeatedLines()
        self.now = 1000.0
        self.printed = []

    def put(self, text, pause=0.0):
        """Put a line, and let time pass as the thread of the log does."""
        self._print(self.lines.take((20, text), self.now))
        end = self.now + pause
        while (due := self.lines.due_at()) <= end:
            assert due >= self.now
            self.now = due
            self._print(self.lines.due(self.now))
        self.now = end
        self._print(self.lines.due(self.now))

    def _print(self, lines):
        self.printed += [text for severity, text in lines if severity == 20]


@pytest.mark.parametrize(('given', 'printed'), [
    # A count never comes after a newer state.
    ([('engaged', 3.0), ('engaged', 3.0), ('disengaged: no presence', 30.0)],
     ['engaged', 'engaged (1 more time in 6 s)', 'disengaged: no presence']),
    # A state that came back is printed although it is not new.
    ([(text, 2.0 * QUIET) for text in ('engaged', 'disengaged', 'engaged')],
     ['engaged', 'disengaged', 'engaged (1 more time in 5 s)']),
    # A line that comes again and again is summed up once a period.
    ([*[('silent', 1.0)] * 21, ('silent', 2.0 * REPEAT_PERIOD)],
     ['silent', 'silent (9 more times in 10 s)', 'silent (10 more times in 10 s)',
      'silent (2 more times in 10 s)']),
    # After a period without it a line is new.
    ([('silent', 1.5 * REPEAT_PERIOD), ('silent', 0.0)], ['silent', 'silent'])])
def test_a_line_that_comes_again_is_counted_and_the_present_comes_last(given, printed):
    log = Log()
    assert log.lines.due_at() == inf
    for text, pause in given:
        log.put(text, pause)
    assert log.printed == printed


def test_a_state_that_flaps_is_summed_up():
    log = Log()
    for _ in range(20 * 30):
        log.put('silent')
        log.put('healthy', 0.05)
    assert len(log.printed) <= 2 * (1 + 30 / REPEAT_PERIOD)


@pytest.mark.parametrize('seed', range(20))
def test_after_a_pause_the_last_line_is_the_present(seed):
    generator = random.Random(seed)
    log, came, printed = Log(), {}, 0
    for number in range(1, 301):
        text = generator.choice('UVWXYZ')
        came[text] = number
        log.printed.clear()
        quiet = generator.random() < 0.3
        log.put(text, generator.choice([0.0, 0.1, 0.8, 3.0, 12.0]) + (QUIET if quiet else 0.0))
        for each in log.printed:
            # Nothing is printed after what came later.
            last = each.split(' ')[0]
            assert came[last] >= printed
            printed = came[last]
        if quiet:
            assert last == text
