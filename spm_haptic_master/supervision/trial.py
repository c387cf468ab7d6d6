# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Sets of sensors on trial: since when each has agreed, and where the orientation is by it.

Each trial tests one hypothesis: the sensors left out of the set are wrong, those in it are right.
Then the set agrees in every sample, and its orientation turns no faster than a human. A set that
fails starts again; a set of three does not, because it always agrees.

That no orientation is found is no evidence against a set, nor is one that does not continue: where
two solutions of its sensors meet, noise alone makes it so. The hypothesis is contradicted if the
readings of the set cannot be explained near where it was.
"""

from __future__ import annotations

from dataclasses import replace

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import is_within
from spm_haptic_master.supervision.parity import WINDOW_SAMPLES
from spm_haptic_master.supervision.sample import Place, Sample
from spm_haptic_master.supervision.sensor_set import SensorSet
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom


class Trial:
    """
    A set of sensors that may take over: it has to agree, sample by sample, and to continue.

    Parameters
    ----------
    sensor_set : SensorSet
        The set; its window restarts.
    place : Place or None
        Where the platform was before the first sample, if what is left out is wrong; None if that
        is not known.
    since : int or None
        Stamp from which the set is known to agree, ns; None: from its first sample that does.
        Three sensors always agree: without a stamp, or once they do not continue, they fail.

    Attributes
    ----------
    sensor_set : SensorSet
        The set, with its estimate of the latest sample.
    place : Place or None
        Where the platform was when the set last agreed; None if that is not known.
    has_failed : bool
        Whether a sample contradicted its hypothesis.
    is_conclusive : bool
        Whether samples can show that the set agrees. Three sensors always agree: their samples
        show it only if the motion was known shortly before, or the place is not known at all.

    """

    def __init__(
        self,
        sensor_set: SensorSet,
        place: Place | None,
        since: int | None,
    ) -> None:
        self.sensor_set = sensor_set
        self.place = place
        # Stamp (ns) since when it has agreed in every sample, and their number.
        self._since = since
        self._samples = 0
        self.has_failed = False
        # Where the set explained the readings last, or the platform was before; None: not known.
        self._near = None if place is None else place.quaternion
        self.is_conclusive = sensor_set.parity_count > 0 or since is not None or place is None
        sensor_set.restart()

    def follow(self, sample: Sample, speed: float) -> bool:
        """
        Solve a sample; return whether the set agrees, and turned no faster than a human.

        The prior is the place of this hypothesis, not the published orientation. `speed` is the
        human motion limit of the rotation, rad/s.
        """
        if self._near is None and sample.prior is not None:
            self._near = sample.prior.quaternion
        place = self.place
        is_recent = place is not None and place.is_recent_at(sample.stamp)
        own = replace(sample, prior=place if is_recent else None)
        symptom = self.sensor_set.solve(own)
        if symptom is not None or not self._continues(own, speed):
            self.has_failed = self.has_failed or self._is_contradicted(own, symptom, speed)
            self._since = None
            self._samples = 0
            return False
        if self._since is None:
            self._since = sample.stamp
        self._samples += 1
        if self.sensor_set.estimate is not None:
            self._near = self.sensor_set.estimate.quaternion
            self.place = Place(sample.stamp, self._near)
        return True

    def _is_contradicted(self, sample: Sample, symptom: Symptom | None, speed: float) -> bool:
        """
        Whether a sample with which the set does not go on contradicts its hypothesis.

        One that determines no orientation does not, as where two solutions meet; nor does any
        sample of three sensors without a known motion.

        Parameters
        ----------
        sample : Sample
            The sample.
        symptom : Symptom or None
            What contradicts it; None if its orientation does not continue the trial.
        speed : float
            Human motion limit of the rotation, rad/s.

        """
        if self._is_motion_unknown or self._determines_none(symptom):
            return False
        if symptom is not None and symptom.reason is not Reason.NO_FIT:
            return True
        explaining = self.sensor_set.explaining(sample, self._near)
        if explaining is None:
            return True
        self._near = explaining
        return symptom is None and not self._is_in_reach(sample, explaining, speed)

    def _determines_none(self, symptom: Symptom | None) -> bool:
        """Whether the latest sample determines no orientation."""
        if symptom is not None:
            return symptom.severity is Severity.WITHHOLD
        estimate = self.sensor_set.estimate
        return estimate is None or not estimate.determined

    @property
    def _is_motion_unknown(self) -> bool:
        """Whether three sensors are on trial without a motion that the next sample continues."""
        return not self.sensor_set.parity_count and self._since is None

    def _continues(self, sample: Sample, speed: float) -> bool:
        """Whether a sample continues the trial: determined, and in reach of `place`."""
        estimate = self.sensor_set.estimate
        if estimate is None or not estimate.determined or self._is_motion_unknown:
            return False
        return self._is_in_reach(sample, estimate.quaternion, speed)

    def _is_in_reach(
        self,
        sample: Sample,
        quaternion: Quaternion[float],
        speed: float,
    ) -> bool:
        """Whether a human can have turned the platform from `place` to an orientation."""
        place = self.place
        worth = self.sensor_set.worth
        if place is None or worth is None:
            return True
        # The place may be by other sensors, with other noise and bias.
        turn = speed * sample.time_since(place.stamp) + 2.0 * worth.healthy
        return is_within(quaternion, place.quaternion, turn)

    def passes(self, stamp: int, onset: int, time: float) -> bool:
        """Whether the set has agreed since before a fault (`onset`, ns), or for a time, s."""
        has_agreed_before = self._since is not None and self._since < onset
        return has_agreed_before or self.has_agreed_for(stamp, time)

    def has_agreed_for(self, stamp: int, time: float) -> bool:
        """Whether the set has agreed for a time, s, and in `WINDOW_SAMPLES`, at a stamp, ns."""
        if self._since is None or self._samples < WINDOW_SAMPLES:
            return False
        return stamp - self._since >= round(time * 1e9)
