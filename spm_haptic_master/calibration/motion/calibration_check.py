# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Whether a calibration still holds for a recorded motion, and which sensor changed.

One hypothesis a sensor: all others are as calibrated, this one's zero slipped, or its direction is
reversed. Small slips follow from the parity to first order. Where the angles fit nothing, each
hypothesis is tried over the whole turn on a few poses, and the best of each sensor is refined.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, radians

import numpy as np
from spm_haptic_master.calibration.motion.model import LONGEST_STEP, ROTATION_STEPS
from spm_haptic_master.calibration.motion.readings import Array, spread
from spm_haptic_master.calibration.watch import slip_evidence
from spm_haptic_master.calibration.watch.slip_evidence import Evaluation, Parities
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import forward_theta3a, Geometry
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.rotations import matrix_from_vector, wrapped

# Samples that are evaluated, evenly spread in time: 20 s at 100 Hz. Systematic errors bound the
# result, not their noise.
SAMPLES = 2000
# Part of the samples that have an orientation if a hypothesis is true (unit 1): the others are
# spikes and moments at the edge of the working mode.
USABLE = 0.9
# Slow parity up to which slips follow from it to first order (rad).
LINEAR = radians(1.0)
# Step of the slips that are tried over the turn (rad), and poses on which they are: a slip that is
# half of it off converges.
TRIED_STEP = radians(3.0)
TRIED_POSES = 40
# Refinements of a slip, and the change that ends them (rad).
REFINEMENTS = 6
REFINED = radians(0.001)
# Slow parity that a larger slip or a reversed direction may leave (rad rms): the corrections of
# the encoder's harmonics, up to 0.5 deg, belong to other angles then.
LARGE_LEFT = radians(0.3)


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """
    One sensor alone changed.

    Attributes
    ----------
    sensor : int
        Its index in ALL_JOINT_NAMES.
    turned : bool
        Whether its direction is the other one.
    slip : float
        Reading, by the right direction, less true angle, rad.
    deviation : float
        Standard deviation of the slip by noise and bias, rad.
    left : float
        Misfit that it leaves (unit 1); inf where the angles fit nothing.
    explains : bool
        Whether noise and bias explain the rest.
    fits : bool
        Whether that or, after a large change, the harmonics of an encoder at other angles explain
        the rest.

    """

    sensor: int
    turned: bool
    slip: float
    deviation: float = np.inf
    left: float = np.inf
    explains: bool = False
    fits: bool = False

    @property
    def text(self) -> str:
        """Return what changed, in words."""
        name = ALL_JOINT_NAMES[self.sensor]
        if self.turned:
            return f'{name} turns in the opposite direction'
        return (
            f'{name} slipped by {degrees(self.slip):+.2f} deg (+- {degrees(self.deviation):.2f})'
        )


@dataclass(frozen=True, slots=True)
class Check:
    """
    Result of a check.

    Attributes
    ----------
    evaluation : Evaluation or None
        Evaluation of the calibration as it is; None where the angles fit nothing.
    usable : float
        Part of the samples that have an orientation with it (unit 1).
    changed : Hypothesis or None
        The sensor that alone changed; None if none is isolated.
    candidates : tuple of Hypothesis
        What explains the angles nearly as well, best first.
    several : ndarray or None, shape (N,)
        Slips of all sensors, rad, if only all together explain the angles; else None.

    """

    evaluation: Evaluation | None
    usable: float
    changed: Hypothesis | None = None
    candidates: tuple[Hypothesis, ...] = ()
    several: Array | None = None

    @property
    def holds(self) -> bool:
        """Whether the calibration holds for the motion."""
        return self.evaluation is not None and self.evaluation.holds()

    @property
    def text(self) -> str:
        """Return what changed, in one line."""
        if self.changed is not None:
            return self.changed.text
        if self.several is not None:
            return 'several zeros moved: ' + ', '.join(
                f'{name} by {degrees(slip):+.2f} deg'
                for name, slip in zip(ALL_JOINT_NAMES, self.several, strict=False)
            )
        if self.candidates:
            return 'not isolated: ' + ', or '.join(each.text for each in self.candidates)
        return 'no change of one sensor explains the angles'


@dataclass(frozen=True, slots=True)
class CalibrationChecker:
    """
    Checks a calibration by a motion.

    Attributes
    ----------
    sigma : ndarray, shape (N,)
        White noise of a reading, rad, 1 standard deviation.
    bias : ndarray, shape (N,)
        Bound of a reading's systematic error, rad.
    geometry : Geometry
        Link angles and axes of the mechanism as calibrated.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.
    progress : callable
        Takes the stage, and the part of the whole that is done (unit 1).

    """

    sigma: Array
    bias: Array
    geometry: Geometry
    working_mode: WorkingMode
    progress: Callable[[str, float], None] = lambda text, share: None

    def check(self, angles: Array) -> Check:
        """
        Return what a motion says of the calibration.

        Some `SAMPLES` of the angles are evaluated. Where noise and bias do not explain their
        parity, each sensor alone is tried, then all of them together.

        Parameters
        ----------
        angles : ndarray, shape (n, N)
            Joint angles by the calibration, rad.

        Returns
        -------
        Check
            Whether it holds, and what changed if not.

        Raises
        ------
        CalibrationError
            The calibration holds, but so small a motion would not show a slip.

        """
        places = np.linspace(0, len(angles) - 1, SAMPLES)
        angles = angles[np.unique(places.astype(np.intp))]
        evaluation, usable = self._evaluated(angles)
        if evaluation is not None and evaluation.holds():
            self._check_decidable(evaluation)
            return Check(evaluation, usable)
        return self._changed(angles, evaluation, usable)

    def _changed(
        self,
        angles: Array,
        evaluation: Evaluation | None,
        usable: float,
    ) -> Check:
        """
        Return what explains angles that the calibration does not.

        Parameters
        ----------
        angles : ndarray, shape (n, N)
            Joint angles by the calibration, rad.
        evaluation : Evaluation or None
            Evaluation of the angles as they are; None where they fit nothing.
        usable : float
            Part of the samples that have an orientation (unit 1).

        Returns
        -------
        Check
            One sensor alone, several candidates, or all sensors together.

        """
        found = self._hypotheses(angles, evaluation)
        if evaluation is not None and not any(each.explains for each in found):
            several = self._several(angles)
            if several is not None:
                return Check(
                    evaluation=evaluation,
                    usable=usable,
                    several=several,
                )
        near = _best(found, evaluation.freedom if evaluation is not None else 0)
        candidates = tuple(each for each in near if each.fits)
        is_isolated = len(near) == 1 and near[0].fits
        return Check(
            evaluation=evaluation,
            usable=usable,
            changed=near[0] if is_isolated else None,
            candidates=candidates,
        )

    def _check_decidable(self, found: Evaluation) -> None:
        """Raise CalibrationError if a motion would not show a slip."""
        limits = slip_evidence.DECIDABLE * np.maximum(self.bias, self.sigma)
        hidden = [
            f'{name} {degrees(visible):.2f}'
            for name, visible, limit in zip(
                ALL_JOINT_NAMES,
                found.visible,
                limits,
                strict=False,
            )
            if visible > limit
        ]
        if hidden:
            raise CalibrationError(
                f'the motion is too small to decide: in {found.poses} poses only slips beyond '
                f'{", ".join(hidden)} deg would show, expected '
                f'{degrees(float(limits.max())):.2f}; tilt the handle farther in all directions '
                'and turn it farther both ways'
            )

    def _evaluated(self, angles: Array) -> tuple[Evaluation | None, float]:
        """
        Return the evaluation of angles, and the part of them that is usable.

        Returns
        -------
        evaluation : Evaluation or None
            None where fewer than `USABLE` of the samples have an orientation.
        usable : float
            Part of the samples that have one (unit 1).

        """
        found = self._solved(angles)
        usable = float(found.usable.mean())
        if usable < USABLE:
            return None, usable
        return slip_evidence.evaluate(slip_evidence.summed(angles, found), self.bias), usable

    def _solved(self, angles: Array) -> Parities:
        """
        Return the parities at the maximum-likelihood orientations.

        The closed form of the first four angles is the start of Gauss-Newton steps.

        Returns
        -------
        Parities
            Parity and gains of each sample.

        """
        rotation = forward_theta3a(angles[:, :3], angles[:, 3], self.geometry)
        for _ in range(ROTATION_STEPS + 1):
            found = slip_evidence.parities(
                angles,
                rotation,
                self.sigma,
                self.geometry,
                self.working_mode,
            )
            longest = np.abs(found.step).max(axis=1)
            near = found.usable & (longest < LONGEST_STEP)
            rotation = np.where(
                near[:, None, None],
                matrix_from_vector(found.step) @ rotation,
                np.nan,
            )
        return found

    def _hypotheses(
        self,
        angles: Array,
        evaluation: Evaluation | None,
    ) -> list[Hypothesis]:
        """
        Return the best hypothesis of each sensor.

        The slip by the evaluation is a start; where the slow parity is beyond `LINEAR`, or the
        angles fit nothing, slips over the whole turn with either direction are others.

        Parameters
        ----------
        angles : ndarray, shape (n, N)
            Joint angles, rad.
        evaluation : Evaluation or None
            Evaluation of the angles as they are; None where they fit nothing.

        Returns
        -------
        list of Hypothesis
            One for each sensor, in their order.

        """
        sensors = angles.shape[1]
        few = angles[spread(angles, TRIED_POSES)]
        found = []
        for sensor in range(sensors):
            self.progress(f'changes of {ALL_JOINT_NAMES[sensor]}', sensor / sensors)
            if evaluation:
                starts = [(False, float(evaluation.slip[sensor]))]
            else:
                starts = []
            if evaluation is None or evaluation.slow > LINEAR:
                starts += [(other, self._tried(few, sensor, other)) for other in (False, True)]
            found.append(
                min(
                    (self._refined(angles, sensor, *start) for start in starts),
                    key=lambda each: each.left,
                )
            )
        return found

    def _tried(
        self,
        angles: Array,
        sensor: int,
        other: bool,
    ) -> float:
        """
        Return the slip over the whole turn that leaves the least parity, by trying all in steps.

        Parameters
        ----------
        angles : ndarray, shape (n, N)
            Joint angles of a few poses, rad.
        sensor : int
            Index of the sensor.
        other : bool
            Whether its direction is reversed.

        Returns
        -------
        float
            Slip, rad.

        """
        slips = np.arange(-np.pi, np.pi, TRIED_STEP)
        many = np.repeat(angles[None], len(slips), axis=0)
        many[:, :, sensor] = wrapped(
            (-1.0 if other else 1.0) * many[:, :, sensor] - slips[:, None]
        )
        found = self._solved(many.reshape(-1, angles.shape[1]))
        size = np.linalg.norm(found.parity, axis=1)
        size[~found.usable] = np.inf
        # Few of the poses may have no orientation, by a spike or at the edge of the working mode.
        sizes = np.sort(size.reshape(len(slips), -1), axis=1)
        typical = sizes[:, int(USABLE * len(angles)) - 1]
        return float(slips[np.argmin(typical)])

    def _refined(
        self,
        angles: Array,
        sensor: int,
        other: bool,
        slip: float,
    ) -> Hypothesis:
        """
        Return a hypothesis with the slip that leaves the least, by Gauss-Newton.

        Parameters
        ----------
        angles : ndarray, shape (n, N)
            Joint angles, rad.
        sensor : int
            Index of the sensor.
        other : bool
            Whether its direction is reversed.
        slip : float
            Slip at the start, rad.

        Returns
        -------
        Hypothesis
            The hypothesis; `left` is inf where its angles fit nothing.

        """
        result = Hypothesis(
            sensor=sensor,
            turned=other,
            slip=slip,
        )
        for _ in range(REFINEMENTS):
            trial = angles.copy()
            trial[:, sensor] = wrapped((-1.0 if other else 1.0) * angles[:, sensor] - slip)
            found, _ = self._evaluated(trial)
            if found is None:
                return Hypothesis(
                    sensor=sensor,
                    turned=other,
                    slip=slip,
                )
            change = float(found.slip[sensor])
            slip += change
            left = found.misfit - float(found.explained[sensor])
            explains = left <= found.limit
            large = other or abs(slip) > LINEAR
            result = Hypothesis(
                sensor=sensor,
                turned=other,
                slip=float(wrapped(np.array(slip))),
                deviation=float(found.deviation[sensor]),
                left=left,
                explains=explains,
                fits=explains or large and found.slow <= LARGE_LEFT,
            )
            if abs(change) < REFINED:
                break
        return result

    def _several(self, angles: Array) -> Array | None:
        """
        Return slips of all sensors that explain the angles, by Gauss-Newton.

        Returns
        -------
        ndarray, shape (N,), or None
            Slips, rad; None where none explain the angles.

        """
        slips = np.zeros(angles.shape[1])
        for _ in range(REFINEMENTS):
            found, _ = self._evaluated(wrapped(angles - slips))
            if found is None:
                return None
            if np.abs(found.together).max() < REFINED:
                if found.misfit <= found.limit:
                    return slips
                return None
            slips = slips + found.together
        return None


def _best(
    hypotheses: list[Hypothesis],
    freedom: int,
) -> list[Hypothesis]:
    """Return the hypotheses that explain the parity about as well as the best one does."""
    left = np.array([each.left for each in hypotheses])
    return [hypotheses[sensor] for sensor in slip_evidence.suspects(left, freedom, np.inf)]
