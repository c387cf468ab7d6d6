# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Zeros and directions of all sensors from a free motion, or why it does not determine them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from math import degrees, radians

import numpy as np
from spm_haptic_master.calibration.motion.fit import fit
from spm_haptic_master.calibration.motion.mechanism_parameters import Array, Layout, Tolerances
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.calibration.motion.readings import MotionReadings, spread
from spm_haptic_master.calibration.motion.zero_search import GUESSES, search_zeros, ZeroGuess
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.joints import ALL_JOINT_NAMES

# Seed of the guesses: a calibration is repeatable.
SEED = 2015
# Samples of the search for the zeros, and of the comparison of its results.
SEARCH_SAMPLES, COMPARED_SAMPLES = 120, 1000
# Guesses of a second search where the first one, with fewer, finds nothing.
MORE_GUESSES = 192
# Misfit over that of the best guess below which another one is as good (unit 1).
NEAR = 3.0
# Results of the search that are compared with all parameters free.
COMPARED = 4
# Misfit of the true zeros with the drawing's links (rad): links and axes that are off by 0.5 deg
# give half a degree.
MISFIT_LIMIT = radians(1.5)
# Misfit by which the best zeros explain the motion better than any others, in that of a sample
# (unit 1): by chance it is 30 in a million.
DISTINCT = 100.0
# Parity that may be left (rad rms): more is another mechanism, or encoders that slip.
PARITY_LIMIT = radians(0.25)
# Difference of two zeros that are not the same (rad).
APART = radians(2.0)


@dataclass(frozen=True, slots=True)
class Start:
    """
    Directions and zeros with which a motion fits the drawing.

    Attributes
    ----------
    direction : tuple of N int
        1 or -1 each.
    vector : ndarray, shape (P,)
        Parameters: the zeros, rad; the rest is 0.

    """

    direction: tuple[int, ...]
    vector: Array


class MotionStart:
    """
    Finds zeros and directions of which nothing is known.

    Parameters
    ----------
    tolerances : Tolerances
        How far the rig may be from the drawing.
    progress : callable
        Called with what is done (str) and the part of the whole that is done (unit 1).

    """

    def __init__(self, tolerances: Tolerances,
                 progress: Callable[[str, float], None] = lambda text, share: None):
        self._tolerances = tolerances
        self._progress = progress

    def find(self, means: MotionReadings, model: MotionModel, swaps: bool = True) -> Start:
        """
        Return directions and zeros.

        Parameters
        ----------
        means : MotionReadings
            The motion.
        model : MotionModel
            Mechanism with encoders.
        swaps : bool
            Whether to search for a swapped pair of encoders where nothing explains the motion.

        Raises
        ------
        CalibrationError
            None explain the motion, or several do.

        """
        found = self._started(means.readings, model, 0.0, 0.3, GUESSES)
        if found is not None:
            return found
        sensors = means.readings.shape[1]
        pairs = list(combinations(range(sensors), 2)) if swaps else []
        for number, (first, second) in enumerate(pairs):
            swapped = means.readings.copy()
            swapped[:, [first, second]] = swapped[:, [second, first]]
            share = 0.1 / len(pairs)
            if self._explained(swapped, model, 0.3 + number * share, share):
                raise CalibrationError(
                    f'{ALL_JOINT_NAMES[first]} and {ALL_JOINT_NAMES[second]} are swapped: the '
                    'motion fits the mechanism if their encoders are exchanged; expected '
                    'encoders.id in the order of the joints')
        found = self._started(means.readings, model, 0.4, 0.1, MORE_GUESSES)
        if found is not None:
            return found
        raise CalibrationError(
            'no zeros and directions of the encoders explain the motion with this mechanism; '
            "expected the drawing's link angles in geometry.*, the encoders in the order "
            f'{", ".join(ALL_JOINT_NAMES[:sensors])}, and a motion of the whole workspace: tilt '
            'the handle in all directions, turn it both ways')

    def _explained(self, readings: Array, model: MotionModel, done: float, share: float) -> bool:
        """Return whether one choice of zeros and directions explains readings."""
        try:
            return self._started(readings, model, done, share, GUESSES) is not None
        except CalibrationError:
            # Several do: that says nothing of other pairs.
            return False

    def _started(self, readings: Array, model: MotionModel, done: float, share: float,
                 count: int) -> Start | None:
        """Return what explains readings, None if nothing does; CalibrationError if several do."""
        rows = spread(readings[:, :4], SEARCH_SAMPLES)
        guesses = search_zeros(
            readings[rows][:, :4], model.layout.nominal, model.working_mode, SEED, count,
            progress=lambda part: self._progress('zeros and directions', done + part * share))
        near = [guess for guess in guesses
                if guess.misfit < min(MISFIT_LIMIT, NEAR * guesses[0].misfit)]
        if len(near) > COMPARED:
            raise CalibrationError(
                'the motion does not determine the zeros: many explain it equally well; check the '
                'order of the joints (encoders.id and encoders.node_id), and tilt the '
                'handle farther in all directions and turn it farther both ways')
        compared = spread(readings[:, :4], COMPARED_SAMPLES)
        fits = [found for guess in guesses[:COMPARED] if guess.misfit < MISFIT_LIMIT
                for found in self._compared(readings[compared], model, guess)]
        if not fits:
            return None
        (misfit, best), *others = sorted(fits, key=lambda found: found[0])
        each = max(1.0, misfit / len(compared))
        for other, start in others:
            if other - misfit < DISTINCT * each and (
                    start.direction != best.direction or _apart(start.vector, best.vector)):
                raise CalibrationError(
                    'the motion does not determine the zeros: different ones explain it equally '
                    f'well ({degrees(best.vector[0]):.1f} and {degrees(start.vector[0]):.1f} deg '
                    f'of {ALL_JOINT_NAMES[0]}); tilt the handle farther in all directions and '
                    'turn it farther both ways')
        return best

    def _compared(self, readings: Array, model: MotionModel,
                  guess: ZeroGuess) -> list[tuple[float, Start]]:
        """Return the misfit that is left with all parameters free, and the start; or nothing."""
        layout = model.layout
        direction, vector = _with_more(readings, model, guess)
        turned = readings * np.array(direction)
        columns = [*range(layout.count)]
        try:
            found = fit(model, turned, vector, columns, layout.deviations(self._tolerances))
        except CalibrationError:
            return []
        if found.rms * float(model.sigma.mean()) > PARITY_LIMIT \
                or found.normal.kept.mean() < 0.5:
            return []
        return [(found.misfit, Start(direction, vector))]


def _with_more(readings: Array, model: MotionModel,
               guess: ZeroGuess) -> tuple[tuple[int, ...], Array]:
    """Return directions and parameters of all N sensors from those of the first four."""
    layout = model.layout
    vector = np.zeros(layout.count)
    vector[:4] = guess.zeros
    direction = list(guess.direction)
    if layout.sensors > 4:
        four = MotionModel(Layout(layout.nominal, 4), model.working_mode, model.sigma[:4])
        rotation = four.orientations(
            readings[:, :4] * np.array(guess.direction),
            np.concatenate([guess.zeros, np.zeros(four.layout.count - 4)]))
        known = np.isfinite(rotation).all(axis=(1, 2))
        angles = model.joint_angles(rotation[known], layout.nominal)
        for sensor in range(4, layout.sensors):
            # The zero is the mean direction of what is left, which is short for the wrong sign.
            sums = [np.nanmean(np.exp(1j * (sign * readings[known, sensor] - angles[:, sensor])))
                    for sign in (1, -1)]
            better = int(abs(sums[1]) > abs(sums[0]))
            direction.append((1, -1)[better])
            vector[sensor] = np.angle(sums[better])
    return tuple(direction), vector


def _apart(one: Array, other: Array) -> bool:
    """Return whether two parameter vectors have different zeros."""
    return bool(np.abs(np.angle(np.exp(1j * (one - other)))).max() > APART)
