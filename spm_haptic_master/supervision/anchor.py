# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The last orientation, which the next one has to continue, and which selects among solutions."""

from __future__ import annotations

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import is_within, rotation_distance
from spm_haptic_master.supervision.sample import Place, Sample
from spm_haptic_master.supervision.symptom import Reason, Symptom

# Standard deviations that healthy noise turns an orientation by at most.
TURN_DEVIATIONS = 6.0
# Change of a reading that moves two solutions apart from where they meet, over the square of half
# the angle between them (1 / rad): 0.4 to 1.9 in random poses to a tilt of 45 deg. By the
# derivative of that, noise of sigma turns each by sigma / (FOLD * the angle between them), and the
# reading error that takes an orientation of the gain K to where they meet is 1 / (4 FOLD K^2).
FOLD = 2.0
# Largest `Integrity.fold_share` of an orientation that another may continue: neither noise nor
# bias of a sensor takes it to where two solutions meet.
LARGEST_FOLD_SHARE = 1.0


class Anchor:
    """
    The last consistent orientation, which the next one has to continue.

    Parameters
    ----------
    speed : float
        Human motion limit of the rotation, rad/s.

    Attributes
    ----------
    place : Place or None
        The orientation; None if there is none that the next one could continue.

    """

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self.place: Place | None = None
        # The last quaternion, whose sign the next one continues even if `place` is None.
        self._quaternion: Quaternion[float] | None = None

    def restart(self) -> None:
        """Have the next orientation continue none, but in the sign of its quaternion."""
        self.place = None

    def prior(self, stamp: int) -> Place | None:
        """Return the last orientation while it still selects among solutions at a stamp, ns."""
        place = self.place
        return place if place is not None and place.is_recent_at(stamp) else None

    def discontinuity(
        self,
        sample: Sample,
        quaternion: Quaternion[float],
        deviation: float,
    ) -> Symptom | None:
        """
        Return a symptom if the orientation of a sample does not continue the last one.

        With four sensors nothing else detects a jump of th3A onto another orientation that fits.

        Parameters
        ----------
        sample : Sample
            The sample, with the last orientation as its prior.
        quaternion : tuple of four float
            Its orientation, x, y, z, w of R_base_platform.
        deviation : float
            Total standard deviation of that, rad.

        Returns
        -------
        Symptom or None
            DISCONTINUOUS if the turn exceeds speed x time + `TURN_DEVIATIONS` x deviation.

        """
        last = sample.prior
        if last is None:
            return None
        reach = self._speed * sample.time_since(last.stamp) + TURN_DEVIATIONS * deviation
        if is_within(quaternion, last.quaternion, reach):
            return None
        turn = rotation_distance(quaternion, last.quaternion)
        detail = f'{turn:.3f} rad off the last one, limit {reach:.3f}'
        return Symptom(Reason.DISCONTINUOUS, detail)

    def follow(
        self,
        stamp: int,
        quaternion: Quaternion[float],
        fold_share: float,
    ) -> Place:
        """
        Let the next orientation continue this one; return it, continuous in sign.

        No later one continues it if noise and bias may take it to where two solutions meet.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        quaternion : tuple of four float
            Orientation x, y, z, w of R_base_platform.
        fold_share : float
            Its `Integrity.fold_share` (unit 1).

        Returns
        -------
        Place
            The same orientation, with the sign of the quaternion that is nearer to the last one.

        """
        last_x, last_y, last_z, last_w = self._quaternion or quaternion
        x, y, z, w = quaternion
        if x * last_x + y * last_y + z * last_z + w * last_w < 0.0:
            quaternion = -x, -y, -z, -w
        self._quaternion = quaternion
        place = Place(stamp, quaternion)
        self.place = place if fold_share <= LARGEST_FOLD_SHARE else None
        return place
