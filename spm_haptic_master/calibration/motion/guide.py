# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a motion that is being recorded determines so far, and how to go on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import degrees

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.coverage import (
    aligned_changes,
    inverse,
    orientation_error,
    Proposal,
    proposals,
)
from spm_haptic_master.calibration.motion.error_bound import WORKSPACE
from spm_haptic_master.calibration.motion.fit import normal_equations
from spm_haptic_master.calibration.motion.mechanism_parameters import Array, layout_of, Tolerances
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.calibration.motion.readings import motion_readings, MotionReadings
from spm_haptic_master.calibration.motion.start import MotionStart, Start
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry

# Least travel of the joints with which a search for the zeros can succeed (deg).
TRAVEL_DEG = 25.0
# Number of means that the information is computed from.
SAMPLES = 500


@dataclass(frozen=True, slots=True)
class Guidance:
    """
    State of a motion.

    Attributes
    ----------
    error : float or None
        Predicted error of the orientation over the workspace if it ended here, rad rms; None as
        long as the zeros are unknown.
    text : str
        What to do next.
    covered : mapping of str to float
        How far each kind of motion has been made, 0 .. 1, by its instruction: the variance of the
        orientation error after more of it, over that without. As long as the zeros are unknown:
        how far each joint has moved of what the search for them needs.

    """

    error: float | None
    text: str
    covered: Mapping[str, float] = field(default_factory=dict)


class Guide:
    """
    Evaluates a motion while it is recorded.

    Parameters
    ----------
    nominal : Geometry
        The drawing.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.
    tolerances : Tolerances
        How far the rig may be from the drawing.

    """

    def __init__(self, nominal: Geometry, working_mode: tuple[int, int, int],
                 tolerances: Tolerances):
        self._nominal = nominal
        self._working_mode = working_mode
        self._tolerances = tolerances
        self._start: Start | None = None
        self._searched = 0.0

    def evaluate(self, stamps: NDArray[np.int64], readings: Array) -> Guidance:
        """
        Return what the motion so far determines.

        Parameters
        ----------
        stamps : ndarray of int, shape (n,)
            Times, ns.
        readings : ndarray, shape (n, N)
            Angles by the counts alone, rad.

        """
        try:
            means = motion_readings(stamps, readings)
        except CalibrationError as error:
            return Guidance(None, str(error))
        model = MotionModel(layout_of(self._nominal, readings.shape[1]), self._working_mode,
                            means.sigma)
        travel = np.degrees(np.ptp(np.unwrap(means.readings, axis=0), axis=0))
        moved = {joint: min(1.0, float(each) / TRAVEL_DEG)
                 for joint, each in zip(ALL_JOINT_NAMES, travel, strict=False)}
        if self._start is None:
            # Each search takes seconds: again when the motion has become half as long again.
            if travel.min() < TRAVEL_DEG or means.seconds[-1] < 1.5 * self._searched:
                joint = int(travel.argmin())
                return Guidance(None, 'tilt the handle in all directions and turn it both ways '
                                f'({ALL_JOINT_NAMES[joint]} has moved by {travel[joint]:.0f} deg)',
                                moved)
            self._searched = float(means.seconds[-1])
            try:
                self._start = MotionStart(self._tolerances).find(means, model, swaps=False)
            except CalibrationError:
                return Guidance(None, 'tilt the handle in all directions and turn it both ways '
                                '(the zeros are not determined yet)', moved)
        predicted, further = outlook(
            model, means, self._start, model.layout.deviations(self._tolerances))
        # Several motions may have the same instruction: the one that has most to give comes first.
        covered: dict[str, float] = {}
        for each in further:
            covered.setdefault(each.text, 1.0 / each.gain)
        return Guidance(
            predicted, f'predicted error {degrees(predicted):.3f} deg; {further[0].text}', covered)


def outlook(model: MotionModel, means: MotionReadings, start: Start,
            deviations: Array) -> tuple[float, list[Proposal]]:
    """
    Return the error of the orientation over the workspace that a motion leaves, and what is next.

    The advice while the device moves and after it is the same: both are computed here.

    Parameters
    ----------
    model : MotionModel
        Mechanism with encoders, with white noise.
    means : MotionReadings
        The motion.
    start : Start
        Its zeros and directions.
    deviations : ndarray, shape (P,)
        Standard deviations of the parameters before the fit, rad; inf: none.

    Returns
    -------
    error : float
        rad rms.
    proposals : list of Proposal
        Further motions, the one that determines most first.

    """
    chosen = np.arange(0, len(means.readings), max(1, len(means.readings) // SAMPLES))
    turned = means.readings[chosen] * np.array(start.direction)
    rotation = model.orientations(turned, start.vector)
    normal = normal_equations(model, turned, rotation, start.vector,
                              tuple(range(model.layout.count)))
    information = normal.matrix * (len(means.readings) / len(chosen)) + np.diag(
        deviations ** -2.0)
    changes = aligned_changes(model, WORKSPACE.poses(model, start.vector), start.vector)
    return (orientation_error(changes, inverse(information)),
            proposals(model, start.vector, information, means.rate, changes))
