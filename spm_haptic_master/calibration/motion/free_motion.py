# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibration of a rig from free motion: nothing is known of it but the drawing and its tolerances.

First the zeros and directions, then the parameters that the motion determines and that a part of
it that was held out confirms, then all samples together; and guidance during the motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import degrees, radians

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion import coverage, fit, misfit
from spm_haptic_master.calibration.motion.calibration import MotionCalibration
from spm_haptic_master.calibration.motion.model import Array, Layout, MotionModel
from spm_haptic_master.calibration.motion.noise import allowed_noise
from spm_haptic_master.calibration.motion.readings import motion_readings, MotionReadings
from spm_haptic_master.calibration.motion.tolerances import estimated_tolerances
from spm_haptic_master.calibration.motion.zero_search import find_start, Progress, Start
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Samples of the fit of the zeros, and of the choice of the parameters.
CHOICE_SAMPLES = 3000
# Predicted orientation error of the zeros alone beyond which a motion does not determine them
# (rad).
ZEROS_LIMIT = radians(0.2)
# Least travel of the joints with which a search for the zeros can succeed (deg).
TRAVEL_DEG = 25.0
# Number of means that the information so far is computed from.
OUTLOOK_SAMPLES = 500


def calibrate_motion(
    layout: Layout,
    stamps: NDArray[np.int64],
    readings: Array,
    given: Sequence[int] | None = None,
    progress: Progress = lambda text, share: None,
    swaps: bool = True,
) -> MotionCalibration:
    """
    Return the calibration of a rig by a free motion.

    Spikes are removed, zeros and directions found by a search, then `fitted` does the rest.

    Parameters
    ----------
    layout : Layout
        The rig as drawn, with the largest tolerances that it may have.
    stamps : ndarray of int, shape (n,)
        Times of the sets, ns.
    readings : ndarray, shape (n, N)
        Angles by the counts alone (direction 1, zero 0), rad.
    given : sequence of int or None, optional
        Configured directions, 1 or -1, that the motion has to confirm; by default any are right.
    progress : callable, optional
        Takes the name of each stage and the share that is done, 0 to 1.
    swaps : bool, optional
        Whether exchanged encoders are looked for, to name them in the error.

    Returns
    -------
    MotionCalibration
        Parameters, their covariance, and what they were computed from.

    Raises
    ------
    CalibrationError
        The motion does not determine the zeros, contradicts the drawing or the directions given,
        or two encoders are swapped.

    """
    fit.held_out_part((stamps - stamps[0]) * 1e-9)  # refuses a motion that is too short
    means = motion_readings(stamps, readings)
    start = find_start(means, MotionModel(layout, means.sigma), progress, swaps)
    wrong = [
        f'{joint} turns with direction {sign:+d}, encoders.direction has {other:+d}'
        for joint, sign, other in zip(
            ALL_JOINT_NAMES,
            start.direction,
            given or (),
            strict=False,
        )
        if sign != other
    ]
    if wrong:
        raise CalibrationError('; '.join(wrong))
    return fitted(layout, means, start, progress)


def fitted(
    layout: Layout,
    means: MotionReadings,
    start: Start,
    progress: Progress = lambda text, share: None,
) -> MotionCalibration:
    """
    Return the calibration by a motion whose zeros and directions are known approximately.

    The zeros are fitted first, then the groups of parameters are chosen (`fit.choose`), and all
    samples are fitted. Slips are refused, and noise and tolerances found before the last fit, from
    which the covariance follows.

    Parameters
    ----------
    layout : Layout
        The rig as drawn, with the largest tolerances that it may have.
    means : MotionReadings
        Means of the motion's readings.
    start : Start
        Directions, and zeros near the true ones.
    progress : callable, optional
        Takes the name of each stage and the share that is done, 0 to 1.

    Returns
    -------
    MotionCalibration
        Parameters, their covariance, and what they were computed from.

    Raises
    ------
    CalibrationError
        The motion does not determine the zeros, or an encoder slipped or drifted in it.

    """
    model = MotionModel(layout, means.sigma)
    turned = means.readings * np.array(start.direction)
    choice = _choose(model, turned, means, start, progress)
    columns = choice.columns
    progress('all parameters, whole motion', 0.8)
    rotation = model.orientations(turned, choice.vector)
    first = fit.fit(model, turned, choice.vector, columns, rotation)
    misfit.check_slip(model, turned, means.seconds, first)
    noise = allowed_noise(model, turned, first.vector, first.normal)
    white = MotionModel(layout, noise)
    progress('all parameters, with noise and tolerances as found', 0.9)
    estimated = _as_found(white, turned, means, first)
    found = fit.fit(estimated, turned, first.vector, columns, first.normal.rotation)
    progress('errors', 0.95)
    rotation = found.normal.rotation
    every = tuple(range(layout.count))
    normal = fit.normal_equations(estimated, turned, rotation, found.vector, every)
    deviations = estimated.layout.deviations
    slow = misfit.slow_parity(means.seconds, found.normal)
    unexplained = misfit.unexplained_errors(
        estimated,
        turned,
        found.vector,
        found.normal,
        slow,
    )
    return MotionCalibration(
        model=white,
        vector=found.vector,
        covariance=fit.considered_covariance(normal.matrix, deviations, columns),
        information=normal.matrix,
        estimated=columns,
        left=choice.left,
        direction=start.direction,
        readings=means,
        rotation=rotation,
        kept=found.normal.kept,
        drawn=choice.drawn,
        unexplained=unexplained,
        unexplained_parity=slow * float(estimated.sigma.max()),
        advice=choice.advice,
        advice_gain=choice.advice_gain,
        contradiction=misfit.contradiction(model, turned, first),
    )


@dataclass(frozen=True, slots=True)
class _Choice:
    """
    The parameters that a motion determines, by some of its samples.

    Attributes
    ----------
    drawn : ndarray, shape (P,)
        Parameters with the zeros alone fitted, rad.
    vector : ndarray, shape (P,)
        Parameters with all that are chosen, rad.
    columns : tuple of int
        Places of the chosen parameters.
    left : dict of str to str
        Groups that are left as drawn, and why.
    advice : str
        The further motion that would determine most.
    advice_gain : float
        What it would gain (unit 1).

    """

    drawn: Array
    vector: Array
    columns: tuple[int, ...]
    left: dict[str, str]
    advice: str
    advice_gain: float


def _choose(
    model: MotionModel,
    turned: Array,
    means: MotionReadings,
    start: Start,
    progress: Progress,
) -> _Choice:
    """
    Fit the zeros, and choose the groups of parameters that the motion determines.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    means : MotionReadings
        Means of the motion's readings.
    start : Start
        Directions, and zeros near the true ones.
    progress : callable
        Takes the name of each stage and the share that is done, 0 to 1.

    Returns
    -------
    _Choice
        The choice, by `CHOICE_SAMPLES` samples.

    Raises
    ------
    CalibrationError
        The motion does not determine the zeros.

    """
    step = max(1, len(turned) // CHOICE_SAMPLES)
    rows = np.arange(0, len(turned), step)
    factor = len(turned) / len(rows)
    progress('zeros', 0.5)
    zeros = range(model.layout.sensors)
    first = fit.fit(
        model,
        turned[rows],
        start.vector,
        zeros,
    )
    _, gains = _outlook(model, means, start)
    advice, gain = next(iter(gains.items()))
    _check_zeros(model, first, factor, advice)
    vector, columns, left = fit.choose(
        model,
        turned[rows],
        means.seconds[rows],
        first,
        factor,
        lambda group, number: progress(group, 0.5 + 0.05 * number),
    )
    return _Choice(
        drawn=first.vector,
        vector=vector,
        columns=columns,
        left=left,
        advice=advice,
        advice_gain=gain,
    )


def _check_zeros(
    model: MotionModel,
    first: fit.Fit,
    factor: float,
    advice: str,
) -> None:
    """
    Raise CalibrationError where a motion leaves the zeros open.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    first : fit.Fit
        Fit of the zeros.
    factor : float
        Number of the samples of the whole motion over that of the fit.
    advice : str
        What to do about it, in words.

    """
    poses = coverage.WORKSPACE.poses(model, first.vector)
    changes = coverage.aligned_changes(model, poses, first.vector)
    error = coverage.orientation_error(
        changes[:, :, : model.layout.sensors], coverage.inverse(first.normal.matrix * factor)
    )
    if error > ZEROS_LIMIT:
        raise CalibrationError(
            'the motion does not determine the zeros: they leave a predicted error of '
            f'{degrees(error):.2f} deg, limit {degrees(ZEROS_LIMIT):g} deg; {advice}'
        )


def _as_found(
    white: MotionModel,
    turned: Array,
    means: MotionReadings,
    found: fit.Fit,
) -> MotionModel:
    """
    Return a model with the noise and the tolerances that a fit shows.

    The slow part of the parity counts as noise (`misfit.slow_factor`), and the tolerances are
    those of empirical Bayes (`estimated_tolerances`).

    Parameters
    ----------
    white : MotionModel
        The model with the white noise of the means.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    means : MotionReadings
        Means of the motion's readings.
    found : fit.Fit
        Result of the fit.

    Returns
    -------
    MotionModel
        The same mechanism.

    """
    normal = fit.normal_equations(
        white,
        turned,
        found.normal.rotation,
        found.vector,
        found.columns,
    )
    slow = misfit.slow_factor(means.seconds, normal)
    sigma = white.sigma * np.sqrt(slow)
    layout = estimated_tolerances(
        white.layout,
        found.vector,
        found.columns,
        normal.matrix / slow,
    )
    return MotionModel(layout, sigma)


@dataclass(frozen=True, slots=True)
class Guidance:
    """
    State of a motion that is being recorded.

    Attributes
    ----------
    error : float or None
        Predicted error of the orientations over the workspace, rad rms; None while the zeros
        are unknown.
    text : str
        What to do next.
    covered : mapping of str to float
        Variance of the orientations' error after more of a motion over that without, by
        instruction. While the zeros are unknown: how far each joint has moved of what the search
        for them needs, 0 to 1.

    """

    error: float | None
    text: str
    covered: Mapping[str, float]


class Guide:
    """
    Evaluates a motion while it is recorded.

    It searches for the zeros once the joints have moved far enough, and keeps what it found.

    Parameters
    ----------
    layout : Layout
        The rig as drawn, with the largest tolerances that it may have.

    """

    def __init__(self, layout: Layout):
        self._layout = layout
        self._start: Start | None = None
        self._searched = 0.0

    def evaluate(
        self,
        stamps: NDArray[np.int64],
        readings: Array,
    ) -> Guidance:
        """
        Return what the motion so far determines, and what to do next.

        Parameters
        ----------
        stamps : ndarray of int, shape (n,)
            Times of the sets, ns.
        readings : ndarray, shape (n, N)
            Angles by the counts alone (direction 1, zero 0), rad.

        Returns
        -------
        Guidance
            Predicted error and instruction; the reason in words where the motion is still too
            short.

        """
        try:
            means = motion_readings(stamps, readings)
        except CalibrationError as error:
            return Guidance(
                error=None,
                text=str(error),
                covered={},
            )
        model = MotionModel(self._layout, means.sigma)
        turned = np.unwrap(means.readings, axis=0)
        travel = np.degrees(np.ptp(turned, axis=0))
        moved = {
            joint: min(1.0, float(each) / TRAVEL_DEG)
            for joint, each in zip(ALL_JOINT_NAMES, travel, strict=False)
        }
        if self._start is None:
            lacking = 'the zeros are not determined yet'
            # Each search takes seconds: again when the motion has become half as long again.
            if travel.min() < TRAVEL_DEG or means.seconds[-1] < 1.5 * self._searched:
                joint = int(travel.argmin())
                lacking = f'{ALL_JOINT_NAMES[joint]} has moved by {travel[joint]:.0f} deg'
            else:
                self._searched = float(means.seconds[-1])
                with suppress(CalibrationError):
                    self._start = find_start(means, model, swaps=False)
            if self._start is None:
                return Guidance(
                    error=None,
                    text=f'tilt the handle in all directions and turn it both ways ({lacking})',
                    covered=moved,
                )
        predicted, further = _outlook(model, means, self._start)
        return Guidance(
            error=predicted,
            text=f'predicted error {degrees(predicted):.3f} deg; {next(iter(further))}',
            covered={text: 1.0 / further[text] for text in further},
        )


def _outlook(
    model: MotionModel,
    means: MotionReadings,
    start: Start,
) -> tuple[float, dict[str, float]]:
    """
    Return what a motion will leave open.

    Returns
    -------
    error : float
        Predicted error of the orientations over the workspace, rad rms.
    gains : dict of str to float
        Of `coverage.further_motions`.

    """
    step = max(1, len(means.readings) // OUTLOOK_SAMPLES)
    chosen = np.arange(0, len(means.readings), step)
    turned = means.readings[chosen] * np.array(start.direction)
    rotation = model.orientations(turned, start.vector)
    normal = fit.normal_equations(
        model,
        turned,
        rotation,
        start.vector,
        tuple(range(model.layout.count)),
    )
    information = normal.matrix * (len(means.readings) / len(chosen)) + np.diag(
        model.layout.deviations**-2.0
    )
    changes = coverage.aligned_changes(
        model,
        coverage.WORKSPACE.poses(model, start.vector),
        start.vector,
    )
    return (
        coverage.orientation_error(changes, coverage.inverse(information)),
        coverage.further_motions(
            model,
            start.vector,
            information,
            means.rate,
            changes,
        ),
    )
