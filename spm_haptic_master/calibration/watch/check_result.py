# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a check of a calibration found: which sensor changed, in words."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees

from spm_haptic_master.calibration.watch.sample_parity import Array
from spm_haptic_master.calibration.watch.slip_evidence import Evaluation
from spm_haptic_master.joints import ALL_JOINT_NAMES


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
        Standard deviation of the slip by noise and by what `bias_deg` allows, rad.
    left : float
        Misfit that it leaves (unit 1); inf where the angles fit nothing.
    fits : bool
        Whether noise and bias explain what it leaves, or the harmonics of an encoder that is
        another way round.
    explains : bool
        Whether noise and bias do.

    """

    sensor: int
    turned: bool
    slip: float
    deviation: float
    left: float
    fits: bool
    explains: bool

    @property
    def text(self) -> str:
        """Return what changed, in words."""
        name = ALL_JOINT_NAMES[self.sensor]
        if self.turned:
            return f'{name} turns with the other direction'
        return (f'{name} slipped by {degrees(self.slip):+.2f} deg '
                f'(+- {degrees(self.deviation):.2f})')


@dataclass(frozen=True, slots=True)
class Check:
    """
    Result of a check.

    Attributes
    ----------
    evaluation : Evaluation or None
        Of the calibration as it is; None where the angles fit nothing.
    usable : float
        Part of the samples that have an orientation with it (unit 1).
    poses : int
        Number of independent poses.
    changed : Hypothesis or None
        The sensor that alone changed; None where none did or it is not isolated.
    several : ndarray, shape (N,), or None
        Slips of the sensors, rad, where no single one explains the angles and all of them do.
    candidates : tuple of Hypothesis
        What explains the angles nearly as well, the best first; empty where the calibration holds
        or no single sensor explains them.

    """

    evaluation: Evaluation | None
    usable: float
    poses: int
    changed: Hypothesis | None
    candidates: tuple[Hypothesis, ...]
    several: Array | None = None

    @property
    def holds(self) -> bool:
        """Whether the calibration holds for the motion."""
        return self.evaluation is not None and self.evaluation.holds

    @property
    def text(self) -> str:
        """Return what changed, in one line."""
        if self.changed is not None:
            return self.changed.text
        if self.several is not None:
            return 'several zeros moved: ' + ', '.join(
                f'{name} by {degrees(slip):+.2f} deg' for name, slip in zip(
                    ALL_JOINT_NAMES, self.several, strict=False))
        if self.candidates:
            return 'not isolated: ' + ', or '.join(each.text for each in self.candidates)
        if self.evaluation is None:
            return (f'only {100.0 * self.usable:.0f} % of the angles fit the mechanism, and no '
                    'change of one sensor explains that')
        return (f'the slow parity is {degrees(self.evaluation.slow):.2f} deg rms, expected '
                f'{degrees(self.evaluation.expected):.2f}, and no change of one sensor explains '
                'that')
