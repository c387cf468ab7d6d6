# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lines that come again: what is printed when, on a clock of the test."""

import random

import pytest
from spm_haptic_master.ros.repeated_lines import Line, QUIET, REPEAT_PERIOD, RepeatedLines

INFO = 20


class Log:
    """What is printed of the lines, with the times."""

    def __init__(self):
        self.repeated = RepeatedLines()
        self.now = 1000.0
        self.printed = []

    def put(self, text, node='teleop'):
        self._print(self.repeated.take(node, Line(INFO, text), self.now))

    def run(self, seconds):
        """Let time pass as the thread of the log does."""
        end = self.now + seconds
        while (wait := self.repeated.wait(self.now)) is not None and self.now + wait <= end:
            self.now += wait
            self._print(self.repeated.due(self.now))
        self.now = end
        self._print(self.repeated.due(self.now))

    def _print(self, lines):
        self.printed += [(node, line.text + count) for node, line, count in lines]

    @property
    def texts(self):
        return [text for _, text in self.printed]


@pytest.fixture
def log():
    return Log()


def test_a_count_never_comes_after_a_newer_state(log):
    """The log that ended with 'engaged (1 more time in 10 s)', 4 s after 'disengaged'."""
    for text, pause in (('engaged', 3.0), ('engaged', 3.0), ('disengaged: no presence', 30.0)):
        log.put(text)
        log.run(pause)
    assert log.texts == ['engaged', 'engaged (1 more time in 6 s)', 'disengaged: no presence']


def test_a_state_that_came_back_is_printed_although_it_is_not_new(log):
    for text in ('engaged', 'disengaged', 'engaged'):
        log.put(text)
        log.run(2.0 * QUIET)
    assert log.texts == ['engaged', 'disengaged', 'engaged (1 more time in 5 s)']


def test_the_same_line_again_and_again_is_summed_up_once_a_period(log):
    for _ in range(21):
        log.put('silent')
        log.run(1.0)
    log.run(2.0 * REPEAT_PERIOD)
    assert log.texts == ['silent', 'silent (9 more times in 10 s)',
                         'silent (10 more times in 10 s)', 'silent (1 more time in 10 s)']


def test_after_a_period_without_it_a_line_is_new(log):
    log.put('silent')
    log.run(1.5 * REPEAT_PERIOD)
    log.put('silent')
    assert log.texts == ['silent', 'silent']


def test_a_state_that_flaps_is_summed_up(log):
    for _ in range(20 * 30):
        log.put('silent')
        log.put('healthy')
        log.run(0.05)
    assert len(log.printed) <= 2 * (1 + 30 / REPEAT_PERIOD)


def test_each_node_has_a_present_of_its_own(log):
    log.put('silent')
    log.put('silent')
    log.put('engaged', 'other')
    assert log.texts == ['silent', 'engaged']


@pytest.mark.parametrize('seed', range(20))
def test_after_a_pause_the_last_line_of_each_node_is_its_present(log, seed):
    generator = random.Random(seed)
    present, last, came, printed = {}, {}, {}, {'a': 0, 'b': 0}
    for number in range(1, 301):
        node, text = generator.choice('ab'), generator.choice('UVWXYZ')
        present[node] = text
        came[node, text] = number
        log.printed.clear()
        log.put(text, node)
        log.run(generator.choice([0.0, 0.1, 0.8, 3.0, 12.0]))
        quiet = generator.random() < 0.3
        if quiet:
            log.run(QUIET)
        for each, said in log.printed:
            # Nothing is printed after what came later.
            last[each] = said.split(' ')[0]
            now = came[each, last[each]]
            assert now >= printed[each]
            printed[each] = now
        if quiet:
            assert last == present
