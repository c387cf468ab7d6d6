# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibration from free motion: zeros, directions, mechanism, harmonics, noise and bias.

The fourth sensor closes the loops of every sample up to one number, the parity. Over many poses
it determines the mechanism but for the choice of the frames. In this order: zeros and directions
from many guesses; then the groups of parameters, each where the motion determines it and a part
of the motion that was not used confirms it; then all of them on the whole motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import degrees, radians

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.mechanism_parameters import (
    Array,
    GROUPS,
    Layout,
    layout_of,
    Tolerances,
)
from spm_haptic_master.calibration.motion_coverage import (
    aligned_changes,
    inverse,
    orientation_error,
    Proposal,
    proposals,
    target_poses,
)
from spm_haptic_master.calibration.motion_fit import Fit, fit, normal_equations
from spm_haptic_master.calibration.motion_model import MotionModel
from spm_haptic_master.calibration.motion_readings import (
    motion_readings,
    MotionReadings,
    spread,
)
from spm_haptic_master.calibration.zero_search import GUESSES, search_zeros, ZeroGuess
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry

# Seed of the guesses: a calibration is repeatable.
SEED = 2015
# Samples of the search for the zeros, of the comparison of its results, and of the choice of the
# parameters; the last fit takes all.
SEARCH_SAMPLES, COMPARED_SAMPLES, CHOICE_SAMPLES = 120, 1000, 3000
# Misfit over that of the best guess below which another one is as good (unit 1).
NEAR = 3.0
# Guesses of a second search where the first one, with fewer, finds nothing.
MORE_GUESSES = 192
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
# Predicted standard deviation of a parameter over that before the fit, below which the motion
# determines it (unit 1).
DETERMINED = 0.95
# Length of the pieces of the motion of which every third is held out, and in which slow errors
# are sought (s).
HELD_OUT_SECONDS, SLOW_SECONDS = 2.0, 0.5
# Standard errors by which a larger model may be worse on the held-out motion.
WORSE = 2.0
# Predicted orientation error of the zeros alone beyond which a motion does not determine them
# (rad).
ZEROS_LIMIT = radians(0.2)
# Predicted orientation error beyond which nothing is written (rad).
ERROR_LIMIT = radians(0.5)
# Standard deviations of the predicted error that the bias covers, its least value and unit (rad).
BIAS_SIGMAS = 2.0
BIAS_UNIT = radians(0.01)
# Part of the pieces whose mean parity the bias covers (percent).
BIAS_PERCENT = 99.0


@dataclass(frozen=True, slots=True)
class MotionCalibration:
    """
    Result of a calibration from free motion.

    Attributes
    ----------
    layout : Layout
        Meaning of the parameters.
    vector : ndarray, shape (P,)
        Parameters, rad.
    covariance : ndarray, shape (P, P)
        Of their errors, those of the drawing's included that were left, rad^2.
    estimated : tuple of int
        Parameters that were estimated.
    left : dict of str to str
        Groups that were left as drawn, and why.
    direction : tuple of N int
        Directions of the encoders.
    noise, bias : ndarray, shape (N,)
        White noise of a reading (1 standard deviation) and bound of what is left systematic, rad.
    readings : MotionReadings
        What it was computed from.
    rotation : ndarray, shape (n, 3, 3)
        Orientation at each of its means; NaN where there is none.
    parity, parity_before : ndarray, shape (n,)
        Parity of each mean, rad, with the result and with zeros and directions only.
    error, target_error : float
        Predicted error of the orientations by what is not known exactly, frames aligned, rad rms:
        over the motion, and over the workspace.
    held_out : dict of str to float
        Parity of the held-out motion by the last group of the model, rad rms.
    advice : tuple of Proposal
        Motions that would determine more, the best first.

    """

    layout: Layout
    vector: Array
    covariance: Array
    estimated: tuple[int, ...]
    left: dict[str, str]
    direction: tuple[int, ...]
    noise: Array
    bias: Array
    readings: MotionReadings
    rotation: Array
    parity: Array
    parity_before: Array
    error: float
    target_error: float
    held_out: dict[str, float]
    advice: tuple[Proposal, ...]

    @property
    def deviations(self) -> Array:
        """Return the standard deviation of each parameter's error, rad."""
        found: Array = np.sqrt(np.diag(self.covariance))
        return found


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


class MotionCalibrator:
    """
    Computes a calibration from the readings of a free motion.

    Parameters
    ----------
    nominal : Geometry
        The drawing.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.
    tolerances : Tolerances
        How far the rig may be from the drawing.
    progress : callable
        Called with what is done (str) and the part of the whole that is done (unit 1).

    """

    def __init__(self, nominal: Geometry, working_mode: tuple[int, int, int],
                 tolerances: Tolerances,
                 progress: Callable[[str, float], None] = lambda text, share: None):
        self._nominal = nominal
        self._working_mode = working_mode
        self._tolerances = tolerances
        self._progress = progress

    def calibrate(self, stamps: NDArray[np.int64], readings: Array,
                  given: Sequence[int] | None = None) -> MotionCalibration:
        """
        Return the calibration that a motion gives.

        Parameters
        ----------
        stamps : ndarray of int, shape (n,)
            Times, ns.
        readings : ndarray, shape (n, N)
            Angles by the counts alone, rad, on any turn.
        given : sequence of N int, optional
            Directions that are known; they are verified.

        Raises
        ------
        CalibrationError
            The motion does not determine the zeros, contradicts the drawing or the directions
            given, or two encoders are swapped.

        """
        means = motion_readings(stamps, readings)
        layout = layout_of(self._nominal, readings.shape[1])
        model = MotionModel(layout, self._working_mode, means.sigma)
        start = self.start(means, model)
        _check_directions(start.direction, given)
        return self._fitted(means, model, start)

    def start(self, means: MotionReadings, model: MotionModel, swaps: bool = True) -> Start:
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
            if self._started(swapped, model, 0.3 + number * share, share,
                             GUESSES) is not None:
                raise CalibrationError(
                    f'{ALL_JOINT_NAMES[first]} and {ALL_JOINT_NAMES[second]} are swapped: the '
                    'motion fits the mechanism if their encoders are exchanged; expected '
                    'encoders.can_id in the order of the joints')
        found = self._started(means.readings, model, 0.4, 0.1, MORE_GUESSES)
        if found is not None:
            return found
        raise CalibrationError(
            'no zeros and directions of the encoders explain the motion with this mechanism; '
            "expected the drawing's link angles in geometry.*, the encoders in the order "
            f'{", ".join(ALL_JOINT_NAMES[:sensors])}, and a motion of the whole workspace: tilt '
            'the handle in all directions, turn it both ways')

    def _started(self, readings: Array, model: MotionModel, done: float, share: float,
                 count: int) -> Start | None:
        """Return what explains readings, None if nothing does; CalibrationError if several do."""
        rows = spread(readings[:, :4], SEARCH_SAMPLES)
        guesses = search_zeros(
            readings[rows][:, :4], self._nominal, self._working_mode, SEED, count,
            progress=lambda part: self._progress('zeros and directions', done + part * share))
        near = [guess for guess in guesses
                if guess.misfit < min(MISFIT_LIMIT, NEAR * guesses[0].misfit)]
        if len(near) > COMPARED:
            raise CalibrationError(
                'the motion does not determine the zeros: many explain it equally well; tilt the '
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

    def _fitted(self, means: MotionReadings, model: MotionModel,
                start: Start) -> MotionCalibration:
        layout = model.layout
        turned = means.readings * np.array(start.direction)
        deviations = layout.deviations(self._tolerances)
        zeros = [*range(layout.sensors)]
        chosen = np.arange(0, len(turned), max(1, len(turned) // CHOICE_SAMPLES))
        piece = np.floor(means.seconds[chosen] / HELD_OUT_SECONDS).astype(int)
        held = piece % 3 == 2 if len(np.unique(piece)) >= 3 else piece < 0
        self._progress('zeros', 0.5)
        first = fit(model, turned[chosen], start.vector, zeros, deviations)
        self._check_zeros(model, first, len(turned) / len(chosen))
        vector, columns, left, held_out = self._chosen(
            model, turned[chosen], held, first, len(turned) / len(chosen))
        self._progress('all parameters, whole motion', 0.8)
        rotation = model.orientations(turned, vector)
        whole = fit(model, turned, vector, columns, deviations, rotation,
                    lambda: self._progress('all parameters, whole motion', 0.85))
        slow = _slow_factor(means, whole)
        if slow > 1.0:
            model = MotionModel(layout, self._working_mode, model.sigma * np.sqrt(slow))
            whole = fit(model, turned, whole.vector, columns, deviations, whole.normal.rotation,
                        lambda: self._progress('all parameters, whole motion', 0.9))
        self._progress('errors', 0.95)
        return self._result(means, model, start, first, whole, left, held_out, turned)

    def _check_zeros(self, model: MotionModel, first: Fit, factor: float) -> None:
        """Raise CalibrationError if a motion does not even determine the zeros."""
        changes = aligned_changes(model, target_poses(model, first.vector), first.vector)
        zeros = slice(model.layout.sensors)
        error = orientation_error(changes[:, :, zeros], inverse(first.normal.matrix * factor))
        if error > ZEROS_LIMIT:
            raise CalibrationError(
                'the motion does not determine the zeros: they leave a predicted error of '
                f'{degrees(error):.2f} deg, limit {degrees(ZEROS_LIMIT):g} deg; '
                f'{self._advice(model, first, factor, changes)[0].text}')

    def _advice(self, model: MotionModel, found: Fit, factor: float,
                changes: Array) -> list[Proposal]:
        every = tuple(range(model.layout.count))
        kept = found.normal.kept
        normal = normal_equations(model, *_rows(found, kept, model), found.vector, every)
        information = normal.matrix * factor + np.diag(
            model.layout.deviations(self._tolerances) ** -2.0)
        return proposals(model, found.vector, information, 100.0, changes)

    def _chosen(self, model: MotionModel, turned: Array, held: NDArray[np.bool_], first: Fit,
                factor: float) -> tuple[Array, list[int], dict[str, str], dict[str, float]]:
        """Return start, parameters, the groups left as drawn, and the held-out parities."""
        layout, fitted = model.layout, ~held
        deviations = layout.deviations(self._tolerances)
        scale = float(model.sigma.mean())
        rotation = first.normal.rotation
        best = fit(model, turned[fitted], first.vector, first.columns, deviations,
                   rotation[fitted])
        outside = _outside(model, turned[held], best.vector)
        held_out = {GROUPS[0]: float(np.sqrt(np.mean(outside))) * scale} if held.any() else {}
        left: dict[str, str] = {}
        columns = list(first.columns)
        for number, group in enumerate(GROUPS[1:], 1):
            self._progress(group, 0.5 + 0.05 * number)
            wanted = [*range(layout.count)[layout.slices[group]]]
            trial = columns + wanted
            normal = normal_equations(model, turned[fitted], best.normal.rotation, best.vector,
                                      tuple(trial))
            after = np.sqrt(np.diag(inverse(
                normal.matrix * factor / fitted.mean() + np.diag(deviations[trial] ** -2.0))))
            better = [column for column, each in zip(wanted, after[len(columns):], strict=True)
                      if each < DETERMINED * deviations[column]]
            if not better:
                left[group] = 'the motion does not determine them'
                continue
            found = fit(model, turned[fitted], best.vector, columns + better, deviations,
                        best.normal.rotation)
            if held.any():
                now = _outside(model, turned[held], found.vector)
                change = now - outside
                if change.mean() > WORSE * change.std() / np.sqrt(len(change)):
                    left[group] = 'they do not explain the held-out motion better'
                    continue
                outside = now
                held_out[group] = float(np.sqrt(np.mean(now))) * scale
            best, columns = found, columns + better
        return best.vector, columns, left, held_out

    def _result(self, means: MotionReadings, model: MotionModel, start: Start, first: Fit,
                whole: Fit, left: dict[str, str], held_out: dict[str, float],
                turned: Array) -> MotionCalibration:
        layout = model.layout
        deviations = layout.deviations(self._tolerances)
        every = tuple(range(layout.count))
        rotation = whole.normal.rotation
        normal = normal_equations(model, turned, rotation, whole.vector, every)
        covariance = considered_covariance(normal.matrix, deviations, whole.columns)
        inside = np.flatnonzero(whole.normal.kept)
        some = inside[::max(1, len(inside) // CHOICE_SAMPLES)]
        over_motion = aligned_changes(model, rotation[some], whole.vector)
        changes = aligned_changes(model, target_poses(model, whole.vector), whole.vector)
        error = orientation_error(over_motion, covariance)
        target_error = orientation_error(changes, covariance)
        rate = 1.0 / float(np.median(np.diff(means.seconds)))
        advice = tuple(proposals(model, whole.vector, normal.matrix + np.diag(deviations ** -2.0),
                                 rate, changes))
        if error > ERROR_LIMIT:
            raise CalibrationError(
                'the motion does not determine the mechanism: predicted error of the orientation '
                f'{degrees(error):.2f} deg, limit {degrees(ERROR_LIMIT):g} deg; '
                f'{advice[0].text}')
        scale = _parity_scale(model, rotation)
        parity = whole.normal.parity * scale
        before = normal_equations(model, turned, model.orientations(turned, first.vector),
                                  first.vector, ()).parity * scale
        spread_size = np.sqrt(np.mean(np.sum(model.linearised(
            turned[some], rotation[some], whole.vector, ()).spread ** 2, axis=(1, 2))))
        slow = _piece_means(means.seconds, parity[:, 0], whole.normal.kept)
        each = max(BIAS_SIGMAS * error / spread_size,
                   float(np.percentile(np.abs(slow), BIAS_PERCENT)) if len(slow) else 0.0)
        bias = np.full(layout.sensors, np.ceil(each / BIAS_UNIT) * BIAS_UNIT)
        return MotionCalibration(
            layout, whole.vector, covariance, whole.columns, left, start.direction, means.noise,
            bias, means, rotation, parity[:, 0], before[:, 0], error, target_error, held_out,
            advice)


def considered_covariance(information: Array, deviations: Array,
                          columns: tuple[int, ...]) -> Array:
    """
    Return the covariance of all parameters' errors after a fit of some of them.

    The others keep the errors that they had before, which also enter the estimated ones.

    Parameters
    ----------
    information : ndarray, shape (P, P)
        Normal matrix of all parameters, 1/rad^2.
    deviations : ndarray, shape (P,)
        Standard deviations before the fit, rad; inf: none.
    columns : tuple of int
        Parameters that were estimated.

    """
    found = np.zeros_like(information)
    inside = np.array(columns)
    others = np.setdiff1d(np.arange(len(deviations)), inside)
    weights = deviations ** -2.0
    own = inverse(information[np.ix_(inside, inside)] + np.diag(weights[inside]))
    gain = own @ information[np.ix_(inside, others)]
    before = np.diag(deviations[others] ** 2)
    found[np.ix_(inside, inside)] = own + gain @ before @ gain.T
    found[np.ix_(inside, others)] = -gain @ before
    found[np.ix_(others, inside)] = -before @ gain.T
    found[np.ix_(others, others)] = before
    return found


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
    return bool(np.abs(np.angle(np.exp(1j * (one - other)))).max() > radians(2.0))


def _check_directions(found: tuple[int, ...], given: Sequence[int] | None) -> None:
    """Raise CalibrationError if directions that were given are not those found."""
    if given is None:
        return
    wrong = [f'{joint} turns with direction {sign:+d}, encoders.direction has {other:+d}'
             for joint, sign, other in zip(ALL_JOINT_NAMES, found, given, strict=False)
             if sign != other]
    if wrong:
        raise CalibrationError('; '.join(wrong))


def _outside(model: MotionModel, turned: Array, vector: Array) -> Array:
    """Return the squared parities of held-out samples, outliers at their limit; unit 1."""
    normal = normal_equations(model, turned, model.orientations(turned, vector), vector, ())
    size = np.linalg.norm(normal.parity, axis=1)
    limit = 6.0 * max(1.0, 1.5 * float(np.nanmedian(size))) if len(size) else 0.0
    found: Array = np.minimum(np.nan_to_num(size, nan=limit), limit) ** 2
    return found


def _piece_means(seconds: Array, parity: Array, kept: NDArray[np.bool_]) -> Array:
    """Return the mean parities of the motion's pieces of `SLOW_SECONDS`."""
    piece = np.floor(seconds / SLOW_SECONDS).astype(int)[kept]
    counts = np.bincount(piece)
    sums = np.bincount(piece, parity[kept])
    enough = counts > 0.5 * np.median(counts[counts > 0])
    found: Array = sums[enough] / counts[enough]
    return found


def _slow_factor(means: MotionReadings, whole: Fit) -> float:
    """Return the variance of the mean parities of pieces over that of white noise; 1 at least."""
    kept = whole.normal.kept
    piece = np.floor(means.seconds / SLOW_SECONDS).astype(int)[kept]
    counts = np.bincount(piece)
    factors = [counts[counts > 0] * (np.bincount(piece, column)[counts > 0]
                                     / counts[counts > 0]) ** 2
               for column in whole.normal.parity[kept].T]
    return max(1.0, float(np.mean(factors)))


def _parity_scale(model: MotionModel, rotation: Array) -> Array:
    """Return the parity in rad of one standard deviation at orientations, shape (n, 1)."""
    found: Array = np.full((len(rotation), 1), float(np.sqrt(np.mean(model.sigma ** 2))))
    return found


def _rows(found: Fit, kept: NDArray[np.bool_], model: MotionModel) -> tuple[Array, Array]:
    """Return readings without error and orientations of a fit's samples."""
    rotation = found.normal.rotation[kept]
    return model.readings(rotation, found.vector), rotation
