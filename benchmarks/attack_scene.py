# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a case of `benchmarks.integrity_attack` is made of: choices, a scene, readings with a fault.

Every size, pose, pause and motion of a case is a choice: a number from 0 to 1 that the search
varies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from benchmarks.attack_device import Device, RIG_MODE, turns, wrapped
import numpy as np
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

Array = Any
T = TypeVar('T')

# Link angles of the paper's mechanism, deg.
PAPER_ANGLES = 39.3, 34.1, 18.2
RATES = 50.0, 100.0, 250.0, 250.0, 500.0, 500.0, 1000.0, 1000.0, 1000.0, 4000.0
# Turn before a fault with which the device has shown itself, rad, its time and the time before the
# fault, s.
SWING = np.radians(8.0)
SWING_TIME = 0.35
ONSET = 0.45
# Shortest time after a fault, s, and fewest samples.
AFTER = 0.4
AFTER_SAMPLES = 40
# Fastest turn in a pause without samples, rad/s.
HAND_SPEED = 8.0
MS = 1_000_000


class Choices:
    """
    Named numbers from 0 to 1 that settle a case, each drawn when it is first asked for.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the numbers that are not given.
    numbers : dict of float, optional
        Numbers that are known, by name.

    """

    def __init__(self, rng: np.random.Generator, numbers: dict[str, float] | None = None) -> None:
        self._rng = rng
        self.numbers = dict(numbers or {})

    def varied(self, width: float) -> Choices:
        """Return choices near these ones: about half of the numbers move by `width`."""
        moved = {
            name: float(np.mod(number + self._rng.normal(0.0, width), 1.0))
            if self._rng.random() < 0.5
            else number
            for name, number in self.numbers.items()
        }
        return Choices(self._rng, moved)

    def number(self, name: str) -> float:
        """Return a number from 0 to 1."""
        if name not in self.numbers:
            self.numbers[name] = float(self._rng.random())
        return self.numbers[name]

    def between(self, name: str, low: float, high: float) -> float:
        """Return a number between limits."""
        return low + (high - low) * self.number(name)

    def scaled(self, name: str, low: float, high: float) -> float:
        """Return a number between limits, each decade as likely as another."""
        return float(low * (high / low) ** self.number(name))

    def sign(self, name: str) -> float:
        """Return 1 or -1."""
        return 1.0 if self.number(name) < 0.5 else -1.0

    def one_of(self, name: str, options: Sequence[T]) -> T:
        """Return one of several options."""
        return options[min(int(self.number(name) * len(options)), len(options) - 1)]

    def axis(self, name: str) -> Array:
        """Return a unit vector."""
        height = self.between(f'{name}, height', -1.0, 1.0)
        azimuth = self.between(f'{name}, azimuth', 0.0, 2.0 * np.pi)
        across = np.sqrt(1.0 - height**2)
        return np.array([across * np.cos(azimuth), across * np.sin(azimuth), height])


@dataclass(frozen=True, slots=True)
class Case:
    """
    Readings with a fault, the truth, and what is settled for the supervision.

    Attributes
    ----------
    rotations : ndarray, shape (n, 3, 3)
        True orientations.
    stamps : ndarray of int, shape (n,)
        Times, ns.
    readings : ndarray, shape (n, N)
        Readings, rad.
    faulty : tuple of int
        Sensors that are faulty.
    first : int
        First sample at which an error counts.
    rate : float
        Samples a second, Hz.
    window : int
        Samples of the time to alert.
    settings : dict
        Parameters of `supervise`.
    words : str
        The fault, in words.
    latched : bool
        Whether an error counts only if nothing was published before `first`.
    without_first : ndarray, shape (n, N), or None
        Readings without a first fault, that of a sensor which is not `faulty`, rad.

    """

    rotations: Array
    stamps: Array
    readings: Array
    faulty: tuple[int, ...]
    first: int
    rate: float
    window: int
    settings: dict[str, Any]
    words: str
    latched: bool = False
    without_first: Array | None = None


def thinned(case: Case, kept: Array) -> Case:
    """Return a case with some samples only."""
    first = case.without_first
    return replace(
        case,
        rotations=case.rotations[kept],
        stamps=case.stamps[kept],
        readings=case.readings[kept],
        without_first=None if first is None else first[kept],
    )


class Impossible(Exception):
    """The choices describe no case: out of reach, or no other orientation fits."""


class Scene:
    """
    A device with its encoders and settings as chosen, and a motion in which a fault begins.

    Parameters
    ----------
    choices : Choices
        What is chosen.
    sensors : int
        Number of sensors.

    """

    def __init__(self, choices: Choices, sensors: int = 4) -> None:
        self.choices = choices
        self.sensors = sensors
        self.rng = np.random.default_rng(int(1e9 * choices.number('noise')))
        self.rate = choices.one_of('rate', RATES)
        self.settings: dict[str, Any] = {'sensors': sensors}
        self.device = self._chosen_device()
        is_default = choices.number('settings') < 0.35
        self.sigma_deg = 0.04 if is_default else choices.scaled('sigma_deg', 0.005, 0.1)
        self.bias_deg = 0.05 if is_default else max(0.0, choices.between('bias_deg', -0.03, 0.1))
        if not is_default:
            self.settings |= {
                'sigma_deg': [self.sigma_deg] * 4,
                'bias_deg': [self.bias_deg] * 4,
                'alert_limit_deg': min(3.0, choices.scaled('alert_limit_deg', 0.3, 5.0)),
            }
        # The time to alert: 20 ms, ten samples at least.
        self.window = max(10, round(0.02 * self.rate))

    def _chosen_device(self) -> Device:
        """Return the paper's mechanism most of the time, else one with other link angles."""
        choices = self.choices
        mode = RIG_MODE
        angles_deg = list(PAPER_ANGLES)
        if choices.number('mechanism') > 0.85:
            angles_deg = [
                angle + choices.between(f'link {index}', -4.0, 6.0)
                for index, angle in enumerate(angles_deg)
            ]
            names = 'alpha', 'beta', 'gamma'
            self.settings |= {
                f'geometry__{name}_deg': angle
                for name, angle in zip(names, angles_deg, strict=True)
            }
        if choices.number('mode') > 0.9:
            mode = -1, -1, -1
            self.settings['working_mode'] = list(mode)
        return Device(tuple(np.radians(angles_deg).tolist()), mode)

    def pose(self, largest_tilt_deg: float = 24.0) -> Array:
        """Return the chosen orientation, (3, 3)."""
        tilt = self.choices.between('tilt', 0.0, largest_tilt_deg)
        azimuth = self.choices.between('azimuth', 0.0, 360.0)
        phi = self.choices.between('phi', -10.0, 85.0)
        return workspace_pose(*np.radians([tilt, azimuth, phi]))

    def times(self, after: float = AFTER) -> Array:
        """Return times of samples from the start to the end of the motion, s; 0 at the fault."""
        before = self.samples(ONSET)
        later = max(self.samples(after), AFTER_SAMPLES)
        return np.arange(-before, later) / self.rate

    def samples(self, seconds: float) -> int:
        """Return the number of samples in a time."""
        return max(1, round(seconds * self.rate))

    def swing(self, pose: Array, times: Array) -> Array:
        """Return the orientations of a turn to and fro before the fault, then at a pose."""
        phase = np.clip((times + ONSET) / SWING_TIME, 0.0, 1.0)
        angles = SWING * np.sin(np.pi * phase) ** 2
        return turns(angles[:, None] * self.choices.axis('swing')) @ pose

    def moved_after(self, rotations: Array, times: Array) -> Array:
        """Return orientations that turn after the fault, or stay, as chosen."""
        if self.choices.number('moves') < 0.5:
            return rotations
        largest = self.choices.between('turn', np.radians(1.0), np.radians(25.0))
        length = max(times[-1], 1e-3)
        progress = np.clip(times / length, 0.0, 1.0)
        angles = 0.5 * largest * (1.0 - np.cos(np.pi * progress))
        return turns(angles[:, None] * self.choices.axis('turn')) @ rotations

    def true_readings(self, rotations: Array) -> Array:
        """Return what healthy sensors without noise read, rad, (n, N); Impossible out of reach."""
        angles = self.device.readings(rotations)[:, : self.sensors]
        if not np.isfinite(angles).all():
            raise Impossible
        steps = np.abs(wrapped(np.diff(angles, axis=0))).max(initial=0.0)
        if steps * self.rate > 15.0:
            raise Impossible
        return angles

    def encoded(self, angles: Array) -> Array:
        """Return readings with a constant bias within its bound, noise and a resolution, rad."""
        bias = [
            self.choices.between(f'bias of {name}', -1.0, 1.0)
            for name in ALL_JOINT_NAMES[: self.sensors]
        ]
        noise = self.choices.between('noise size', 0.1, 0.95) * self.sigma_deg
        read = angles + np.radians(self.bias_deg) * np.array(bias)
        read = read + np.radians(noise) * self.rng.normal(size=angles.shape)
        # A count is a third of the noise that is settled, or finer.
        count = 2.0 * np.pi / 2.0 ** np.ceil(np.log2(1080.0 / self.sigma_deg))
        return wrapped(np.round(read / count) * count)

    def stamps(self, times: Array) -> Array:
        """Return the stamps of times, ns."""
        return 10_000_000_000_000 + np.round(times * 1e9).astype(np.int64)

    def sensor(self) -> int:
        """Return the sensor that is chosen to be faulty."""
        return int(self.choices.number('sensor') * self.sensors)

    def rival(self, rotation: Array, sensor: int) -> Array:
        """Return another orientation at which three of the other sensors read the same."""
        others = [each for each in range(min(self.sensors, 4)) if each != sensor]
        found = self.device.rivals(rotation, tuple(others[:3]), self.rng)
        if not len(found):
            raise Impossible
        index = int(self.choices.number('which rival') ** 2 * len(found))
        return found[index]

    def offset_to(self, rival: Array, rotation: Array, sensor: int) -> float:
        """Return the offset with which a sensor reads as at a rival, off by some, rad."""
        exact = self.device.readings(rival)[sensor] - self.device.readings(rotation)[sensor]
        error = self.choices.between('miss', -2.0, 2.0) ** 3 / 8.0
        return float(wrapped(exact) + 20.0 * np.radians(self.sigma_deg + self.bias_deg) * error)

    def case(
        self,
        rotations: Array,
        times: Array,
        angles: Array,
        faulty: tuple[int, ...],
        words: str,
        **changed: Any,
    ) -> Case:
        """Return the case of angles, rad, that are encoded; `changed` are fields of it."""
        fields = {
            'rotations': rotations,
            'stamps': self.stamps(times),
            'readings': self.encoded(angles),
            'faulty': faulty,
            'first': 0,
            'rate': self.rate,
            'window': self.window,
            'settings': self.settings,
            'words': words,
        }
        return Case(**(fields | changed))
