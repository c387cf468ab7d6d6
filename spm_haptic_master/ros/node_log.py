# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The nodes' log: to the console, to /rosout and to ROS's log file, from a thread of its own.

rclpy logs in the calling thread and holds the interpreter's lock: where nobody reads stderr, the
process would stop. Therefore rclpy starts without its console, and nodes put lines into a queue.
Repeated lines are counted; counts are printed before any newer line: the last line is the present.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from math import inf
import os
from queue import Empty, Full, Queue
import threading
import time

from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from spm_haptic_master.standard_streams import LineWriter, STANDARD_ERROR

# Lines in the queue, minutes of a node in trouble; later ones are lost.
QUEUE_LENGTH = 1000
CONSOLE = '--enable-stdout-logs'
NO_CONSOLE = '--disable-stdout-logs'
# Colours of a line on a terminal (ECMA-48), as rcutils has them.
COLOURS = {
    LoggingSeverity.WARN: '\x1b[33m',
    LoggingSeverity.ERROR: '\x1b[31m',
}
COLOUR_END = '\x1b[0m'
# Time in which a line that comes again is counted and not repeated (s).
REPEAT_PERIOD = 10.0
# Quiet time after which the counts of a still-current line are printed (s).
QUIET = 1.0

Line = tuple[int, str]  # severity, text


class RepeatedLines:
    """
    Which lines of a node are printed now, and which are counted.

    A line that comes again within `REPEAT_PERIOD` is counted; counts are printed before a newer
    line, so that the last line is the present. Times are s on a clock that is never set.
    """

    def __init__(self) -> None:
        # When each line was printed, and how often it came since; in the order of the last ones.
        self._lines: dict[Line, tuple[float, int]] = {}
        # When the latest line came (s).
        self._last = -inf
        # The line that was printed last.
        self._printed: Line | None = None

    def take(self, line: Line, now: float) -> list[Line]:
        """Take a line and return the lines to print now, in order."""
        printed = self.due(now)
        if line in self._lines:
            since, count = self._lines.pop(line)
            self._lines[line] = since, count + 1
        else:
            printed += self.counts(now)
            printed.append(line)
            self._lines[line] = now, 0
            self._printed = line
        self._last = now
        return printed

    def due(self, now: float) -> list[Line]:
        """Return the lines to print now although none has come."""
        printed: list[Line] = []
        if now >= self.due_at():
            printed = self.counts(now)
        kept = {}
        for line, (since, count) in self._lines.items():
            if count or now - since < REPEAT_PERIOD:
                kept[line] = (since, count)
        self._lines = kept
        return printed

    def due_at(self) -> float:
        """Return the time at which the counts are to be printed; infinity without a count."""
        counted = [since for since, count in self._lines.values() if count]
        if not counted:
            return inf
        due = min(counted) + REPEAT_PERIOD
        # The line that came last is the present. It is printed last already, or soon.
        present = next(reversed(self._lines))
        if present == self._printed:
            return due
        return min(due, self._last + QUIET)

    def counts(self, now: float) -> list[Line]:
        """Return the counted lines with their counts, and begin to count them again."""
        printed: list[Line] = []
        for line, (since, count) in self._lines.items():
            if not count:
                continue
            severity, text = line
            times = 'time' if count == 1 else 'times'
            elapsed = now - since
            printed.append((severity, f'{text} ({count} more {times} in {elapsed:.0f} s)'))
            self._lines[line] = now, 0
            self._printed = line
        return printed


class NodeLog:
    """
    Logs lines from a queue, in a thread of its own.

    Parameters
    ----------
    console : LineWriter or None
        Prints the lines; None where the user wants no console.

    """

    def __init__(self, console: LineWriter | None) -> None:
        self._console = console
        self._coloured = is_coloured(STANDARD_ERROR)
        self._queue: Queue[tuple[RcutilsLogger, Line] | None] = Queue(QUEUE_LENGTH)
        self._nodes: defaultdict[RcutilsLogger, RepeatedLines] = defaultdict(RepeatedLines)
        self._thread = threading.Thread(target=self._run, name='log', daemon=True)
        self._thread.start()

    def put(
        self,
        logger: RcutilsLogger,
        severity: LoggingSeverity,
        text: str,
    ) -> None:
        """Queue a line without waiting; it is lost if the queue is full."""
        with suppress(Full):
            self._queue.put_nowait((logger, (severity, text)))

    def close(self, timeout: float) -> None:
        """Log the queued lines and end, within about `timeout` s."""
        end = time.monotonic() + timeout
        try:
            self._queue.put(None, timeout=timeout)
        except Full:
            return
        self._thread.join(end - time.monotonic())
        if self._console is not None:
            left = max(0.0, end - time.monotonic())
            self._console.close(left)

    def _run(self) -> None:
        """Log lines as they come and counts when they are due, until the end is queued."""
        while True:
            now = time.monotonic()
            for logger, repeated in self._nodes.items():
                self._log(logger, repeated.due(now))
            times = [repeated.due_at() for repeated in self._nodes.values()]
            due = min(times, default=inf)
            timeout = None
            if due < inf:
                timeout = due - now
            try:
                entry = self._queue.get(timeout=timeout)
            except Empty:
                continue
            now = time.monotonic()
            if entry is None:
                break
            logger, line = entry
            self._log(logger, self._nodes[logger].take(line, now))
        for logger, repeated in self._nodes.items():
            self._log(logger, repeated.counts(now))

    def _log(self, logger: RcutilsLogger, lines: list[Line]) -> None:
        """Log lines by rclpy, and print them as rcutils would, if their level is enabled."""
        for number, text in lines:
            severity = LoggingSeverity(number)
            if not logger.is_enabled_for(severity):
                continue
            write(logger, severity, text)
            if self._console is not None:
                line = f'[{severity.name}] [{time.time():.9f}] [{logger.name}]: {text}'
                if self._coloured and severity in COLOURS:
                    line = COLOURS[severity] + line + COLOUR_END
                self._console.put(line)


def write(
    logger: RcutilsLogger,
    severity: LoggingSeverity,
    text: str,
) -> None:
    """Log a line by rclpy, in the calling thread."""
    # rclpy requires that each severity is logged from a line of its own.
    if severity == LoggingSeverity.ERROR:
        logger.error(text)
    elif severity == LoggingSeverity.WARN:
        logger.warning(text)
    else:
        logger.info(text)


_log: NodeLog | None = None  # of this process, between `begin` and `end`


def begin(args: Sequence[str]) -> None:
    """Begin the log of this process, whose ROS arguments are `args`."""
    global _log
    chosen = [argument for argument in args if argument in (CONSOLE, NO_CONSOLE)]
    console = None
    # The last of them counts, as in rcl.
    if not chosen or chosen[-1] == CONSOLE:
        console = LineWriter(STANDARD_ERROR)
    _log = NodeLog(console)


def end(timeout: float) -> None:
    """Log the queued lines, within about `timeout` s; from now on nodes log by rclpy."""
    global _log
    log = _log
    _log = None
    if log is not None:
        log.close(timeout)


def is_coloured(descriptor: int) -> bool:
    """Return whether output to a descriptor may have colours (no-color.org, rcutils)."""
    wanted = os.environ.get('RCUTILS_COLORIZED_OUTPUT')
    if os.environ.get('NO_COLOR') or wanted == '0':
        return False
    if wanted == '1':
        return True
    return os.isatty(descriptor) and os.environ.get('TERM') != 'dumb'


def _put(
    severity: LoggingSeverity,
    node: Node,
    text: str,
) -> None:
    """Log a line of a node; by rclpy itself in another program's process, which has no log."""
    logger = node.get_logger()
    if _log is None:
        write(logger, severity, text)
    else:
        _log.put(logger, severity, text)


# Log a line of a node: error(node, text).
error = partial(_put, LoggingSeverity.ERROR)
warning = partial(_put, LoggingSeverity.WARN)
info = partial(_put, LoggingSeverity.INFO)
