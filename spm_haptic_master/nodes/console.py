# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The line a second that `master` prints: state, orientation, singularity, rates, latency."""

from __future__ import annotations

from contextlib import suppress
from math import degrees
import threading
import time

from spm_haptic_master.kinematics import zxz_angles
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver, PUBLISHING
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.standard_streams import STANDARD_OUTPUT, write_all

# Period of the lines (s).
LINE_PERIOD = 1.0
# Trajectories of the simulation that cross the parallel singularity near phi = 50 deg.
CROSSING = ('fig9', 'perturbed', 'hand', 'tour')
CROSSING_REMARK = 'the simulated motion crosses the singularity on purpose'


class Console:
    """
    Prints the state of driver, `fkm` and `diagnostics` on standard output, one line a second.

    A thread of its own prints without Python's buffers: a paused terminal or a closed pipe must
    not delay an orientation.

    Parameters
    ----------
    driver : EncoderDriver
        Has the source and the state of the encoders.
    fkm : Fkm
        Has the orientation, its state, and that of the force feedback.
    diagnostics : Diagnostics
        Has the dexterities.

    """

    def __init__(
        self,
        driver: EncoderDriver,
        fkm: Fkm,
        diagnostics: Diagnostics,
    ) -> None:
        self._driver = driver
        self._fkm = fkm
        self._diagnostics = diagnostics

    def start(self) -> None:
        """Print from now on, until the process ends."""
        threading.Thread(target=self._run, name='console', daemon=True).start()

    def _run(self) -> None:
        """Write the title, then a line each period, until nobody reads."""
        with suppress(OSError):  # the reader has closed the pipe
            write_all(STANDARD_OUTPUT, f'{self.title()}\n')
            while True:
                time.sleep(LINE_PERIOD)
                write_all(STANDARD_OUTPUT, f'{self.line()}\n')

    def title(self) -> str:
        """Return the first line: the source, and a remark on its motion where there is one."""
        source = self._driver.source_name
        title = f'haptic master, source {source} (Ctrl-C ends)'
        if source != 'sim':
            return title
        trajectory = self._driver.get_parameter('sim.trajectory').value
        return f'{title}: {CROSSING_REMARK}' if trajectory in CROSSING else title

    def line(self) -> str:
        """
        Return what the nodes report now, as names and values in one line.

        Returns
        -------
        str
            Entries separated by commas; characters that cannot be printed are question marks.

        """
        entries = [
            f'source {self._driver.source_name}',
            *self._states(),
            *self._orientation(),
            *self._singularity(),
            *self._timing(),
        ]
        # A control character would move the cursor.
        text = ', '.join(entries)
        return ''.join(character if character.isprintable() else '?' for character in text)

    def _states(self) -> list[str]:
        """Return the states of orientation, encoders and force, and what they warn of."""
        entries = [f'state {self._fkm.state.text}']
        if self._fkm.status.caution:
            entries.append(f'caution {self._fkm.status.caution}')
        encoders = self._driver.state
        if encoders not in ('', PUBLISHING):
            entries.append(f'caution encoders: {encoders}')
        force = self._fkm.force_state
        if force is not None:
            entries.append(f'force {force.text}')
        return entries

    def _orientation(self) -> list[str]:
        """
        Return the latest orientation and how certain it is; nothing in silence.

        Returns
        -------
        list of str
            ZXZ angles and protection level, deg, and parity, standard deviations.

        """
        fkm = self._fkm
        if fkm.quaternion is None or not fkm.state.publishes:
            return []
        psi, theta, phi = map(degrees, zxz_angles(*fkm.quaternion))
        return [
            f'orientation psi {psi:8.3f} theta {theta:7.3f} phi {phi:8.3f} deg',
            f'protection level {degrees(fkm.protection_level or 0.0):.2f} deg',
            f'parity {fkm.latency_status.parity or 0.0:+.1f} sigma',
        ]

    def _singularity(self) -> list[str]:
        """Return how close the nearest singularity is."""
        diagnostics = self._diagnostics
        dexterities = diagnostics.dexterities
        if dexterities is None:
            return [f'singularity unknown: {diagnostics.state}']
        return [
            f'singularity {diagnostics.state}',
            f'dexterity {dexterities.three:.4f} (3 sensors)',
            f'{dexterities.every:.4f} ({diagnostics.sensors} sensors)',
        ]

    def _timing(self) -> list[str]:
        """Return rates, Hz, and percentiles of the time from sample to publication, us."""
        status = self._fkm.latency_status
        percentiles = status.latency.percentiles(0.5, 0.99)
        latency = 'latency unknown'
        if percentiles is not None:
            half, most = percentiles
            latency = f'latency p50 {half:.0f} us, p99 {most:.0f} us'
        return [
            f'rates joints {self._driver.published.rate():.0f} Hz',
            f'orientation {status.published.rate():.0f} Hz',
            latency,
        ]
