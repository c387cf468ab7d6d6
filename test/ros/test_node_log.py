# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes' log: what is printed, what is counted, and that nobody waits for it."""

import os
import time

from harness import full_pipe
import pytest
from rclpy.logging import get_logger, LoggingSeverity
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.node_log import Entry, NodeLog
from spm_haptic_master.standard_streams import LINES_WAITING, LineWriter

# Time that a busy machine may need (s).
PATIENCE = 20.0


class Lines:
    """A sink that keeps what it gets."""

    def __init__(self):
        self.lines = []

    def put(self, line):
        self.lines.append(line)

    def close(self, timeout):
        pass

    def texts(self):
        return [line.partition(']: ')[2] for line in self.lines]


def entry(text, severity=LoggingSeverity.ERROR, node='node_of_the_log'):
    return Entry(get_logger(node), severity, text)


def test_a_line_has_the_form_of_ros():
    sink = Lines()
    log = NodeLog(sink, coloured=False)
    log.put(entry('silent: stale sample'))
    log.put(entry('starting', LoggingSeverity.WARN))
    log.put(entry('healthy', LoggingSeverity.INFO))
    log.put(entry('not of interest', LoggingSeverity.DEBUG))
    log.close(PATIENCE)
    assert [line.split(' ')[0] for line in sink.lines] == ['[ERROR]', '[WARN]', '[INFO]']
    severity, stamp, rest = sink.lines[0].split(' ', 2)
    assert abs(float(stamp.strip('[]')) - time.time()) < PATIENCE
    assert rest == '[node_of_the_log]: silent: stale sample'


def test_a_line_that_comes_again_is_counted_until_the_end():
    sink = Lines()
    log = NodeLog(sink, coloured=False)
    for _ in range(40):
        log.put(entry('silent'))
        log.put(entry('healthy', LoggingSeverity.INFO))
    log.put(entry('silent', node='another_node'))
    log.close(PATIENCE)
    assert sink.texts() == ['silent', 'healthy', 'silent', 'silent (39 more times in 0 s)',
                            'healthy (39 more times in 0 s)']


def test_a_count_is_printed_before_what_comes_next():
    """Its line is older: the last line is the present."""
    sink = Lines()
    log = NodeLog(sink, coloured=False)
    for text in ('engaged', 'engaged', 'disengaged'):
        log.put(entry(text))
    assert wait_until(lambda: len(sink.lines) == 3, PATIENCE)
    assert [text.partition(' ')[0] for text in sink.texts()] == [
        'engaged', 'engaged', 'disengaged']
    log.close(PATIENCE)
    assert len(sink.lines) == 3


def test_without_a_console_nothing_is_printed():
    display = Lines()
    log = NodeLog(None, coloured=False)
    log.attach(display, takes_lines=True)
    log.put(entry('silent'))
    log.close(PATIENCE)
    assert display.lines == []


def test_a_display_takes_the_lines():
    console, display = Lines(), Lines()
    log = NodeLog(console, coloured=False)
    log.attach(display, takes_lines=True)
    log.put(entry('silent'))
    log.close(PATIENCE)
    assert (console.texts(), display.texts()) == ([], ['silent'])


@pytest.mark.parametrize(('args', 'printed'), [
    ([], True), (['--ros-args', '--disable-stdout-logs'], False),
    (['--ros-args', '--disable-stdout-logs', '--enable-stdout-logs'], True)])
def test_the_console_follows_the_ros_arguments(args, printed, capfd):
    node_log.begin(args)
    node_log._log.put(entry('a line of this test', node='node_of_the_arguments'))
    node_log.end(PATIENCE)
    lines = [line for line in capfd.readouterr().err.splitlines()
             if 'a line of this test' in line]
    # One is that of rclpy, whose console is on in this process.
    assert len(lines) == 1 + printed


@pytest.mark.parametrize(('changes', 'coloured'), [
    ({}, False), ({'RCUTILS_COLORIZED_OUTPUT': '1'}, True),
    ({'RCUTILS_COLORIZED_OUTPUT': '1', 'NO_COLOR': '1'}, False),
    ({'RCUTILS_COLORIZED_OUTPUT': '1', 'NO_COLOR': ''}, True)])
def test_colours_by_the_environment(changes, coloured, monkeypatch):
    for name in ('NO_COLOR', 'RCUTILS_COLORIZED_OUTPUT'):
        monkeypatch.delenv(name, raising=False)
    for name, value in changes.items():
        monkeypatch.setenv(name, value)
    with full_pipe() as (_, writing):
        assert node_log.is_coloured(writing) == coloured
    sink = Lines()
    log = NodeLog(sink, coloured=coloured)
    log.put(entry('silent'))
    log.close(PATIENCE)
    assert sink.lines[0].startswith('\x1b[31m[ERROR]' if coloured else '[ERROR]')


def test_lines_without_a_reader_are_lost_and_counted():
    with full_pipe() as (reading, writing):
        writer = LineWriter(writing)
        writer.put('first')  # the writer's thread waits with this one
        assert wait_until(lambda: writer._writing and not writer._lines, PATIENCE)
        began = time.monotonic()
        for number in range(LINES_WAITING + 7):
            writer.put(f'line {number}')
        writer.close(0.1)
        assert time.monotonic() - began < PATIENCE
        os.set_blocking(reading, False)
        got = b''

        def read():
            nonlocal got
            try:
                got += os.read(reading, 1 << 16)
            except BlockingIOError:
                pass
            return b'lost' in got

        assert wait_until(read, PATIENCE)
        lines = got.decode().lstrip('.').splitlines()
        assert lines[:2] == ['first', 'line 0']
        assert lines[-2:] == [f'line {LINES_WAITING - 1}',
                              '7 lines were lost here: they were not read in time']


def test_a_reader_that_has_gone_is_no_error():
    reading, writing = os.pipe()
    os.close(reading)
    writer = LineWriter(writing)
    writer.put('a line')
    writer.close(PATIENCE)
    writer.put('another')
    writer.close(PATIENCE)
    os.close(writing)
