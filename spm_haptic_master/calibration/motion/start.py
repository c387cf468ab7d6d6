# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Zeros and directions of all sensors from a free motion, or why it does not determine them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from math import degrees, radians

import numpy as np
from spm_haptic_master.calibration.motion.fit import fit
from spm_haptic_master.calibration.motion.mechanism_parameters import Array
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.calibration.motion.readings import MotionReadings, spread
from spm_haptic_master.calibration.motion.zero_search import GUESSES, search_zeros, ZeroGuess
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Takes what is done, and the part of the whole that is done (unit 1).
Progress = Callable[[str, float], None]

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
    """Directions and zeros with which a motion fits the drawing."""

    direction: tuple[int, ...]  # 1 or -1 of each of N
    vector: Array  # parameters, (P,): the zeros, rad; the rest is 0


def find_start(means: MotionReadings, model: MotionModel,
               progress: Progress = lambda text, share: None, swaps: bool = True) -> Start:
    """
    Return directions and zeros of which nothing is known.

    CalibrationError where none explain the motion, or several do. With `swaps` it names a pair of
    encoders that are swapped.
    """
    def search(readings: Array, count: int, done: float, share: float) -> Start | None:
        return _explaining(readings, model, count, lambda part: progress(
            'zeros and directions', done + part * share))

    found = search(means.readings, GUESSES, 0.0, 0.3)
    if found is not None:
        return found
    joints = ALL_JOINT_NAMES[:model.layout.sensors]
    pairs = list(combinations(range(len(joints)), 2)) if swaps else []
    for number, (first, second) in enumerate(pairs):
        swapped = means.readings.copy()
        swapped[:, [first, second]] = swapped[:, [second, first]]
        share = 0.1 / len(pairs)
        # Several choices that explain this pair say nothing of other pairs.
        with suppress(CalibrationError):
            found = search(swapped, GUESSES, 0.3 + number * share, share)
        if found is not None:
            raise CalibrationError(
                f'{joints[first]} and {joints[second]} are swapped: the motion fits the mechanism '
                'if their encoders are exchanged; expected encoders.id in the order of the joints')
    found = search(means.readings, MORE_GUESSES, 0.4, 0.1)
    if found is not None:
        return found
    raise CalibrationError(
        'no zeros and directions of the encoders explain the motion with this mechanism; '
        "expected the drawing's link angles in geometry.*, the encoders in the order "
        f'{", ".join(joints)}, and a motion of the whole workspace: tilt the handle in all '
        'directions, turn it both ways')


def _explaining(readings: Array, model: MotionModel, count: int,
                progress: Callable[[float], None]) -> Start | None:
    """Return what explains readings, None if nothing does; CalibrationError if several do."""
    layout = model.layout
    rows = spread(readings[:, :4], SEARCH_SAMPLES)
    guesses = search_zeros(readings[rows][:, :4], layout.nominal, layout.working_mode, SEED, count,
                           progress)
    near = [guess for guess in guesses
            if guess.misfit < min(MISFIT_LIMIT, NEAR * guesses[0].misfit)]
    if len(near) > COMPARED:
        raise CalibrationError(
            'the motion does not determine the zeros: many explain it equally well; check the '
            'order of the joints (encoders.id and encoders.node_id), and tilt the '
            'handle farther in all directions and turn it farther both ways')
    compared = readings[spread(readings[:, :4], COMPARED_SAMPLES)]
    fits = [found for guess in guesses[:COMPARED] if guess.misfit < MISFIT_LIMIT
            if (found := _compared(compared, model, guess)) is not None]
    if not fits:
        return None
    (misfit, best), *others = sorted(fits, key=lambda found: found[0])
    each = max(1.0, misfit / len(compared))
    for other, start in others:
        apart = np.abs(np.angle(np.exp(1j * (start.vector - best.vector)))).max() > APART
        if other - misfit < DISTINCT * each and (start.direction != best.direction or apart):
            raise CalibrationError(
                'the motion does not determine the zeros: different ones explain it equally '
                f'well ({degrees(best.vector[0]):.1f} and {degrees(start.vector[0]):.1f} deg '
                f'of {ALL_JOINT_NAMES[0]}); tilt the handle farther in all directions and '
                'turn it farther both ways')
    return best


def _compared(readings: Array, model: MotionModel, guess: ZeroGuess) -> tuple[float, Start] | None:
    """Return the misfit that is left with all parameters free, and the start; or None."""
    start = _with_more(readings, model, guess)
    try:
        found = fit(model, readings * np.array(start.direction), start.vector,
                    range(model.layout.count))
    except CalibrationError:
        return None
    if found.rms * float(model.sigma.mean()) > PARITY_LIMIT or found.normal.kept.mean() < 0.5:
        return None
    return found.misfit, start


def _with_more(readings: Array, model: MotionModel, guess: ZeroGuess) -> Start:
    """Return directions and parameters of all N sensors from those of the first four."""
    layout = model.layout
    vector = np.zeros(layout.count)
    vector[:4] = guess.zeros
    direction = list(guess.direction)
    if layout.sensors > 4:
        four = MotionModel(replace(layout, sensors=4), model.sigma[:4])
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
    return Start(tuple(direction), vector)
