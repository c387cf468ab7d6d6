# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Bound of each sensor's systematic error over a region of the workspace.

The error of a sensor is its corrected reading less the angle of its joint: what zero and
harmonics are off by. The covariance of the parameters gives its standard deviation at each pose,
and the bound is `BOUND_SIGMAS` times the largest one over the poses, not the mean over the motion:
a motion determines some combinations of the parameters only, and elsewhere the others show. To
that comes what no parameter explains. The errors of links and axes are no sensor's; where they
turn the orientation by more than the sensors' bounds together do, all bounds are raised by one
factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np
from spm_haptic_master.calibration.motion.coverage import (
    aligned_changes,
    AZIMUTHS,
    reachable,
    TARGET_TILTS_DEG,
    TARGET_TURNS_DEG,
    variances,
)
from spm_haptic_master.calibration.motion.mechanism_parameters import Array
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.kinematics import workspace_pose, zxz_from_matrix

# Standard deviations of the predicted error that the bound covers: by chance a sensor exceeds it
# at some pose in one calibration of twenty, and 1.3 times it in one of a thousand.
BOUND_SIGMAS = 2.5
# Unit that bounds are rounded up to (rad).
UNIT = radians(0.01)
# Part of a motion beyond either edge of its region (percent): moments at the rim.
RIM_PERCENT = 2.5
# Tilts and self-rotations at which a region is evaluated.
TILTS, TURNS = 3, 5
# Least tilt of a region and extent of its self-rotation (deg): a smaller one is no workspace.
LEAST_TILT_DEG, LEAST_TURN_DEG = 8.0, 20.0


@dataclass(frozen=True, slots=True)
class Region:
    """Part of the workspace: tilts in all directions from its centre, and self-rotations."""

    tilt_deg: float  # largest tilt, deg
    from_deg: float  # least self-rotation, deg
    to_deg: float  # largest self-rotation, deg

    @property
    def text(self) -> str:
        """Return the region in words."""
        return (f'tilt to {self.tilt_deg:g} deg, self-rotation {self.from_deg:g} to '
                f'{self.to_deg:g} deg')

    @property
    def is_large(self) -> bool:
        """Return whether a device can be used in it."""
        return self.tilt_deg >= LEAST_TILT_DEG \
            and self.to_deg - self.from_deg >= LEAST_TURN_DEG

    def poses(self, model: MotionModel, vector: Array) -> Array:
        """Return poses of the region within reach, shape (n, 3, 3)."""
        tilts = np.linspace(0.0, self.tilt_deg, TILTS)
        turns = np.linspace(self.from_deg, self.to_deg, TURNS)
        return reachable(model, vector, tilts.tolist(), AZIMUTHS, turns.tolist())


WORKSPACE = Region(TARGET_TILTS_DEG[-1], TARGET_TURNS_DEG[0], TARGET_TURNS_DEG[-1])


def region_of(rotation: Array) -> Region:
    """Return the region that orientations, NaN where there is none, are in, to whole degrees."""
    known = rotation[np.isfinite(rotation).all(axis=(1, 2))]
    axis = workspace_pose(0.0, 0.0, 0.0)[:, 2]
    tilts = np.degrees(np.arccos(np.clip(known[:, :, 2] @ axis, -1.0, 1.0)))
    turns = np.degrees(zxz_from_matrix(known)[2])
    # Around the middle of the motion, so that no turn is cut.
    middle = float(np.degrees(np.angle(np.exp(1j * np.radians(turns)).sum())))
    turns = middle + (turns - middle + 180.0) % 360.0 - 180.0
    low, high = np.percentile(turns, (RIM_PERCENT, 100.0 - RIM_PERCENT))
    return Region(float(np.floor(np.percentile(tilts, 100.0 - 2.0 * RIM_PERCENT))),
                  float(np.ceil(low)), float(np.floor(high)))


def sensor_bounds(model: MotionModel, vector: Array, covariance: Array, poses: Array,
                  unexplained: Array) -> Array:
    """
    Return the bound of each sensor's systematic error at poses within reach, rad, shape (N,).

    By the covariance of the parameters' errors, (P, P), rad^2, and the error of each sensor that
    no parameter explains, (N,), rad.
    """
    bound = BOUND_SIGMAS * np.sqrt(variances(
        _encoder_changes(model, poses, vector), covariance).max(axis=0)) + unexplained
    spread = model.linearised(model.readings(poses, vector), poses, vector).spread
    turned = np.sqrt(variances(aligned_changes(model, poses, vector), covariance).sum(axis=1))
    factor = BOUND_SIGMAS * float((turned / (np.linalg.norm(spread, axis=1) @ bound)).max())
    found: Array = np.ceil(max(1.0, factor) * bound / UNIT) * UNIT
    return found


def _encoder_changes(model: MotionModel, poses: Array, vector: Array) -> Array:
    """
    Return how the readings at poses change with zeros and harmonics, rad/rad, shape (n, N, P).

    The mechanism is known: 0 for its parameters.
    """
    layout, zeros = model.layout, model.layout.slices['zeros']
    angles = model.joint_angles(poses, layout.geometry(vector))
    # The readings are linear in zeros and harmonics.
    found: Array = np.stack([unit[zeros] + layout.harmonic_deviation(angles, unit)[0]
                             for unit in np.eye(layout.count)], axis=2)
    return found
