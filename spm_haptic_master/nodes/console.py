# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live status of `master`: refreshed in place on a terminal, else one line per second."""

from __future__ import annotations

from contextlib import suppress
from math import degrees
import os
import sys
import threading
import time

from spm_haptic_master.kinematics import zxz_angles
from spm_haptic_master.nodes.diagnostic_status import ERROR, OK, WARN
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver
from spm_haptic_master.nodes.fkm import Fkm

# Refresh period on a terminal (s).
TERMINAL_PERIOD = 0.25
# Period of the lines where standard output is not a terminal (s).
LINE_PERIOD = 1.0
# Words for the levels of the singularity.
LEVEL_WORDS = {OK: 'OK', WARN: 'WARN', ERROR: 'ERROR'}
# Terminal controls (ECMA-48): to the beginning of the line N lines up; erase to the line's end.
UP = '\x1b[{}F'
ERASE = '\x1b[K'
# File descriptor of standard output.
STANDARD_OUTPUT = 1


class Console:
    """
    Prints the state of the three nodes of one process.

    It runs in a thread of its own and bypasses Python's buffers: a paused terminal or a closed
    pipe must not delay an orientation.

    Parameters
    ----------
    driver, fkm, diagnostics : EncoderDriver, Fkm, Diagnostics
        The nodes.

    """

    def __init__(self, driver: EncoderDriver, fkm: Fkm, diagnostics: Diagnostics) -> None:
        self._driver, self._fkm, self._diagnostics = driver, fkm, diagnostics
        self._in_place = sys.stdout.isatty()
        self._printed = 0
        threading.Thread(target=self._run, name='console', daemon=True).start()

    def _run(self) -> None:
        with suppress(OSError):  # the reader has closed the pipe
            while True:
                time.sleep(TERMINAL_PERIOD if self._in_place else LINE_PERIOD)
                text = (self._block() if self._in_place else ', '.join(self._parts())) + '\n'
                os.write(STANDARD_OUTPUT, text.encode())

    def _block(self) -> str:
        lines = [f'haptic master, source {self._driver.source_name} (Ctrl-C ends)',
                 *('  ' + part for part in self._parts())]
        up = UP.format(self._printed) if self._printed else ''
        self._printed = len(lines)
        return up + '\n'.join(line + ERASE for line in lines)

    def _parts(self) -> list[str]:
        return [self._orientation(), self._singularity(), self._rates(), self._latency()]

    def _orientation(self) -> str:
        fkm = self._fkm
        if fkm.quaternion is None or not fkm.state.startswith(('healthy', 'degraded')):
            reason = fkm.state if self._driver.state == 'publishing' else self._driver.state
            return f'no orientation: {reason}'
        psi, theta, phi = map(degrees, zxz_angles(*fkm.quaternion))
        level = degrees(fkm.protection_level or 0.0)
        return (f'psi {psi:8.3f} theta {theta:7.3f} phi {phi:8.3f} deg, '
                f'protection level {level:.2f} deg, {fkm.state}')

    def _singularity(self) -> str:
        diagnostics = self._diagnostics
        dexterities = diagnostics.dexterities
        if dexterities is None:
            return f'dexterity unknown: {diagnostics.state}'
        three, four = dexterities
        return (f'dexterity {three:.4f} (3 sensors) {four:.4f} (4 sensors) '
                f'{LEVEL_WORDS[diagnostics.level]} {diagnostics.state}')

    def _rates(self) -> str:
        rate = self._fkm.latency_status.published.rate()
        return f'joints {self._driver.rate:.0f} Hz orientation {rate:.0f} Hz'

    def _latency(self) -> str:
        percentiles = self._fkm.latency_status.latency.percentiles(0.5, 0.99)
        if percentiles is None:
            return 'latency unknown'
        return 'latency p50 {:.0f} us p99 {:.0f} us'.format(*percentiles)
