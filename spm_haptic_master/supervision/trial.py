# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Sets of sensors on trial: since when each has agreed, and where the orientation is by it.

Each trial stands for one hypothesis: what is left out of the set is wrong, all in it is right.
Then the set agrees in every sample, and its orientation turns no faster than a human. A set that
fails starts again; a set of three does not, because it always agrees.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.supervision.anchor import PRIOR_AGE, within
from spm_haptic_master.supervision.parity import WINDOW_SAMPLES
from spm_haptic_master.supervision.sensor_set import Sample, SensorSet
from spm_haptic_master.supervision.symptom import Severity, Symptom


@dataclass(slots=True)
class Place:
    """
    An orientation at a time.

    Attributes
    ----------
    stamp : int
        Time by the supervision's clock, ns.
    quaternion : tuple of four float
        x, y, z, w of R_base_platform.

    """

    stamp: int
    quaternion: Quaternion[float]


class Trial:
    """
    A set of sensors that may take over: it has to agree, sample by sample, and to continue.

    Parameters
    ----------
    sensor_set : SensorSet
        The set; its window restarts.
    place : Place or None
        Where the platform was before the first sample, if what is left out is wrong.
    since : int or None
        Stamp from which the set is known to agree, ns; None: from its first sample that does.
        Three sensors always agree: without it, or once they do not continue, their trial fails.

    Attributes
    ----------
    set : SensorSet
        The set, with its estimate of the latest sample.
    place : Place or None
        Where the platform was when the set last agreed; None if that is not known.
    has_failed : bool
        Whether a sample contradicted it: until then its hypothesis stands.
    can_agree : bool
        Whether samples can show that the set agrees. Three sensors cannot if the place is old.

    """

    def __init__(
        self,
        sensor_set: SensorSet,
        place: Place | None,
        since: int | None,
    ) -> None:
        self.set = sensor_set
        self.place = place
        # Stamp (ns) since when it has agreed in every sample, and their number.
        self._since = since
        self._samples = 0
        self.has_failed = False
        self.can_agree = sensor_set.entries > 0 or since is not None or place is None
        sensor_set.restart()

    def follow(self, sample: Sample, speed: float) -> bool:
        """
        Take a sample; return whether the set agrees, and turned no faster than a human.

        The prior of the sample is that of this hypothesis, not the published orientation. `speed`
        is the human motion limit of the rotation, rad/s.
        """
        place = self.place
        recent = place is not None and sample.stamp - place.stamp <= PRIOR_AGE
        own = replace(
            sample,
            prior=place.quaternion if place is not None and recent else None,
            followed=None if place is None else place.stamp,
        )
        symptom = self.set.solve(own)
        if symptom is not None or not self._continues(own, speed):
            self.has_failed |= self._is_contradicted(symptom)
            self._since = None
            self._samples = 0
            return False
        if self._since is None:
            self._since = sample.stamp
        self._samples += 1
        if self.set.estimate is not None:
            self.place = Place(sample.stamp, self.set.estimate.quaternion)
        return True

    def _is_contradicted(self, symptom: Symptom | None) -> bool:
        """
        Whether a sample with which the set does not go on contradicts its hypothesis.

        Not one that determines no orientation, as where two solutions meet; nor any of three
        sensors of which no motion is known that could go on.
        """
        if not self.set.entries and self._since is None:
            return False
        if symptom is not None:
            return symptom.severity is not Severity.WITHHOLD
        estimate = self.set.estimate
        return estimate is not None and estimate.determined

    def _continues(self, sample: Sample, speed: float) -> bool:
        """Whether a sample continues the trial: determined, and in reach of `place`."""
        estimate = self.set.estimate
        worth = self.set.worth
        place = self.place
        if estimate is None or worth is None or not estimate.determined:
            return False
        if not self.set.entries and self._since is None:
            return False
        if place is None:
            return True
        # The place may be by other sensors, with other noise and bias.
        turn = speed * sample.since(place.stamp) + 2.0 * worth.healthy
        return within(estimate.quaternion, place.quaternion, turn)

    def passes(self, stamp: int, onset: int, time: float) -> bool:
        """
        Whether it has agreed ever since the fault began (`onset`, ns), or for a time (s).

        What agreed before the fault, and goes on through it, needs no window of its own.
        """
        since = self._since
        if since is None:
            return False
        if since < onset:
            return True
        return self._samples >= WINDOW_SAMPLES and stamp - since >= round(time * 1e9)
