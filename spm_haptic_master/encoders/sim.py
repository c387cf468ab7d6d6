"""Simulated encoders: a trajectory through the inverse model, with noise and quantisation."""

from __future__ import annotations

import random
import time

from spm_haptic_master.encoders.layout import angle_from_counts, counts_from_angle
from spm_haptic_master.encoders.pacing import Grid
from spm_haptic_master.encoders.sample import EncoderSource, JointSample
from spm_haptic_master.encoders.trajectories import Trajectory
from spm_haptic_master.kinematics import Geometry, inverse_angles, zxz_rotation

PUNCTUAL = 2e-4
"""
s after its deadline that a sample prepared for it still counts.

A joint at 1 rad/s moves by half a count of 14 bits meanwhile. An encoder has its angle at once, a
simulation should not delay the sample by computing it.
"""


class NoisyMotion:
    """
    What four sensors without quantisation measure on a master that moves by itself.

    Parameters
    ----------
    trajectory : callable
        Time in s to (psi, theta, phi) in rad.
    noise : float
        Standard deviation of each sensor, rad.
    seed : int
        Of the noise: the same seed gives the same noise.
    geometry : Geometry
        Of the manipulator.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.

    """

    def __init__(self, trajectory: Trajectory, noise: float, seed: int, geometry: Geometry,
                 working_mode: tuple[int, int, int]):
        self._trajectory = trajectory
        self._noise = noise
        self._gauss = random.Random(seed).gauss
        self._geometry = geometry
        self._working_mode = working_mode

    def angles(self, t: float) -> tuple[float, float, float, float]:
        """Return th1A, th1B, th1C, th3A with noise, rad, `t` seconds into the motion."""
        th1a, th1b, th1c, _, th3a = inverse_angles(
            zxz_rotation(*self._trajectory(t)), self._geometry, self._working_mode)
        gauss, noise = self._gauss, self._noise
        return (th1a + gauss(0.0, noise), th1b + gauss(0.0, noise),
                th1c + gauss(0.0, noise), th3a + gauss(0.0, noise))


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
        self._grid = Grid(self._period)
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
