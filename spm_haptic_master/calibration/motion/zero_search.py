# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zeros and directions of all sensors from a free motion, or why it does not determine them.

Nothing is known but the drawing of the mechanism. The first four angles of a sample fit together
if Case 2's linear system for the cosine and sine of th2A (eqs. 15, 16) gives a point of the unit
circle. Divided by the length of its gradient that is an angle: how far the four are from the
nearest ones that fit. It needs no start and no orientation, so that thousands of guesses are
improved at once, each on some hundred samples. A guess is a pose within reach at one sample: it
gives all four zeros, for each of the sixteen combinations of directions.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from itertools import combinations, product
from math import cos, degrees, radians, sin

import numpy as np
from spm_haptic_master.calibration.motion.fit import fit
from spm_haptic_master.calibration.motion.model import Array, Layout, MotionModel
from spm_haptic_master.calibration.motion.readings import MotionReadings, spread
from spm_haptic_master.calibration.watch.slip_evidence import sensor_angles
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import Geometry, leg_kernels, matrix_from_quaternion
from spm_haptic_master.kinematics.geometry import Carried
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.leg_kernels import Turn
from spm_haptic_master.kinematics.number_backends import Batch, Vector
from spm_haptic_master.kinematics.rotations import wrapped

# Takes the stage, and the part of the whole that is done (unit 1).
Progress = Callable[[str, float], None]

# Seed of the guesses: a calibration is repeatable.
SEED = 2015
# Samples of the search for the zeros, and of the comparison of its results.
SEARCH_SAMPLES = 120
COMPARED_SAMPLES = 1000
# Guesses for each combination of directions: one in five of the true combination leads to the
# true zeros after a motion of the whole workspace, one in thirty after a poor one. And of a second
# search where the first one finds nothing.
GUESSES = 48
MORE_GUESSES = 192
# Random orientations tried for each guess: about one in sixteen is within reach.
ORIENTATIONS = 40
# Steps of a guess, of all of them and of the better ones.
FIRST_STEPS = 10
STEPS = 30
# Part of the guesses that are improved to the end (unit 1).
BETTER = 0.25
# Step of the angles in the forward differences (rad).
DIFFERENCE = 1e-5
# Distance at which a sample counts half (rad): a loss that outliers do not rule.
HALF_WEIGHT = 0.05
# Least length of the gradient (unit 1): less is a pose where the four angles always fit.
GRADIENT_FLOOR = 1e-3
# Damping at the start, and its factors after a better and a worse step (unit 1).
DAMPING = 1e-2
BETTER_STEP = 0.3
WORSE_STEP = 4.0
# Distance of the zeros below which two guesses have come to the same, and beyond which two starts
# are different (rad).
SAME_ZEROS = radians(1.0)
DISTINCT_ZEROS = radians(2.0)
# Misfit over that of the best guess below which another one is as good (unit 1).
MISFIT_RATIO = 3.0
# Results of the search that are compared with all parameters free.
COMPARED = 4
# Misfit of the true zeros with the drawing's links (rad): links and axes that are off by 0.5 deg
# give half a degree.
MISFIT_LIMIT = radians(1.5)
# Misfit by which the best zeros explain the motion better than any others, in that of a sample
# (unit 1): by chance it is 30 in a million.
MISFIT_MARGIN = 100.0
# Parity that may be left (rad rms): more is another mechanism, or encoders that slip.
PARITY_LIMIT = radians(0.25)


@dataclass(frozen=True, slots=True)
class ZeroGuess:
    """
    Zeros and directions of the first four sensors.

    Attributes
    ----------
    direction : tuple of int
        Direction of each of the four, 1 or -1.
    zeros : ndarray, shape (4,)
        Reading at the joint's zero, rad, with its direction.
    misfit : float
        Median distance of the samples' angles from angles that fit together, rad.

    """

    direction: tuple[int, ...]
    zeros: Array
    misfit: float

    def is_near(self, other: ZeroGuess) -> bool:
        """Return whether another guess has the same directions and nearly the same zeros."""
        if self.direction != other.direction:
            return False
        return bool(np.abs(wrapped(self.zeros - other.zeros)).max() < SAME_ZEROS)


@dataclass(frozen=True, slots=True)
class Start:
    """
    Directions and zeros with which a motion fits the drawing.

    Attributes
    ----------
    direction : tuple of int
        Direction of each of the N sensors, 1 or -1.
    vector : ndarray, shape (P,)
        Parameters: the zeros, rad; the rest is 0.

    """

    direction: tuple[int, ...]
    vector: Array


@dataclass(frozen=True, slots=True)
class ComparedGuess:
    """
    A guess after a fit with all parameters free.

    Attributes
    ----------
    misfit : float
        Misfit of the fit (unit 1).
    start : Start
        Directions and zeros of the guess.
    zeros : ndarray, shape (N,)
        Zeros to which the fit has come, rad: two guesses may come to the same.

    """

    misfit: float
    start: Start
    zeros: Array

    def is_other_than(self, other: ComparedGuess) -> bool:
        """Return whether directions or fitted zeros are others than those of another guess."""
        if self.start.direction != other.start.direction:
            return True
        return bool(np.abs(wrapped(self.zeros - other.zeros)).max() > DISTINCT_ZEROS)


def find_start(
    means: MotionReadings,
    model: MotionModel,
    progress: Progress = lambda text, share: None,
    swaps: bool = True,
) -> Start:
    """
    Return directions and zeros of which nothing is known.

    If none explain the motion, it is tried whether they do after two encoders are exchanged, and
    then a search with more guesses.

    Parameters
    ----------
    means : MotionReadings
        Means of the motion's readings.
    model : MotionModel
        The mechanism with its encoders.
    progress : callable, optional
        Takes the name of each stage and the share that is done, 0 to 1.
    swaps : bool, optional
        Whether exchanged encoders are looked for.

    Returns
    -------
    Start
        Directions and zeros.

    Raises
    ------
    CalibrationError
        No directions and zeros explain the motion, several do, or two encoders are swapped.

    """
    joints = ALL_JOINT_NAMES[: model.layout.sensors]
    searches: list[tuple[int, list[int]]] = [(GUESSES, [])]
    if swaps:
        searches += [(GUESSES, [*pair]) for pair in combinations(range(len(joints)), 2)]
    searches.append((MORE_GUESSES, []))
    for number, (count, pair) in enumerate(searches):
        progress('zeros and directions', 0.5 * number / len(searches))
        readings = means.readings.copy()
        readings[:, pair] = readings[:, pair[::-1]]
        found = None
        # Several choices that explain a swapped pair say nothing of other pairs.
        with suppress(CalibrationError) if pair else nullcontext():
            found = _explaining(readings, model, count)
        if found and not pair:
            return found
        if found:
            raise CalibrationError(
                f'{" and ".join(joints[each] for each in pair)} are swapped: the motion fits the '
                'mechanism if their encoders are exchanged; expected encoders.id in the order of '
                'the joints'
            )
    raise CalibrationError(
        'no zeros and directions of the encoders explain the motion with this mechanism; '
        "expected the drawing's link angles in geometry.*, the encoders in the order "
        f'{", ".join(joints)}, and a motion of the whole workspace: tilt the handle in all '
        'directions, turn it both ways'
    )


def _explaining(
    readings: Array,
    model: MotionModel,
    count: int,
) -> Start | None:
    """
    Return the directions and zeros that explain readings.

    The best guesses of the search are compared by fits with all parameters free.

    Parameters
    ----------
    readings : ndarray, shape (n, N)
        Angles by the counts alone (direction 1, zero 0), rad.
    model : MotionModel
        The mechanism with its encoders.
    count : int
        Guesses for each combination of directions.

    Returns
    -------
    Start or None
        None if nothing explains them.

    Raises
    ------
    CalibrationError
        Several different ones explain them about equally well.

    """
    guesses = _guesses(readings, model.layout, count)
    compared = readings[spread(readings[:, :4], COMPARED_SAMPLES)]
    fits = [_compared(compared, model, guess) for guess in guesses]
    known = sorted((found for found in fits if found is not None), key=lambda found: found.misfit)
    if not known:
        return None
    best = known[0]
    per_sample = max(1.0, best.misfit / len(compared))
    for other in known[1:]:
        as_good = other.misfit - best.misfit < MISFIT_MARGIN * per_sample
        if as_good and other.is_other_than(best):
            raise _undetermined(
                f'{degrees(best.zeros[0]):.1f} and '
                f'{degrees(other.zeros[0]):.1f} deg of {ALL_JOINT_NAMES[0]}'
            )
    return best.start


def _guesses(
    readings: Array,
    layout: Layout,
    count: int,
) -> list[ZeroGuess]:
    """
    Return the guesses that are worth a fit, at most `COMPARED` of them.

    Raises
    ------
    CalibrationError
        More than that are nearly as good as the best one.

    """
    rows = spread(readings[:, :4], SEARCH_SAMPLES)
    guesses = search_zeros(readings[rows][:, :4], layout, count)
    limit = min(MISFIT_LIMIT, MISFIT_RATIO * guesses[0].misfit)
    if sum(guess.misfit < limit for guess in guesses) > COMPARED:
        raise _undetermined('many')
    return [guess for guess in guesses[:COMPARED] if guess.misfit < MISFIT_LIMIT]


def _undetermined(zeros: str) -> CalibrationError:
    """Return the error of a motion with which several choices of the zeros agree."""
    return CalibrationError(
        f'the motion does not determine the zeros: {zeros} explain it equally well; check the '
        'order of the joints (encoders.id and encoders.node_id) and encoders.counts_per_turn, '
        'tilt the handle farther in all directions and turn it farther both ways'
    )


def _compared(
    readings: Array,
    model: MotionModel,
    guess: ZeroGuess,
) -> ComparedGuess | None:
    """
    Return a guess with its fit, all parameters free.

    Parameters
    ----------
    readings : ndarray, shape (n, N)
        Angles by the counts alone (direction 1, zero 0), rad.
    model : MotionModel
        The mechanism with its encoders.
    guess : ZeroGuess
        Zeros and directions of the first four sensors.

    Returns
    -------
    ComparedGuess or None
        None where the parity left is that of another mechanism.

    """
    start = _with_more(readings, model, guess)
    try:
        found = fit(
            model,
            readings * np.array(start.direction),
            start.vector,
            range(model.layout.count),
        )
    except CalibrationError:
        return None
    parity = found.rms * float(model.sigma.mean())
    if parity > PARITY_LIMIT or found.normal.kept.mean() < 0.5:
        return None
    return ComparedGuess(
        misfit=found.misfit,
        start=start,
        zeros=found.vector[: model.layout.sensors],
    )


def _with_more(
    readings: Array,
    model: MotionModel,
    guess: ZeroGuess,
) -> Start:
    """
    Return directions and parameters of all N sensors from those of the first four.

    The four give orientations; a further sensor's direction is the one with which reading minus
    angle is the same at all of them, and its zero the circular mean of that.

    Parameters
    ----------
    readings : ndarray, shape (n, N)
        Angles by the counts alone (direction 1, zero 0), rad.
    model : MotionModel
        The mechanism with its encoders.
    guess : ZeroGuess
        Zeros and directions of the first four sensors.

    Returns
    -------
    Start
        Directions, and parameters with the zeros.

    """
    layout = model.layout
    vector = np.zeros(layout.count)
    vector[:4] = guess.zeros
    direction = list(guess.direction)
    if layout.sensors > 4:
        four = MotionModel(replace(layout, sensors=4), model.sigma[:4])
        rotation = four.orientations(
            readings[:, :4] * np.array(guess.direction),
            np.concatenate([guess.zeros, np.zeros(four.layout.count - 4)]),
        )
        known = np.isfinite(rotation).all(axis=(1, 2))
        angles = model.joint_angles(rotation[known], layout.nominal)
        for sensor in range(4, layout.sensors):
            # The zero is the mean direction of what is left, which is short for the wrong sign.
            mean, sign = max(
                (
                    (
                        np.nanmean(
                            np.exp(1j * (sign * readings[known, sensor] - angles[:, sensor]))
                        ),
                        sign,
                    )
                    for sign in (1, -1)
                ),
                key=lambda each: abs(each[0]),
            )
            direction.append(sign)
            vector[sensor] = np.angle(mean)
    return Start(tuple(direction), vector)


def search_zeros(
    readings: Array,
    layout: Layout,
    count: int,
) -> list[ZeroGuess]:
    """
    Return different zeros and directions that explain readings, the best first.

    Random orientations within reach give the zeros at the first reading; each guess is improved by
    Levenberg-Marquardt with the loss log(1 + (d / `HALF_WEIGHT`)^2), for each of the sixteen
    combinations of directions. The seed is fixed, so that the result is repeatable.

    Parameters
    ----------
    readings : ndarray, shape (n, 4)
        Angles by the counts alone of the first four sensors, rad, far from each other. The first
        one, where the guesses are made, is a middle one.
    layout : Layout
        The rig as drawn, and the meaning of the parameter vector.
    count : int
        Guesses for each combination of directions.

    Returns
    -------
    list of ZeroGuess
        Guesses by increasing misfit; two with the same directions differ by `SAME_ZEROS` or more.

    """
    nominal = layout.nominal
    random = np.random.default_rng(SEED)
    quaternions = random.normal(size=(ORIENTATIONS * count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    angles = sensor_angles(
        rotation=matrix_from_quaternion(quaternions),
        geometry=nominal,
        working_mode=layout.working_mode,
        sensors=4,
    )
    angles = angles[np.isfinite(angles).all(axis=1)][:count]
    found = []
    for direction in product((1, -1), repeat=4):
        turned = readings * np.array(direction)
        zeros, cost, damping = _improve(
            turned=turned,
            zeros=turned[0] - angles,
            damping=np.full(len(angles), DAMPING),
            nominal=nominal,
            steps=FIRST_STEPS,
        )
        best = np.argsort(cost)[: max(1, int(BETTER * count))]
        zeros, _, _ = _improve(
            turned=turned,
            zeros=zeros[best],
            damping=damping[best],
            nominal=nominal,
            steps=STEPS,
        )
        distance, *_ = _distance(turned, zeros, nominal)
        misfit = np.median(np.abs(distance), axis=1)
        found += [
            ZeroGuess(
                direction=direction,
                zeros=each,
                misfit=float(of),
            )
            for each, of in zip(zeros, misfit, strict=True)
        ]
    different: list[ZeroGuess] = []
    for guess in sorted(found, key=lambda guess: guess.misfit):
        if not any(guess.is_near(other) for other in different):
            different.append(guess)
    return different


def _improve(
    turned: Array,
    zeros: Array,
    damping: Array,
    nominal: Geometry,
    steps: int,
) -> tuple[Array, Array, Array]:
    """
    Return zeros after Levenberg-Marquardt steps, of m guesses at once.

    Parameters
    ----------
    turned : ndarray, shape (n, 4)
        Readings times their directions, rad.
    zeros : ndarray, shape (m, 4)
        Zeros of each guess, rad.
    damping : ndarray, shape (m,)
        Damping of each guess (unit 1).
    nominal : Geometry
        The drawing.
    steps : int
        Number of steps.

    Returns
    -------
    zeros : ndarray, shape (m, 4)
        Improved zeros, rad.
    cost : ndarray, shape (m,)
        Their costs (unit 1).
    damping : ndarray, shape (m,)
        Damping to go on with (unit 1).

    """
    distance, slopes = _distance(turned, zeros, nominal)
    cost = _cost(distance)
    for _ in range(steps):
        # Weights of the robust loss: a sample at `HALF_WEIGHT` counts half.
        weights = 1.0 / (1.0 + np.square(distance / HALF_WEIGHT))
        weighted = (weights[:, :, None] * slopes).swapaxes(1, 2)
        matrix = weighted @ slopes
        added = damping * np.trace(matrix, axis1=1, axis2=2) / 4.0
        matrix += added[:, None, None] * np.eye(4)
        right = weighted @ distance[:, :, None]
        moved = zeros - np.linalg.solve(matrix, right)[:, :, 0]
        after, slopes_after = _distance(turned, moved, nominal)
        cost_after = _cost(after)
        better = cost_after < cost
        damping = damping * np.where(better, BETTER_STEP, WORSE_STEP)
        zeros = np.where(better[:, None], moved, zeros)
        cost = np.where(better, cost_after, cost)
        distance = np.where(better[:, None], after, distance)
        slopes = np.where(better[:, None, None], slopes_after, slopes)
    return zeros, cost, damping


def _cost(distance: Array) -> Array:
    """
    Return the cost of each set of zeros: the mean of log(1 + (d / `HALF_WEIGHT`)^2).

    Parameters
    ----------
    distance : ndarray, shape (m, n)
        Distances d of the samples from angles that fit together, rad.

    Returns
    -------
    ndarray, shape (m,)
        Cost of each set of zeros (unit 1).

    """
    costs = np.log1p(np.square(distance / HALF_WEIGHT))
    return np.asarray(costs.mean(axis=1))


def _distance(
    turned: Array,
    zeros: Array,
    nominal: Geometry,
) -> tuple[Array, Array]:
    """
    Return how far samples are from angles that fit together, and the slopes by the zeros.

    The closure error over the length of its gradient: to first order a distance in angles.

    Parameters
    ----------
    turned : ndarray, shape (n, 4)
        Readings times their directions, rad.
    zeros : ndarray, shape (m, 4)
        M sets of zeros, rad.
    nominal : Geometry
        The drawing.

    Returns
    -------
    distance : ndarray, shape (m, n)
        Distances, rad.
    slopes : ndarray, shape (m, n, 4)
        Derivatives by the zeros (unit 1).

    """
    angles = turned.T[:, None] - zeros.T[:, :, None]
    cosines = np.cos(angles)
    sines = np.sin(angles)
    c_more = cos(DIFFERENCE)
    s_more = sin(DIFFERENCE)
    more = (cosines * c_more - sines * s_more, sines * c_more + cosines * s_more)
    closure, closures_more = _closures((cosines, sines), more, nominal)
    slopes = (closures_more - closure) / DIFFERENCE
    scale = 1.0 / np.maximum(np.sqrt(np.square(slopes).sum(axis=0)), GRADIENT_FLOOR)
    return closure * scale, np.moveaxis(-slopes * scale, 0, 2)


def _closures(
    here: tuple[Array, Array],
    more: tuple[Array, Array],
    nominal: Geometry,
) -> tuple[Array, Array]:
    """
    Return the closure errors of samples, and those after one angle is a little larger.

    Parameters
    ----------
    here : tuple of 2 ndarray, each of shape (4, m, n)
        Cosine and sine of th1A, th1B, th1C and th3A.
    more : tuple of 2 ndarray, each of shape (4, m, n)
        The same of angles that are a little larger.
    nominal : Geometry
        The drawing.

    Returns
    -------
    closure : ndarray, shape (m, n)
        Closure errors (unit 1).
    closures_more : ndarray, shape (4, m, n)
        Those after each of the angles alone is larger.

    """
    th1a, th1b, th1c, th3a = zip(*here, strict=True)
    more_1a, more_1b, more_1c, more_3a = zip(*more, strict=True)
    carried_b, carried_c = nominal.carried
    leg_b, leg_b_1a, leg_b_1b, leg_b_3a = _turn_equations(
        (th1a, th1b, th3a), (more_1a, more_1b, more_3a), carried_b
    )
    leg_c, leg_c_1a, leg_c_1c, leg_c_3a = _turn_equations(
        (th1a, th1c, th3a), (more_1a, more_1c, more_3a), carried_c
    )
    closures_more = (
        _closure(leg_b_1a, leg_c_1a),
        _closure(leg_b_1b, leg_c),
        _closure(leg_b, leg_c_1c),
        _closure(leg_b_3a, leg_c_3a),
    )
    return _closure(leg_b, leg_c), np.stack(closures_more)


def _turn_equations(
    here: tuple[Turn[Batch], Turn[Batch], Turn[Batch]],
    more: tuple[Turn[Batch], Turn[Batch], Turn[Batch]],
    carried: Carried,
) -> tuple[Vector[Batch], Vector[Batch], Vector[Batch], Vector[Batch]]:
    """
    Return a leg's equation for th2A, and those after one of its three angles is a little larger.

    Parameters
    ----------
    here : tuple of 3 tuple of 2 ndarray, each of shape (m, n)
        Cosine and sine of th1A, of th1k, and of th3A.
    more : tuple of 3 tuple of 2 ndarray, each of shape (m, n)
        The same of angles that are a little larger.
    carried : Carried
        Leg k, B or C, as seen from leg A.

    """
    th1a, th1k, th3a = here
    more_1a, more_1k, more_3a = more
    second = leg_kernels.second_in_second_joint(*th1a, *th1k, carried)
    second_1a = leg_kernels.second_in_second_joint(*more_1a, *th1k, carried)
    second_1k = leg_kernels.second_in_second_joint(*th1a, *more_1k, carried)
    third = leg_kernels.turn_through_link(*th3a, carried.before_distal)
    third_3a = leg_kernels.turn_through_link(*more_3a, carried.before_distal)
    return (
        leg_kernels.turn_equation(second, third, carried.cos_beta),
        leg_kernels.turn_equation(second_1a, third, carried.cos_beta),
        leg_kernels.turn_equation(second_1k, third, carried.cos_beta),
        leg_kernels.turn_equation(second, third_3a, carried.cos_beta),
    )


def _closure(leg_b: Vector[Batch], leg_c: Vector[Batch]) -> Array:
    """
    Return by how much the point of Case 2's linear system misses the unit circle.

    With the solution (cosine, sine) / determinant of eqs. 15 and 16 that is cosine^2 + sine^2 -
    determinant^2, which is 0 for angles that fit together and needs no division.

    Parameters
    ----------
    leg_b, leg_c : tuple of 3 ndarray, each of shape (m, n)
        The equations of the legs B and C for th2A.

    Returns
    -------
    ndarray, shape (m, n)
        Closure error (unit 1).

    """
    cosine, sine, determinant = leg_kernels.common_turn(leg_b, leg_c)
    return np.asarray(cosine * cosine + sine * sine - determinant * determinant)
