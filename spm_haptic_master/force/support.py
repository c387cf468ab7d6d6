# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The torques on the handle beside wrench and lock: weight compensation and end stop."""

from __future__ import annotations

from spm_haptic_master.force.end_stop import EndStop
from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.gravity import Gravity, Weight
from spm_haptic_master.force.statics import Statics
from spm_haptic_master.force.vectors import NOTHING
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.kinematics.vectors import scaled


class Support:
    """
    Weight and end stop, each with the share that its ramp has reached.

    Parameters
    ----------
    geometry : Geometry
        Link angles.
    gravity : Gravity or None
        Weight of handle and links; None: none is compensated.
    limits : ForceLimits
        With the time of a ramp, and where the end stop begins.
    statics : Statics
        Has the pose.

    Attributes
    ----------
    weight, end_stop : tuple of three float
        Torques of the latest sample, N m in the base frame.

    """

    def __init__(
        self,
        geometry: Geometry,
        gravity: Gravity | None,
        limits: ForceLimits,
        statics: Statics,
    ) -> None:
        self._weight = None if gravity is None else Weight(gravity, statics)
        self._end_stop = EndStop(geometry, limits, statics)
        self._ramp = limits.ramp
        self.end()

    def end(self) -> None:
        """End both at once."""
        self._weight_share = 0.0
        self._stop_share = 0.0
        self.weight = NOTHING
        self.end_stop = NOTHING

    @property
    def has_torque(self) -> bool:
        """Whether weight or end stop have torque."""
        return any(self.weight) or any(self.end_stop)

    @property
    def weight_share(self) -> float:
        """Share of the weight that is compensated (unit 1); 0 where there is none."""
        return 0.0 if self._weight is None else self._weight_share

    def move(
        self,
        is_wanted: bool,
        is_weight_wanted: bool,
        velocity: Vector[float] | None,
        dt: float,
    ) -> None:
        """
        Raise or lower both by a step of the ramp, in the pose of the statics.

        Parameters
        ----------
        is_wanted : bool
            Whether both may have torque.
        is_weight_wanted : bool
            Whether the weight is to be compensated, too.
        velocity : tuple of three float or None
            Angular velocity of the handle, rad/s.
        dt : float
            Time since the last sample, s.

        """
        step = dt / self._ramp
        self._stop_share = _stepped(self._stop_share, is_wanted, step)
        self._weight_share = _stepped(self._weight_share, is_wanted and is_weight_wanted, step)
        stop = self._end_stop.torque(velocity)
        self.end_stop = scaled(self._stop_share, stop) if stop is not NOTHING else NOTHING
        if self._weight is not None:
            self.weight = scaled(self._weight_share, self._weight.torque())


def _stepped(share: float, is_wanted: bool, step: float) -> float:
    """Return a share (unit 1) that is raised or lowered by a step, 0 to 1."""
    return min(1.0, share + step) if is_wanted else max(0.0, share - step)
