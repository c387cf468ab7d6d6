# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One joint sample with what its evaluation allows for, and an orientation at a time."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TypeAlias

from spm_haptic_master.kinematics.number_backends import Quaternion

# Readings of four, five or six sensors, rad: th1A, th1B, th1C, th3A, th3B, th3C.
Angles: TypeAlias = tuple[float, ...]

# Age (ns) up to which an orientation selects among solutions. An older one selects none: a start.
PRIOR_AGE = 100_000_000
# Periods up to which one sample follows another shortly: a single lost sample is no gap. And the
# longest such time (ns), at any rate.
SHORT_PERIODS = 2.5
SHORT_TIME = 60_000_000


@dataclass(slots=True)
class Place:
    """
    An orientation at a time.

    Attributes
    ----------
    stamp : int
        Time by the supervision's clock (`SampleClock.now`), ns.
    quaternion : tuple of four float
        x, y, z, w of R_base_platform.

    """

    stamp: int
    quaternion: Quaternion[float]

    def is_recent_at(self, stamp: int) -> bool:
        """Whether the orientation is recent enough to select among solutions at a stamp, ns."""
        return stamp - self.stamp <= PRIOR_AGE


@dataclass(slots=True)
class Sample:
    """
    One sample of N mounted sensors, and what to allow for.

    Attributes
    ----------
    stamp : int
        Time by the supervision's clock (`SampleClock.now`), ns.
    angles : tuple of float
        Readings of the N sensors, rad; NaN of a sensor without a reading.
    prior : Place or None
        The last orientation, which selects among solutions; None if it is older than `PRIOR_AGE`.
    bias : tuple of float
        Nominal bias of each of the N sensors, rad, and what its joint moved while its reading was
        late.
    factors : tuple of float
        Measured noise of each sensor over the configured one, at least 1.
    parity_bias : float
        Bound of the length of that part of the biases that no motion explains, rad; half a turn,
        which no bias exceeds, where no bound is known.
    period : float
        Usual time between samples, s; 0 if that is not known.

    """

    stamp: int
    angles: Angles
    prior: Place | None
    bias: tuple[float, ...]
    factors: tuple[float, ...]
    parity_bias: float = pi
    period: float = 0.0

    def time_since(self, stamp: int) -> float:
        """Return the time since a sample at an earlier stamp (ns), s: at least a period."""
        return max((self.stamp - stamp) * 1e-9, self.period)

    @property
    def short_time(self) -> int:
        """Longest time after another sample, ns, by which it follows that shortly after."""
        return min(round(SHORT_PERIODS * self.period * 1e9), SHORT_TIME)

    def follows(self, stamp: int) -> bool:
        """Whether it follows shortly after a sample at an earlier stamp, ns."""
        return self.stamp - stamp <= self.short_time
