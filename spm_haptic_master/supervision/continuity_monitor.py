# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The orientation against the last one: which solution continues it, and how far it may turn."""

from __future__ import annotations

from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.supervision.solver import Quaternion
from spm_haptic_master.supervision.symptom import Symptom

# Age of an orientation from which on it no longer selects among solutions (ns).
PRIOR_AGE = 100_000_000
# Standard deviations that an orientation may be from the last one, beside human motion.
TURN_DEVIATIONS = 6.0


class ContinuityMonitor:
    """
    The last orientation, and what may continue it.

    Parameters
    ----------
    speed : float
        Human motion limit of the rotation, rad/s.

    Attributes
    ----------
    following : bool
        Whether orientations are withheld for their worth alone, without a symptom since: they
        continue the motion though nothing is published.

    """

    __slots__ = ('_quaternion', '_speed', '_stamp', '_undetermined', 'following')

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._stamp: int | None = None
        self._quaternion: Quaternion | None = None
        self._undetermined: int | None = None
        self.following = False

    def forget(self) -> None:
        """Have the next orientation start as the first one did."""
        self._stamp = None
        self.following = False

    def prior(self, stamp: int) -> Quaternion | None:
        """Return the last orientation while it still selects among solutions."""
        if self._stamp is None or stamp - self._stamp > PRIOR_AGE:
            return None
        return self._quaternion

    def at(self, stamp: int | None) -> Quaternion | None:
        """Return the orientation of the sample at a stamp, ns, if that is the last one."""
        return self._quaternion if stamp is not None and stamp == self._stamp else None

    def check(self, stamp: int, quaternion: Quaternion, deviation: float) -> Symptom | None:
        """
        Hold an orientation against the last one and the human motion limit.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        quaternion : tuple of 4 float
            Orientation of the sample, x, y, z, w.
        deviation : float
            Total standard deviation of an orientation, rad.

        """
        prior = self.prior(stamp)
        if prior is None or self._stamp is None:
            return None
        reach = self._speed * (stamp - self._stamp) * 1e-9 + TURN_DEVIATIONS * deviation
        x, y, z, w = quaternion
        cosine = x * prior[0] + y * prior[1] + z * prior[2] + w * prior[3]
        # sin(half the turn)^2 against (half the reach)^2.
        if 1.0 - cosine * cosine <= 0.25 * reach * reach:
            return None
        return Symptom('orientation does not continue the motion',
                       f'{rotation_distance(quaternion, prior):.3f} rad off the last one, limit '
                       f'{reach:.3f}')

    def publish(self, stamp: int, quaternion: Quaternion) -> Quaternion:
        """Let the next orientation continue this one; return it, continuous in sign."""
        self._stamp = stamp
        self.following = False
        x, y, z, w = quaternion
        last = self._quaternion
        along = w if last is None else x * last[0] + y * last[1] + z * last[2] + w * last[3]
        if along < 0.0:
            quaternion = -x, -y, -z, -w
        self._quaternion = quaternion
        return quaternion

    def follow(self, stamp: int, quaternion: Quaternion) -> None:
        """Let an orientation that is withheld for its worth alone continue the last one."""
        if self.following and self.prior(stamp) is not None:
            self.publish(stamp, quaternion)
            self.following = True

    def note_undetermined(self, stamp: int) -> None:
        """Note that the sensors do not determine the orientation of a sample."""
        self._undetermined = stamp

    def was_undetermined(self, stamp: int) -> bool:
        """Return whether the sensors did not determine the orientation a moment ago."""
        last = self._undetermined
        return last is not None and stamp - last <= PRIOR_AGE
