# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An earlier calibration compared with readings at a known pose."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import degrees

from spm_haptic_master.calibration.jig.jig_pose import Calibration, observed_directions, Station
from spm_haptic_master.encoders.encoder_layout import angle_from_counts
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.rotations import wrapped


class Direction(Enum):
    """Result of comparing a joint's direction with the calibrated one."""

    CONFIRMED = 'confirmed'
    REVERSED = 'REVERSED'
    NOT_OBSERVABLE = 'not observable at this pose'


@dataclass(frozen=True, slots=True)
class JointCheck:
    """
    Comparison of one joint with its calibration.

    Attributes
    ----------
    joint : str
        Name of the joint.
    deviation : float
        Calibrated angle minus the jig's, rad.
    sigma : float
        Noise of the sensor, rad, 1 standard deviation.
    direction : Direction
        Result for the direction.

    """

    joint: str
    deviation: float
    sigma: float
    direction: Direction

    def failure(self, tolerance: float) -> str | None:
        """Return why the calibration does not hold, None if it does; tolerance in rad."""
        if self.direction is Direction.REVERSED:
            return f'{self.joint} turns the other way'
        if abs(self.deviation) > tolerance:
            return f'{self.joint} is {degrees(self.deviation):+.3f} deg off'
        return None


def check_joints(calibration: Calibration, station: Station) -> tuple[JointCheck, ...]:
    """
    Compare each joint with an earlier calibration.

    Parameters
    ----------
    calibration : Calibration
        The earlier one.
    station : Station
        Readings at a known pose.

    """
    observed = observed_directions(
        ((earlier, station) for earlier in calibration.stations), calibration.counts_per_turn)
    off = deviations(calibration, station)
    return tuple(
        JointCheck(joint, off[index], station.sigma[index],
                   {0: Direction.NOT_OBSERVABLE, calibration.direction[index]: Direction.CONFIRMED}
                   .get(observed[index], Direction.REVERSED))
        for index, joint in enumerate(ALL_JOINT_NAMES[:len(off)]))


def deviations(calibration: Calibration, station: Station) -> tuple[float, ...]:
    """Return each joint's calibrated angle minus the jig's, rad; arguments of `check_joints`."""
    return tuple(
        wrapped(angle_from_counts(round(counts), zero, sign, per_turn) - angle)
        for counts, angle, zero, sign, per_turn
        in zip(station.counts, station.angles, calibration.zero_count, calibration.direction,
               calibration.counts_per_turn, strict=True))
