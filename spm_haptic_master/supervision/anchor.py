# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The last orientation, which the next one has to continue, and which selects among solutions."""

from __future__ import annotations

from math import pi, sin, sqrt

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.supervision.symptom import Reason, Symptom

PRIOR_AGE = 100_000_000  # ns, at which an orientation no longer selects among solutions
TURN_DEVIATIONS = 6.0  # that an orientation may be from the last one, beside human motion
# Change of a reading that moves two solutions apart from where they meet, over the square of half
# the angle between them (1 / rad): 0.4 to 1.9 in random poses to a tilt of 45 deg. Noise of sigma
# then turns each by sigma / (FOLD * the angle between them).
FOLD = 2.0


class Anchor:
    """
    The last consistent orientation, which the next one has to continue.

    Parameters
    ----------
    speed : float
        Human motion limit of the rotation, rad/s.
    sigma, bias : float
        Largest standard deviation and nominal bias of a sensor, rad.

    Attributes
    ----------
    stamp : int or None
        Time of the orientation, ns; None if there is none that the next one could continue.

    """

    def __init__(self, speed: float, sigma: float, bias: float) -> None:
        self._speed = speed
        # Largest total deviation of an orientation that another may continue, rad: neither noise
        # nor bias of a sensor takes it to where two solutions meet.
        reading_error = TURN_DEVIATIONS * sigma + bias
        self._largest = 0.5 * sigma / sqrt(FOLD * reading_error)
        self.stamp: int | None = None
        self._quaternion: Quaternion[float] | None = None

    def restart(self) -> None:
        """Select the next orientation as the first one; its sign still continues the last."""
        self.stamp = None

    def prior(self, stamp: int) -> Quaternion[float] | None:
        """
        Return the last orientation while it still selects among solutions at a stamp, ns.

        None if it is older than `PRIOR_AGE`, or if none was left that another could continue.
        """
        recent = self.stamp is not None and stamp - self.stamp <= PRIOR_AGE
        return self._quaternion if recent else None

    def check(
        self,
        stamp: int,
        period: float,
        quaternion: Quaternion[float],
        deviation: float,
    ) -> Symptom | None:
        """
        Compare an orientation with the last one.

        With four sensors nothing else detects a jump of th3A onto another orientation that fits.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        period : float
            Usual time between samples, s: they are at least so far apart, whatever their stamps.
        quaternion : tuple of four float
            Orientation x, y, z, w of R_base_platform.
        deviation : float
            Its total standard deviation, rad.

        Returns
        -------
        Symptom or None
            DISCONTINUOUS if the turn exceeds speed x time + `TURN_DEVIATIONS` x deviation.

        """
        last = self.prior(stamp)
        if last is None or self.stamp is None:
            return None
        elapsed = max((stamp - self.stamp) * 1e-9, period)
        reach = self._speed * elapsed + TURN_DEVIATIONS * deviation
        if within(quaternion, last, reach):
            return None
        return Symptom(
            Reason.DISCONTINUOUS,
            f'{rotation_distance(quaternion, last):.3f} rad off the last one, limit {reach:.3f}',
        )

    def follow(
        self,
        stamp: int,
        quaternion: Quaternion[float],
        deviation: float,
    ) -> Quaternion[float]:
        """
        Let the next orientation continue this one; return it, continuous in sign.

        No later one continues it if its total deviation is so large that two solutions may meet.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        quaternion : tuple of four float
            Orientation x, y, z, w of R_base_platform.
        deviation : float
            Its total standard deviation, rad.

        Returns
        -------
        tuple of four float
            The same orientation, with the sign of the quaternion that is nearer to the last one.

        """
        last_x, last_y, last_z, last_w = self._quaternion or quaternion
        x, y, z, w = quaternion
        if x * last_x + y * last_y + z * last_z + w * last_w < 0.0:
            quaternion = -x, -y, -z, -w
        self.stamp = stamp if deviation <= self._largest else None
        self._quaternion = quaternion
        return quaternion


def within(
    one: Quaternion[float],
    other: Quaternion[float],
    angle: float,
) -> bool:
    """
    Whether two orientations are at most an angle (rad) apart.

    Of unit quaternions, either sign: 1 - (p . q)^2 is sin^2 of half the turn between them.
    """
    x, y, z, w = one
    other_x, other_y, other_z, other_w = other
    cosine = x * other_x + y * other_y + z * other_z + w * other_w
    # sin(half the turn)^2; angle / 2 is its upper bound, sin(angle / 2) exact for large angles.
    half = 0.5 * angle
    reach = half if half < 0.1 else sin(min(half, 0.5 * pi))
    return 1.0 - cosine * cosine <= reach * reach
