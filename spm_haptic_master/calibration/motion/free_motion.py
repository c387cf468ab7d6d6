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
from math import degrees, radians

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.calibration import (
    MotionCalibration,
    over_region,
    UNUSUAL,
)
from spm_haptic_master.calibration.motion.coverage import (
    aligned_changes,
    inverse,
    orientation_error,
    Proposal,
)
from spm_haptic_master.calibration.motion.error_bound import WORKSPACE
from spm_haptic_master.calibration.motion.fit import Fit, fit, normal_equations
from spm_haptic_master.calibration.motion.guide import outlook
from spm_haptic_master.calibration.motion.mechanism_parameters import Array, layout_of, Tolerances
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.calibration.motion.parameter_choice import (
    Choice,
    considered_covariance,
    held_out_part,
    ParameterChoice,
)
from spm_haptic_master.calibration.motion.readings import motion_readings, MotionReadings
from spm_haptic_master.calibration.motion.slip_in_motion import slip_in_motion
from spm_haptic_master.calibration.motion.slow_errors import (
    contradiction,
    slow_factor,
    unexplained_errors,
)
from spm_haptic_master.calibration.motion.start import MotionStart, Start
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry

# Samples of the fit of the zeros, and of which the orientations' errors are predicted.
CHOICE_SAMPLES = 3000
# Predicted orientation error of the zeros alone beyond which a motion does not determine them
# (rad).
ZEROS_LIMIT = radians(0.2)


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
        held_out_part((stamps - stamps[0]) * 1e-9)  # refuses a motion that is too short
        means = motion_readings(stamps, readings)
        layout = layout_of(self._nominal, readings.shape[1])
        model = MotionModel(layout, self._working_mode, means.sigma)
        start = MotionStart(self._tolerances, self._progress).find(means, model)
        _check_directions(start.direction, given)
        return self._fitted(means, model, start)

    def _fitted(self, means: MotionReadings, model: MotionModel,
                start: Start) -> MotionCalibration:
        layout = model.layout
        turned = means.readings * np.array(start.direction)
        deviations = layout.deviations(self._tolerances)
        zeros = [*range(layout.sensors)]
        chosen = np.arange(0, len(turned), max(1, len(turned) // CHOICE_SAMPLES))
        factor = len(turned) / len(chosen)
        self._progress('zeros', 0.5)
        first = fit(model, turned[chosen], start.vector, zeros, deviations)
        advice = tuple(outlook(model, means, start, deviations)[1])
        self._check_zeros(model, first, factor, advice[0])
        choice = ParameterChoice(model, deviations, factor).choose(
            turned[chosen], means.seconds[chosen], first,
            lambda group, number: self._progress(group, 0.5 + 0.05 * number))
        self._progress('all parameters, whole motion', 0.8)
        rotation = model.orientations(turned, choice.vector)
        whole = fit(model, turned, choice.vector, choice.columns, deviations, rotation,
                    lambda: self._progress('all parameters, whole motion', 0.85))
        slip = slip_in_motion(model, turned, whole.normal.rotation, means.seconds, whole.vector,
                              choice.columns, deviations)
        if slip is not None:
            raise CalibrationError(slip.text)
        split = contradiction(model, turned, whole, deviations)
        slow = slow_factor(means.seconds, whole.normal)
        if slow > 1.0:
            model = MotionModel(layout, self._working_mode, model.sigma * np.sqrt(slow))
            whole = fit(model, turned, whole.vector, choice.columns, deviations,
                        whole.normal.rotation,
                        lambda: self._progress('all parameters, whole motion', 0.9))
        self._progress('errors', 0.95)
        return self._result(means, model, start, first, whole, choice, turned, split, advice)

    def _check_zeros(self, model: MotionModel, first: Fit, factor: float,
                     advice: Proposal) -> None:
        """Raise CalibrationError if a motion does not even determine the zeros."""
        changes = aligned_changes(model, WORKSPACE.poses(model, first.vector), first.vector)
        zeros = slice(model.layout.sensors)
        error = orientation_error(changes[:, :, zeros], inverse(first.normal.matrix * factor))
        if error > ZEROS_LIMIT:
            raise CalibrationError(
                'the motion does not determine the zeros: they leave a predicted error of '
                f'{degrees(error):.2f} deg, limit {degrees(ZEROS_LIMIT):g} deg; {advice.text}')

    def _result(self, means: MotionReadings, model: MotionModel, start: Start, first: Fit,
                whole: Fit, choice: Choice, turned: Array,
                split: float, advice: tuple[Proposal, ...]) -> MotionCalibration:
        layout = model.layout
        deviations = layout.deviations(self._tolerances)
        every = tuple(range(layout.count))
        rotation = whole.normal.rotation
        normal = normal_equations(model, turned, rotation, whole.vector, every)
        covariance = considered_covariance(normal.matrix, deviations, whole.columns)
        inside = np.flatnonzero(whole.normal.kept)
        some = inside[::max(1, len(inside) // CHOICE_SAMPLES)]
        over_motion = aligned_changes(model, rotation[some], whole.vector)
        # The parity in rad of one standard deviation.
        scale = float(np.sqrt(np.mean(model.sigma ** 2)))
        parity = whole.normal.parity * scale
        before = normal_equations(model, turned, model.orientations(turned, first.vector),
                                  first.vector, ()).parity * scale
        unexplained = unexplained_errors(model, turned, means.seconds, whole.vector, whole.normal)
        return over_region(MotionCalibration(
            layout, whole.vector, covariance, whole.columns, choice.left, start.direction,
            means.noise, unexplained, means, rotation, parity[:, 0], before[:, 0],
            orientation_error(over_motion, covariance), 0.0, WORKSPACE, unexplained,
            advice, tuple(
                name for name, value, each in zip(
                    layout.names, whole.vector, deviations, strict=True)
                if abs(value) > UNUSUAL * each),
            split, 1.0 - float(whole.normal.kept.mean())), model, WORKSPACE)


def _check_directions(found: tuple[int, ...], given: Sequence[int] | None) -> None:
    """Raise CalibrationError if directions that were given are not those found."""
    if given is None:
        return
    wrong = [f'{joint} turns with direction {sign:+d}, encoders.direction has {other:+d}'
             for joint, sign, other in zip(ALL_JOINT_NAMES, found, given, strict=False)
             if sign != other]
    if wrong:
        raise CalibrationError('; '.join(wrong))
