# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes' log: what is printed, what is counted, and that nobody waits for it."""

from collections import Counter
from contextlib import suppress
from math import inf
import os
import random
import re
import threading
import time
from types import SimpleNamespace

from benchmarks.pipeline.child_process import wait_until
from harness import full_pipe
import pytest
from rclpy.logging import get_logger, LoggingSeverity
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.node_log import NodeLog, QUIET, REPEAT_PERIOD, RepeatedLines
from spm_haptic_master.standard_streams import LINES_WAITING, LineWriter

# Time that a busy machine may need (s).
PATIENCE = 20.0
LOGGER = get_logger('node_of_the_log')
NODE = SimpleNamespace(get_logger=lambda: LOGGER)


class Lines:
    """A sink that keeps what it gets, once it may take it."""

    def __init__(self):
        self.lines = []
        self.taking = threading.Lock()

    def put(self, line):
        with self.taking:
            self.lines.append(line)

    def close(self, timeout):
        assert 0.0 <= timeout <= PATIENCE
        self.lines.append('closed')

    def texts(self):
        """Return the lines without what is before them, and without times."""
        return [re.sub(r'.*\]: | in \d+ s', '', line) for line in self.lines]


@pytest.fixture
def sink():
    return Lines()


def put(log, text, severity=LoggingSeverity.ERROR, node=LOGGER):
    log.put(node, severity, text)


def test_lines_are_counted_for_each_node_and_counts_come_although_nothing_else_does(
    sink, monkeypatch
):
    monkeypatch.setattr(node_log, 'REPEAT_PERIOD', 0.2)
    log = NodeLog(sink)
    another = get_logger('another')
    for node in (LOGGER, LOGGER, another):
        put(log, 'silent', node=node)
    assert wait_until(lambda: len(sink.lines) == 3, PATIENCE)
    for _ in range(2):
        put(log, 'healthy')
    log.close(PATIENCE)
    assert sink.texts() == [
        'silent',
        'silent',
        'silent (1 more time)',
        'healthy',
        'healthy (1 more time)',
        'closed',
    ]


def test_a_log_without_a_console_prints_nothing_and_ends():
    log = NodeLog(None)
    put(log, 'silent')
    log.close(PATIENCE)
    assert not log._thread.is_alive()


def test_a_log_that_nobody_ends_keeps_no_process_alive(sink):
    NodeLog(sink)
    LineWriter(2)
    assert {
        thread.daemon for thread in threading.enumerate() if thread.name in ('log', 'lines')
    } == {True}


def test_lines_beyond_the_queue_are_lost_and_nobody_waits(sink, monkeypatch):
    monkeypatch.setattr(node_log, 'QUEUE_LENGTH', 1)
    log = NodeLog(sink)
    with sink.taking:
        for number in range(100):
            put(log, f'line {number}')
    log.close(PATIENCE)
    assert 1 < len(sink.texts()) < 100


@pytest.mark.parametrize(
    ('args', 'printed'),
    [
        ([], True),
        (['--ros-args', '--disable-stdout-logs'], False),
        (['--ros-args', '--disable-stdout-logs', '--enable-stdout-logs'], True),
    ],
)
def test_the_console_follows_the_ros_arguments(args, printed, capfd):
    node_log.begin(args)
    for name in ('error', 'warning', 'info'):
        getattr(node_log, name)(NODE, f'{name} of this test')
    node_log.end(PATIENCE)
    node_log.info(NODE, 'after the end')
    found = re.findall(r'\[(\w+)\].*: (\w+) of this test', capfd.readouterr().err)
    # One of each is that of rclpy, whose console is on in this process.
    assert Counter(found) == dict.fromkeys(
        [('ERROR', 'error'), ('WARN', 'warning'), ('INFO', 'info')], 1 + printed
    )


@pytest.mark.parametrize(
    ('environment', 'coloured'),
    [
        ({}, True),
        ({'TERM': 'dumb'}, False),
        ({'RCUTILS_COLORIZED_OUTPUT': '0'}, False),
        ({'TERM': 'dumb', 'RCUTILS_COLORIZED_OUTPUT': '1'}, True),
        ({'NO_COLOR': ''}, True),
        ({'RCUTILS_COLORIZED_OUTPUT': '1', 'NO_COLOR': '1'}, False),
    ],
)
def test_a_line_has_the_form_and_on_a_terminal_the_colours_of_ros(
    sink, environment, coloured, monkeypatch
):
    with monkeypatch.context() as changed, open(os.openpty()[1], 'w') as terminal:
        changed.setattr(os, 'environ', environment)
        changed.setattr(node_log, 'STANDARD_ERROR', terminal.fileno())
        log = NodeLog(sink)
    # Debug is below the level of the logger.
    for name in 'ERROR', 'WARN', 'INFO', 'DEBUG':
        put(log, 'silent', getattr(LoggingSeverity, name))
    log.close(PATIENCE)
    assert abs(float(sink.lines[2].split(' ')[1].strip('[]')) - time.time()) < PATIENCE
    red, yellow, end = ('\x1b[31m', '\x1b[33m', '\x1b[0m') if coloured else ('', '', '')
    assert [re.sub(r'\[\d+\.\d{9}\]', 'TIME', line) for line in sink.lines] == [
        f'{red}[ERROR] TIME [node_of_the_log]: silent{end}',
        f'{yellow}[WARN] TIME [node_of_the_log]: silent{end}',
        '[INFO] TIME [node_of_the_log]: silent',
        'closed',
    ]


def test_lines_without_a_reader_are_lost_and_counted():
    with full_pipe() as (reading, writing):
        writer = LineWriter(writing)
        writer.put('first')  # the writer's thread waits with this one
        assert wait_until(lambda: writer._writing and not writer._lines, PATIENCE)
        for number in range(LINES_WAITING + 7):
            writer.put(f'line {number}')
        writer.close(0.1)
        os.set_blocking(reading, False)
        got = bytearray()

        def read():
            with suppress(BlockingIOError):
                got.extend(os.read(reading, 1 << 16))
            return b'time\n' in got

        assert wait_until(read, PATIENCE)
        assert got.decode().lstrip('.').splitlines() == [
            'first',
            *(f'line {number}' for number in range(LINES_WAITING)),
            '7 lines were lost here: they were not read in time',
        ]


def test_a_reader_that_has_gone_is_no_error():
    reading, writing = os.pipe()
    os.close(reading)
    writer = LineWriter(writing)
    for line in ('a line', 'another'):
        writer.put(line)
        writer.close(PATIENCE)
    os.close(writing)


class Printed:
    """What is printed of the lines of a node, on a clock of the test."""

    def __init__(self):
        self.lines = RepeatedLines()
        self.now = 1000.0
        self.printed = []

    def put(self, text, pause=0.0):
        """Put a line, and let time pass as the thread of the log does."""
        found = self.lines.take((20, text), self.now)
        end = self.now + pause
        while (due := min(self.lines.due_at(), end)) < end:
            assert due >= self.now
            self.now = due
            found += self.lines.due(self.now)
        self.now = end
        found += self.lines.due(self.now)
        self.printed += [text for severity, text in found if severity == 20]


@pytest.mark.parametrize(
    ('given', 'printed'),
    [
        # A state that came back is printed although it is not new.
        (
            [(text, 2.0 * QUIET) for text in ('engaged', 'disengaged', 'engaged')],
            ['engaged', 'disengaged', 'engaged (1 more time in 5 s)'],
        ),
        # A line that comes again and again is summed up once a period.
        (
            [*[('silent', 1.0)] * 21, ('silent', 2.0 * REPEAT_PERIOD)],
            [
                'silent',
                'silent (9 more times in 10 s)',
                'silent (10 more times in 10 s)',
                'silent (2 more times in 10 s)',
            ],
        ),
        # After a period without it a line is new.
        ([('silent', 1.5 * REPEAT_PERIOD), ('silent', 0.0)], ['silent', 'silent']),
    ],
)
def test_a_line_that_comes_again_is_counted_and_the_present_comes_last(given, printed):
    log = Printed()
    assert log.lines.due_at() == inf
    for text, pause in given:
        log.put(text, pause)
    assert log.printed == printed


@pytest.mark.parametrize('seed', range(6))
def test_after_a_pause_the_last_line_is_the_present(seed):
    generator = random.Random(seed)
    log = Printed()
    for _ in range(300):
        text = generator.choice('UVWXYZ')
        quiet = generator.random() < 0.3
        log.put(text, generator.choice([0.0, 0.1, 0.8, 3.0, 12.0]) + (QUIET if quiet else 0.0))
        if quiet:
            assert log.printed[-1].split(' ')[0] == text
