# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Driver, forward model, diagnostics and teleop in one process, with a live status."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from math import degrees
import os
from textwrap import wrap
import threading
from typing import NamedTuple

from rclpy.node import Node
from rclpy.task import Future
from spm_haptic_master.drives.plan import check_shared_bus
from spm_haptic_master.force import Condition as ForceCondition
from spm_haptic_master.kinematics import zxz_angles
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver, PUBLISHING
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.nodes.orientation_status import LEVELS
from spm_haptic_master.nodes.teleop import Teleop
from spm_haptic_master.parameters.nodes import MASTER_SETTINGS
from spm_haptic_master.parameters.resolver import check_agreement
from spm_haptic_master.ros import node_log, runner
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, WARN
from spm_haptic_master.standard_streams import (
    LINES_WAITING,
    STANDARD_ERROR,
    STANDARD_OUTPUT,
    write_all,
)

# What a second master must not publish: it would silence the first.
OWNED = {'fkm': 'orientation', 'encoder_driver': 'measured_js'}
# Refresh period on a terminal (s).
TERMINAL_PERIOD = 0.25
# Period of the lines where standard output is not a terminal (s).
LINE_PERIOD = 1.0
# Columns of the names, with the space before them, and least columns of the values.
NAMES, LEAST = 20, 20
# Terminal controls (ECMA-48): colours and their end; erase below the cursor; move N lines up.
GREEN, AMBER, RED, PLAIN = '\x1b[32m', '\x1b[33m', '\x1b[31m', '\x1b[0m'
ERASE, UP = '\x1b[J', '\x1b[{}F'
LEVEL_COLOURS = {OK: GREEN, WARN: AMBER, ERROR: RED}
# Colours of the states of the force feedback; the others have none.
FORCE_COLOURS = {
    ForceCondition.ENGAGED: GREEN,
    ForceCondition.HOLDING: GREEN,
    ForceCondition.FADING: AMBER,
    ForceCondition.FAULT: RED,
}
# Dexterity of three sensors at which the bar is full, as on the page of `view` (unit 1), and the
# columns of the bar.
FULL_DEXTERITY, BAR = 0.2, 20
# Size of a terminal that does not report it (characters).
WIDTH, HEIGHT = 80, 24
# Trajectories of the simulation that cross the parallel singularity near phi = 50 deg; a remark.
CROSSING = ('fig9', 'perturbed', 'hand', 'tour')
CROSSING_REMARK = 'the simulated motion crosses the singularity on purpose'


class Row(NamedTuple):
    """A value of the status; a long one takes several lines."""

    name: str  # of the value; empty: the row continues the one above, and is in no log
    text: str  # value in words and digits, with its unit
    colour: str = ''


class Console:
    """
    Prints the state of three nodes: refreshed in place on a terminal, else one line per second.

    A thread of its own prints without Python's buffers: a paused terminal or a closed pipe must
    not delay an orientation. Lines of a log on the same terminal are printed above the status.
    """

    def __init__(self, driver: EncoderDriver, fkm: Fkm, diagnostics: Diagnostics) -> None:
        self._driver, self._fkm, self._diagnostics = driver, fkm, diagnostics
        self._in_place = os.isatty(STANDARD_OUTPUT) and os.environ.get('TERM') != 'dumb'
        self._coloured = node_log.is_coloured(STANDARD_OUTPUT)
        self._lines: deque[str] = deque(maxlen=LINES_WAITING)
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name='console', daemon=True)
        self._thread.start()
        if self._in_place:
            node_log.attach(
                self,
                takes_lines=os.isatty(STANDARD_ERROR)
                and os.fstat(STANDARD_ERROR).st_rdev == os.fstat(STANDARD_OUTPUT).st_rdev,
            )

    def put(self, line: str) -> None:
        """Have a line of the log printed above the status, without waiting."""
        with self._changed:
            self._lines.append(line)
            self._changed.notify()

    def close(self, timeout: float) -> None:
        """Print what is waiting and leave the cursor below the status, within `timeout` s."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(timeout)

    def _run(self) -> None:
        with suppress(OSError):  # the reader has closed the pipe
            if not self._in_place:
                write_all(STANDARD_OUTPUT, ': '.join(self._title()) + '\n')
            closing = False
            while not closing:
                with self._changed:
                    self._changed.wait_for(
                        lambda: self._lines or self._closing,
                        TERMINAL_PERIOD if self._in_place else LINE_PERIOD,
                    )
                    closing = self._closing
                    lines = list(self._lines)
                    self._lines.clear()
                write_all(
                    STANDARD_OUTPUT,
                    self._refreshed(lines, closing) if self._in_place else self._line(),
                )

    def _refreshed(self, lines: list[str], closing: bool) -> str:
        """Return what prints the log's lines and then the status, over the status before."""
        # The cursor stays on an empty line above the status: what other libraries print is not
        # written into it, and a terminal that becomes narrower and wraps lines keeps the cursor
        # above all of them.
        size = os.get_terminal_size(STANDARD_OUTPUT)
        # A terminal without a size, such as a serial line, reports 0.
        shown = status_lines(
            '\n  '.join(self._title()).splitlines(),
            self._rows(),
            size.columns or WIDTH,
            (size.lines or HEIGHT) - 1,
            self._coloured,
        )
        above = f'\r{ERASE}' + ''.join(line + '\r\n' for line in lines)
        if closing:
            return above + ''.join(line + '\r\n' for line in shown)
        return above + '\r\n'.join(['', *shown]) + (UP.format(len(shown)) if shown else '')

    def _title(self) -> list[str]:
        """Return the source, and a remark on its motion where there is one."""
        driver, source = self._driver, self._driver.source_name
        is_crossing = source == 'sim' and driver.get_parameter('sim.trajectory').value in CROSSING
        return [f'haptic master, source {source} (Ctrl-C ends)', *[CROSSING_REMARK] * is_crossing]

    def _line(self) -> str:
        rows = ', '.join(f'{row.name} {row.text}' for row in self._rows() if row.name)
        return f'source {self._driver.source_name}, {rows}\n'

    def _rows(self) -> list[Row]:
        driver, fkm, diagnostics = self._driver, self._fkm, self._diagnostics
        encoders, force = driver.state, fkm.force_state
        rows = [Row('state', fkm.state.text, LEVEL_COLOURS[LEVELS[fkm.state.condition]])]
        if fkm.status.caution:
            rows.append(Row('caution', fkm.status.caution, AMBER))
        if encoders not in ('', PUBLISHING):
            rows.append(Row('caution', f'encoders: {encoders}', AMBER))
        if force is not None:
            rows.append(Row('force', force.text, FORCE_COLOURS.get(force.condition, '')))
        if fkm.quaternion is not None and fkm.state.publishes:
            psi, theta, phi = map(degrees, zxz_angles(*fkm.quaternion))
            rows += [
                Row('orientation', f'psi {psi:8.3f} theta {theta:7.3f} phi {phi:8.3f} deg'),
                Row('protection level', f'{degrees(fkm.protection_level or 0.0):.2f} deg'),
                Row('parity', f'{fkm.latency_status.parity or 0.0:+.1f} sigma'),
            ]
        dexterities = diagnostics.dexterities
        if dexterities is None:
            rows.append(Row('singularity', f'unknown: {diagnostics.state}'))
        else:
            full = round(min(dexterities.three / FULL_DEXTERITY, 1.0) * BAR)
            rows += [
                Row('singularity', diagnostics.state, LEVEL_COLOURS[diagnostics.levels.level]),
                Row('', f'at [{"#" * full}{"-" * (BAR - full)}] far'),
                Row(
                    'dexterity',
                    f'{dexterities.three:.4f} (3 sensors), '
                    f'{dexterities.every:.4f} ({diagnostics.sensors} sensors)',
                ),
            ]
        latency = fkm.latency_status
        percentiles = latency.latency.percentiles(0.5, 0.99)
        return [
            *rows,
            Row(
                'rates',
                f'joints {driver.published.rate():.0f} Hz, '
                f'orientation {latency.published.rate():.0f} Hz',
            ),
            Row(
                'latency',
                'unknown'
                if percentiles is None
                else 'p50 {:.0f} us, p99 {:.0f} us'.format(*percentiles),
            ),
        ]


def status_lines(
    title: Iterable[str], rows: Iterable[Row], width: int, height: int, coloured: bool
) -> list[str]:
    """Return the lines of a status that a terminal shows: the title, and a column of values."""
    lines = [text[:width] for text in title]
    for name, text, colour in rows:
        # A control character would move the cursor.
        printable = ''.join(each if each.isprintable() else '?' for each in text)
        for part in wrap(printable, max(width - NAMES, LEAST), break_on_hyphens=False) or ['']:
            value = part[: max(0, width - NAMES)]
            if value and coloured and colour:
                value = f'{colour}{value}{PLAIN}'
            lines.append(f'  {name}'.ljust(NAMES)[:width] + value)
            name = ''
    return lines[:height]


def compose(done: Future, add: runner.AddNode) -> None:
    """Make and connect the nodes; the driver last, because it is destroyed first."""
    fkm = add(Fkm)
    teleop = add(Teleop) if fkm.declare(MASTER_SETTINGS)['teleop.run'] else None
    diagnostics, driver = add(Diagnostics), add(EncoderDriver, done)
    check_agreement(
        {
            node.get_name(): node.values
            for node in (driver, fkm, diagnostics, *([] if teleop is None else [teleop]))
        }
    )
    if fkm.force_state is not None and driver.source_name == 'can':
        check_shared_bus(fkm.values, driver.values)
    if _is_one_topic('measured_js', driver, fkm):
        driver.listener = fkm.take
    fkm.driver_overload = lambda: driver.overload.words
    # The command of a slave goes out first.
    fkm.followers = [
        each.take
        for each in (teleop, diagnostics)
        if each is not None and _is_one_topic('orientation', fkm, each)
    ]
    Console(driver, fkm, diagnostics)


def _is_one_topic(topic: str, publisher: Node, subscriber: Fkm | Diagnostics | Teleop) -> bool:
    """Return whether a plain call replaces a topic; subscribe where one of the two remaps it."""
    if publisher.resolve_topic_name(topic) == subscriber.resolve_topic_name(topic):
        return True
    subscriber.subscribe()
    return False


def main(args: list[str] | None = None) -> int:
    """Run the nodes as one process."""
    return runner.run('master', compose, args, OWNED)
