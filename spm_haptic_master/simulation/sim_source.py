# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated encoders: a trajectory through the inverse model, with noise and quantisation."""

from __future__ import annotations

import time

from spm_haptic_master.encoders.deadline_grid import DeadlineGrid
from spm_haptic_master.encoders.encoder_layout import angle_from_counts, counts_from_angle
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.simulation.noisy_motion import NoisyMotion

PUNCTUAL = 2e-4
"""
s after its deadline that a sample prepared for it still counts.

A joint at 1 rad/s moves by half a count of 14 bits meanwhile. An encoder has its angle at once, a
simulation should not delay the sample by computing it.
"""


class SimSource(EncoderSource):
    """
    Four encoders on a master that moves by itself.

    Parameters
    ----------
    motion : NoisyMotion
        What the sensors measure.
    rate : float
        Samples a second.
    counts_per_turn : sequence of 4 int
        Quantisation of each sensor.

    """

    def __init__(self, motion: NoisyMotion, rate: float, counts_per_turn: tuple[int, ...]):
        self._motion = motion
        self._counts_per_turn = counts_per_turn
        self._period = 1.0 / rate
        self._grid = DeadlineGrid(self._period)
        self._began: int | None = None
        self._sets = 0
        # What the sensors say at the next deadline, s into the motion; made while there is time.
        self._due = 0.0
        self._prepared: tuple[float, float, float, float] | None = None

    def read(self, timeout: float) -> JointSample | None:
        """Return the sample of the next grid time, taken when the thread really woke."""
        if self._prepared is None:
            self._prepared = self.angles(self._due)
        if not self._grid.wait(timeout):
            return None
        stamp = time.time_ns()
        if self._began is None:
            self._began = stamp
        self._sets += 1
        t, lateness = (stamp - self._began) * 1e-9, self._grid.lateness
        angles = self._prepared if lateness <= PUNCTUAL else self.angles(t)
        self._due = t - lateness % self._period + self._period
        self._prepared = None
        return JointSample(stamp, angles)

    def angles(self, t: float) -> tuple[float, float, float, float]:
        """Return what the four sensors say `t` seconds into the motion, rad."""
        return tuple(
            angle_from_counts(counts_from_angle(angle, 0, 1, per_turn), 0, 1, per_turn)
            for angle, per_turn in zip(
                self._motion.angles(t), self._counts_per_turn, strict=True))

    @property
    def fault(self) -> str | None:
        """Simulated encoders do not fail."""
        return None

    def statistics(self) -> dict[str, object]:
        """Return the sets made and the deadlines missed."""
        return {'sets': self._sets, 'missed deadlines': self._grid.missed}
