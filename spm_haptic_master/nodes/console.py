# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live status of `master`: refreshed in place on a terminal, else one line per second."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from math import degrees
import os
import threading

from spm_haptic_master.force import Condition as ForceCondition
from spm_haptic_master.kinematics import zxz_angles
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.nodes.status_rows import Colour, fitted, Row, status_lines, WIDE
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, WARN
from spm_haptic_master.standard_streams import (
    LINES_WAITING,
    STANDARD_ERROR,
    STANDARD_OUTPUT,
    write_all,
)
from spm_haptic_master.supervision.orientation_state import Condition, HEALTHY

# Refresh period on a terminal (s).
TERMINAL_PERIOD = 0.25
# Period of the lines where standard output is not a terminal (s).
LINE_PERIOD = 1.0
# Words for the levels of the singularity, and their colours.
LEVEL_WORDS = {OK: 'OK', WARN: 'WARN', ERROR: 'ERROR'}
LEVEL_COLOURS = {OK: Colour.GREEN, WARN: Colour.AMBER, ERROR: Colour.RED}
# Colours of the states of the force feedback.
FORCE_COLOURS = {
    ForceCondition.ENGAGED: Colour.GREEN, ForceCondition.HOLDING: Colour.GREEN,
    ForceCondition.FADING: Colour.AMBER, ForceCondition.FAULT: Colour.RED}
# Colours of the states of `fkm`.
STATE_COLOURS = {Condition.STARTING: Colour.AMBER, Condition.HEALTHY: Colour.GREEN,
                 Condition.DEGRADED: Colour.AMBER, Condition.SILENT: Colour.RED}
# Dexterity of three sensors from which the bar is full, as on the page of `view` (unit 1).
FULL_DEXTERITY = 0.2
# Size of a terminal that does not report it (characters).
WIDTH, HEIGHT = 80, 24
# Terminal controls (ECMA-48): erase from the cursor on; to the beginning of the line N lines up.
ERASE, UP = '\x1b[J', '\x1b[{}F'
# Trajectories of the simulation that cross the parallel singularity near phi = 50 deg.
CROSSING = ('fig9', 'perturbed', 'hand', 'tour')
# Remark on them.
CROSSING_REMARK = 'the simulated motion crosses the singularity on purpose'
# Orientation in a line, and where all three angles have to fit into 40 columns.
ANGLES = 'psi {:8.3f} theta {:7.3f} phi {:8.3f} deg'
SHORT_ANGLES = 'psi {:.1f} theta {:.1f} phi {:.1f} deg'
# Message of a driver without fault and caution.
PUBLISHING = 'publishing'


class Console:
    """
    Prints the state of the three nodes of one process.

    It runs in a thread of its own and bypasses Python's buffers: a paused terminal or a closed
    pipe must not delay an orientation. Where the log goes to the same terminal, its lines are
    printed here, above the status.
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
            node_log.attach(self, takes_lines=_is_same_terminal(STANDARD_OUTPUT, STANDARD_ERROR))

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
                write_all(STANDARD_OUTPUT, ': '.join(filter(None, self._title())) + '\n')
            closing = False
            while not closing:
                with self._changed:
                    self._changed.wait_for(
                        lambda: self._lines or self._closing,
                        TERMINAL_PERIOD if self._in_place else LINE_PERIOD)
                    closing = self._closing
                    lines = list(self._lines)
                    self._lines.clear()
                write_all(STANDARD_OUTPUT, self._refreshed(lines, closing) if self._in_place
                          else self._line())

    def _refreshed(self, lines: list[str], closing: bool) -> str:
        """Return what prints the log's lines and then the status, over the status before."""
        # The cursor stays at the beginning of an empty line above the status: what other libraries
        # print is not written into it, and a terminal that wraps lines anew when it becomes
        # narrower keeps the cursor above all of them.
        size = os.get_terminal_size(STANDARD_OUTPUT)
        # A terminal without a size, such as a serial line, reports 0.
        width, height = size.columns or WIDTH, size.lines or HEIGHT
        shown = status_lines(self._rows(width), width, height - 1, self._coloured)
        above = f'\r{ERASE}' + ''.join(line + '\r\n' for line in lines)
        if closing:
            return above + ''.join(line + '\r\n' for line in shown)
        return above + '\r\n'.join(['', *shown]) + (UP.format(len(shown)) if shown else '')

    def _title(self) -> tuple[str, str]:
        """Return source and remark: what a user should know of the angles."""
        driver = self._driver
        is_crossing = driver.source_name == 'sim' \
            and driver.get_parameter('sim.trajectory').value in CROSSING
        return (f'haptic master, source {driver.source_name} (Ctrl-C ends)',
                CROSSING_REMARK if is_crossing else '')

    def _line(self) -> str:
        """Return all in one line, for a log."""
        dexterities = self._diagnostics.dexterities
        if dexterities is None:
            singularity = f'dexterity unknown: {self._diagnostics.state}'
        else:
            singularity = (
                f'dexterity {dexterities.three:.4f} (3 sensors) {dexterities.every:.4f} '
                f'({self._diagnostics.sensors} sensors) '
                f'{LEVEL_WORDS[self._diagnostics.levels.level]} {self._diagnostics.state}')
        state, force = self._fkm.state, self._fkm.force_state
        is_degraded = state.publishes and state != HEALTHY
        return ', '.join((
            f'source {self._driver.source_name}', self._orientation(),
            *([f'protection level {self._level()}'] if self._is_oriented() else []),
            *([state.text] if is_degraded else []), *self._cautions(),
            *([] if force is None else [f'force {force.text}']),
            singularity, 'joints {:.0f} Hz orientation {:.0f} Hz'.format(*self._rates()),
            f'latency {self._latency(" ")}')) + '\n'

    def _rows(self, width: int) -> list[str | Row]:
        """Return the title, and the rows below it."""
        # The title breaks where it has a remark: both fit into 80 columns.
        title, remark = self._title()
        rows: list[str | Row] = [fitted(title, width)]
        if remark:
            rows.append(fitted(f'  {remark}', width))
        state = self._fkm.state
        rows.append(Row('state', state.text, STATE_COLOURS[state.condition]))
        rows += [Row('caution', text, Colour.AMBER) for text in self._cautions()]
        force = self._fkm.force_state
        if force is not None:
            rows.append(Row('force', force.text, FORCE_COLOURS.get(force.condition, Colour.NONE)))
        if self._is_oriented():
            wide = width >= WIDE
            parity = self._fkm.latency_status.parity or 0.0
            rows += [Row('orientation' if wide else '',
                         self._orientation(ANGLES if wide else SHORT_ANGLES)),
                     Row('protection level', self._level()),
                     Row('parity', f'{parity:+.1f} sigma')]
        diagnostics = self._diagnostics
        dexterities = diagnostics.dexterities
        if dexterities is None:
            rows.append(Row('singularity', f'unknown: {diagnostics.state}'))
        else:
            rows += [Row('singularity', diagnostics.state, LEVEL_COLOURS[diagnostics.levels.level],
                         dexterities.three / FULL_DEXTERITY),
                     Row('dexterity', f'{dexterities.three:.4f} (3 sensors), '
                         f'{dexterities.every:.4f} ({diagnostics.sensors} sensors)')]
        rates = 'joints {:.0f} Hz, orientation {:.0f} Hz'.format(*self._rates())
        return [*rows, Row('rates', rates), Row('latency', self._latency(', '))]

    def _is_oriented(self) -> bool:
        return self._fkm.quaternion is not None and self._fkm.state.publishes

    def _orientation(self, form: str = ANGLES) -> str:
        """Return the orientation, or why there is none."""
        quaternion, state = self._fkm.quaternion, self._fkm.state
        if quaternion is None or not state.publishes:
            return f'no orientation: {state.text}'
        return form.format(*map(degrees, zxz_angles(*quaternion)))

    def _level(self) -> str:
        return f'{degrees(self._fkm.protection_level or 0.0):.2f} deg'

    def _cautions(self) -> list[str]:
        """Return the cautions of fkm and driver."""
        encoders = self._driver.state
        cautions = []
        if self._fkm.state.publishes and self._fkm.status.caution:
            cautions.append(self._fkm.status.caution)
        if encoders not in ('', PUBLISHING):
            cautions.append(f'encoders: {encoders}')
        return cautions

    def _rates(self) -> tuple[float, float]:
        return self._driver.published.rate(), self._fkm.latency_status.published.rate()

    def _latency(self, separator: str) -> str:
        percentiles = self._fkm.latency_status.latency.percentiles(0.5, 0.99)
        return 'unknown' if percentiles is None else \
            separator.join(('p50 {:.0f} us', 'p99 {:.0f} us')).format(*percentiles)


def _is_same_terminal(one: int, other: int) -> bool:
    """Return whether two descriptors are of one terminal."""
    return os.isatty(one) and os.isatty(other) and os.fstat(one).st_rdev == os.fstat(other).st_rdev
