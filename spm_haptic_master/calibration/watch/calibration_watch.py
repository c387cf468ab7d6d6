# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A slow watch on the calibration: which sensor drifted since, long before that is a fault."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees

import numpy as np
from spm_haptic_master.calibration.watch import slip_evidence
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import rotation_distance

# Samples after which one counts a third (samples): five minutes of motion at one a second. White
# noise of 0.04 deg is then 0.005 deg in a slip.
MEMORY = 300
# Turn of the platform from the sample counted last, below which one is not counted (rad): rest
# adds nothing, and does not let the other poses be forgotten.
LEAST_TURN = 0.02
# Largest number of poses that are kept: far more than a workspace has.
POSES = 256
# Part of the threshold below which a drift is over (unit 1).
HYSTERESIS = 0.8


class CalibrationWatch:
    """
    Follows the slow parity of samples that come about once a second.

    Older samples count less and less (`MEMORY`). It names a drift long before that is a fault, and
    is not on the way of a sample: the caller gives it one now and then.

    Parameters
    ----------
    sigma : sequence of float
        White noise of each reading, rad, 1 standard deviation.
    bias : sequence of float
        Bound of each sensor's systematic error, rad.
    geometry : Geometry
        Link angles and axes of the mechanism.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.

    Attributes
    ----------
    evaluation : Evaluation or None
        Latest evaluation; None before the first one.
    caution : str
        What drifted, in words; empty while the calibration holds.

    """

    def __init__(
        self,
        sigma: Sequence[float],
        bias: Sequence[float],
        geometry: Geometry,
        working_mode: WorkingMode,
    ) -> None:
        sensors = len(sigma)
        self._sigma = np.array(sigma)
        self._bias = np.array(bias)
        self._geometry = geometry
        self._working_mode = working_mode
        # Row of each pose in the sums.
        self._rows: dict[tuple[int, ...], int] = {}
        self._sums = slip_evidence.PoseSums(
            samples=np.zeros(POSES),
            information=np.zeros((POSES, sensors, sensors)),
            score=np.zeros((POSES, sensors)),
        )
        self._last: Quaternion[float] | None = None
        self.evaluation: slip_evidence.Evaluation | None = None
        self.caution = ''

    def take(
        self,
        quaternion: Quaternion[float],
        angles: tuple[float, ...],
    ) -> bool:
        """
        Take a sample; return whether it counts.

        One within `LEAST_TURN` of the last that counted does not, nor one without a parity.

        Parameters
        ----------
        quaternion : tuple of 4 float
            R_base_platform without a mounting, x, y, z, w.
        angles : tuple of float
            Readings of the N sensors, rad.

        Returns
        -------
        bool
            True if the sample was added to the sums.

        """
        if self._last is not None and rotation_distance(quaternion, self._last) < LEAST_TURN:
            return False
        found = slip_evidence.parity_of_sample(
            angles,
            quaternion,
            self._sigma,
            self._geometry,
            self._working_mode,
        )
        if found is None:
            return False
        self._last = quaternion
        for each in self._sums:
            each *= 1.0 - 1.0 / MEMORY
        sample = np.array([angles])
        row = self._row(tuple(slip_evidence.poses_of(sample)[0].tolist()))
        for total, of_one in zip(self._sums, slip_evidence.summed(sample, found), strict=True):
            total[row] += of_one[0]
        return True

    def _row(self, pose: tuple[int, ...]) -> int:
        """Return the row of a pose; a new one replaces the one with the least weight."""
        row = self._rows.get(pose)
        if row is None:
            row = int(self._sums.samples.argmin())
            self._rows = {other: place for other, place in self._rows.items() if place != row}
            self._rows[pose] = row
            for each in self._sums:
                each[row] = 0.0
        return row

    def evaluate(self) -> None:
        """
        Evaluate the samples taken so far: set `evaluation` and `caution`.

        A caution stays until the evidence is below `HYSTERESIS` times the limits.
        """
        if not self._rows:
            return
        found = self.evaluation = slip_evidence.evaluate(self._sums, self._bias)
        if found.holds(HYSTERESIS if self.caution else 1.0):
            self.caution = ''
        else:
            self.caution = _words(found)


def _words(found: slip_evidence.Evaluation) -> str:
    """
    Return what drifted, in words.

    These are the sensors that may have drifted, or the slow parity if no single one explains it.
    """
    which = slip_evidence.suspects(found.misfit - found.explained, found.freedom, found.limit)
    names = [ALL_JOINT_NAMES[sensor] for sensor in which]
    if not names:
        return f'slow parity {degrees(found.slow):.2f} deg, expected {degrees(found.expected):.2f}'
    if len(names) > 1:
        return f'{" or ".join(names)} drifted since'
    return f'{names[0]} drifted by {degrees(abs(found.slip[which[0]])):.2f} deg since'
