"""Simulated encoders: a trajectory through the inverse model, with noise and quantisation."""

from __future__ import annotations

import random
import time

from spm_haptic_master.encoders.layout import angle_from_counts, counts_from_angle
from spm_haptic_master.encoders.pacing import Grid
from spm_haptic_master.encoders.sample import EncoderSource, JointSample
from spm_haptic_master.encoders.trajectories import Trajectory
from spm_haptic_master.kinematics import Geometry, inverse_angles, zxz_rotation


class SimSource(EncoderSource):
    """
    Four encoders on a master that moves by itself.

    Parameters
    ----------
    trajectory : callable
        Time in s to (psi, theta, phi) in rad.
    rate : float
        Samples a second.
    noise : float
        Standard deviation of each sensor, rad.
    counts_per_turn : sequence of 4 int
        Quantisation of each sensor.
    seed : int
        Of the noise: the same seed gives the same noise.
    geometry : Geometry
        Of the manipulator.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.

    """

    def __init__(self, trajectory: Trajectory, rate: float, noise: float,
                 counts_per_turn: tuple[int, ...], seed: int, geometry: Geometry,
                 working_mode: tuple[int, int, int]):
        self._trajectory = trajectory
        self._noise = noise
        self._counts_per_turn = counts_per_turn
        self._gauss = random.Random(seed).gauss
        self._geometry = geometry
        self._working_mode = working_mode
        self._grid = Grid(1.0 / rate)
        self._began: int | None = None
        self._sets = 0

    def read(self, timeout: float) -> JointSample | None:
        """Return the sample of the next grid time, taken when the thread really woke."""
        if not self._grid.wait(timeout):
            return None
        stamp = time.time_ns()
        if self._began is None:
            self._began = stamp
        self._sets += 1
        return JointSample(stamp, self.angles((stamp - self._began) * 1e-9))

    def angles(self, t: float) -> tuple[float, float, float, float]:
        """Return what the four sensors say `t` seconds into the motion, rad."""
        th1a, th1b, th1c, _, th3a = inverse_angles(
            zxz_rotation(*self._trajectory(t)), self._geometry, self._working_mode)
        return tuple(
            angle_from_counts(
                counts_from_angle(angle + self._gauss(0.0, self._noise), 0, 1, per_turn),
                0, 1, per_turn)
            for angle, per_turn in zip(
                (th1a, th1b, th1c, th3a), self._counts_per_turn, strict=True))

    @property
    def fault(self) -> str | None:
        """Simulated encoders do not fail."""
        return None

    def statistics(self) -> dict[str, object]:
        """Return the sets made and the deadlines missed."""
        return {'sets': self._sets, 'missed deadlines': self._grid.missed}
