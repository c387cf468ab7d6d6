# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a motion determines over a region of the workspace, and which motion determines the rest.

The error of a sensor is its corrected reading less the angle of its joint: errors of zero and
harmonics. Their covariance gives its standard deviation at each pose. Its bound is `BOUND_SIGMAS`
times the largest one over the poses, not the mean over the motion: a motion determines only some
combinations of the parameters, and elsewhere the others show. What no parameter explains is added.
Errors of links and axes belong to no sensor; where they turn the orientation by more than the
sensors' bounds together do, all bounds are raised by one factor. The bound of the parity is far
smaller than what the sensors' bounds allow: the parity is what the motion measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np
from spm_haptic_master.calibration.motion.model import Array, MotionModel
from spm_haptic_master.calibration.watch.slip_evidence import reached
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.kinematics.rotations import wrapped
from spm_haptic_master.validation.parity_map import tilt_and_turn

# Directions of tilt (rad), in which poses are taken and motions proposed.
AZIMUTHS = tuple(np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False).tolist())
# Tilts of a proposed motion and its self-rotations (deg).
PROPOSED_TILTS_DEG, PROPOSED_TURNS_DEG = (6.0, 12.0, 18.0, 24.0), (0.0, 20.0, 40.0, 60.0, 80.0)
# Self-rotations of a proposed turn (deg), to the right and to the left.
RIGHT_TURNS_DEG, LEFT_TURNS_DEG = (-15.0, -5.0, 5.0, 15.0), (60.0, 75.0, 90.0, 105.0)
# Length of a proposed motion (s).
PROPOSED_SECONDS = 3.0
# Standard deviations of the predicted error that the bound covers: by chance a sensor exceeds it
# at some pose in one calibration of twenty, and 1.3 times it in one of a thousand.
BOUND_SIGMAS = 2.5
# Unit that bounds are rounded up to (rad).
UNIT = radians(0.01)
# Part of a motion beyond either edge of its region (percent): moments at the rim.
RIM_PERCENT = 2.5
# Number of tilts and of self-rotations at which a region is evaluated.
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
        return (
            f'tilt to {self.tilt_deg:g} deg, self-rotation {self.from_deg:g} to '
            f'{self.to_deg:g} deg'
        )

    @property
    def is_large(self) -> bool:
        """Return whether a device can be used in it."""
        return self.tilt_deg >= LEAST_TILT_DEG and self.to_deg - self.from_deg >= LEAST_TURN_DEG

    def poses(self, model: MotionModel, vector: Array) -> Array:
        """Return poses of the region within reach, shape (n, 3, 3)."""
        return _reachable(
            model,
            vector,
            np.linspace(0.0, self.tilt_deg, TILTS),
            AZIMUTHS,
            np.linspace(self.from_deg, self.to_deg, TURNS),
        )


# Where a calibration has to be right.
WORKSPACE = Region(16.0, 0.0, 80.0)


def region_of(rotation: Array) -> Region:
    """Return the region that orientations, NaN where there is none, are in, to whole degrees."""
    tilts, turns = tilt_and_turn(rotation[np.isfinite(rotation).all(axis=(1, 2))])
    low, high = np.percentile(np.degrees(around_middle(turns)), (RIM_PERCENT, 100.0 - RIM_PERCENT))
    tilt = np.percentile(np.degrees(tilts), 100.0 - 2.0 * RIM_PERCENT)
    return Region(float(np.floor(tilt)), float(np.ceil(low)), float(np.floor(high)))


def around_middle(angles: Array) -> Array:
    """Return angles, rad, (n,), or NaN, on the turn around their mean direction: without jumps."""
    middle = np.angle(np.nanmean(np.exp(1j * angles)))
    return np.asarray(middle + wrapped(angles - middle))


def sensor_bounds(
    model: MotionModel, vector: Array, covariance: Array, poses: Array, unexplained: Array
) -> Array:
    """
    Return the bound of each sensor's systematic error at poses within reach, rad, (N,).

    By the parameters' covariance, rad^2, and each sensor's error that no parameter explains, rad.
    """
    zeros = model.layout.slices['zeros']
    angles = model.joint_angles(poses, model.layout.geometry(vector))
    # The change of each reading with each parameter, (n, N, P), as if the mechanism were known.
    changes = np.stack([model.linear_part(angles, unit) for unit in np.eye(len(vector))], axis=2)
    bound = BOUND_SIGMAS * np.sqrt(variances(changes, covariance).max(axis=0)) + unexplained
    # A zero's error is one of the reading.
    spread = model.orientation_changes(poses, vector)[:, :, zeros]
    turned = np.sqrt(variances(aligned_changes(model, poses, vector), covariance).sum(axis=1))
    factor = BOUND_SIGMAS * float((turned / (np.linalg.norm(spread, axis=1) @ bound)).max())
    return np.ceil(max(1.0, factor) * bound / UNIT) * UNIT


def parity_bound(
    model: MotionModel, vector: Array, covariance: Array, poses: Array, unexplained: float
) -> float:
    """
    Return a bound of what the systematic errors of all sensors do to the parity, rad.

    Errors of the parameters have to agree with each other in what the motion showed, which was
    the parity: together they change it much less than the bounds of single sensors allow.

    Parameters
    ----------
    model, vector, covariance
        the calibration; the covariance in rad^2, (P, P)
    poses : ndarray, shape (n, 3, 3)
        orientations within reach at which the bound holds
    unexplained : float
        slow part of the parity that no parameter explains, rad

    Returns
    -------
    float
        bound of the length of the part of the errors that no rotation explains, rad

    """
    # With a noise of 1 rad the parity is that part.
    unweighted = MotionModel(model.layout, np.ones(model.layout.sensors))
    changes = unweighted.linearised(
        unweighted.readings(poses, vector), poses, vector, tuple(range(model.layout.count))
    ).derivative
    deviation = np.sqrt(variances(changes, covariance).sum(axis=1).max())
    return float(np.ceil((BOUND_SIGMAS * deviation + unexplained) / UNIT) * UNIT)


def aligned_changes(model: MotionModel, rotation: Array, vector: Array) -> Array:
    """
    Return the changes of orientations with the parameters, rad/rad, base frame, (n, 3, P).

    Without a rotation of the base and one of the platform that all poses share.
    """
    changes = model.orientation_changes(rotation, vector)
    frames = np.concatenate([np.broadcast_to(np.eye(3), rotation.shape), rotation], axis=2)
    left, size, _ = np.linalg.svd(frames.reshape(-1, 6), full_matrices=False)
    kept, flat = left[:, size > 1e-9 * size[0]], changes.reshape(-1, changes.shape[2])
    return (flat - kept @ (kept.T @ flat)).reshape(changes.shape)


def orientation_error(changes: Array, covariance: Array) -> float:
    """Return the error of orientations, rad rms, by changes and the parameters' covariance."""
    return float(np.sqrt(variances(changes, covariance).sum() / len(changes)))


def variances(changes: Array, covariance: Array) -> Array:
    """Return the variances, shape (...), of what changes with the parameters, shape (..., P)."""
    return ((changes @ covariance) * changes).sum(axis=-1)


def inverse(information: Array) -> Array:
    """Return the covariance of an information matrix; large where it has none."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = np.linalg.eigh(information * scale[:, None] * scale)
    half = vectors / np.sqrt(np.maximum(values, 1e-13)) * scale[:, None]
    return half @ half.T


def further_motions(
    model: MotionModel, vector: Array, information: Array, rate: float, changes: Array
) -> dict[str, float]:
    """
    Return instructions for further motions, the one that determines most first.

    With each the factor by which it reduces the variance of the orientation error, by `changes`,
    as it adds samples at a rate, Hz, to the information so far, (P, P), 1/rad^2.
    """
    before = orientation_error(changes, inverse(information))
    columns = tuple(range(model.layout.count))
    gains: dict[str, float] = {}
    grids: list[tuple[str, Sequence[float], Sequence[float], Sequence[float]]] = [
        (
            f'tilt the handle farther {_towards(azimuth)}',
            PROPOSED_TILTS_DEG,
            (azimuth,),
            PROPOSED_TURNS_DEG,
        )
        for azimuth in AZIMUTHS
    ]
    grids += [
        (f'turn the handle farther to the {side}', (0.0, 8.0), AZIMUTHS[::3], turns_deg)
        for side, turns_deg in (
            ('right (clockwise)', RIGHT_TURNS_DEG),
            ('left (counter-clockwise)', LEFT_TURNS_DEG),
        )
    ]
    for text, *grid in grids:
        poses = _reachable(model, vector, *grid)
        if not len(poses):
            continue
        derivative = model.linearised(
            model.readings(poses, vector), poses, vector, columns
        ).derivative
        rows = derivative.reshape(-1, derivative.shape[2])
        more = rows.T @ rows * (PROPOSED_SECONDS * rate / len(poses))
        after = orientation_error(changes, inverse(information + more))
        # Several azimuths have one instruction: the best of them counts.
        gains[text] = max((before / after) ** 2, gains.get(text, 0.0))
    return dict(sorted(gains.items(), key=lambda item: -item[1]))


def _reachable(
    model: MotionModel,
    vector: Array,
    tilts_deg: Sequence[float] | Array,
    azimuths: Sequence[float],
    turns_deg: Sequence[float] | Array,
) -> Array:
    """Return the poses, (n, 3, 3), of a grid that are within reach; the azimuths in rad."""
    tilt, azimuth, turn = (
        grid.ravel()
        for grid in np.meshgrid(
            np.radians(tilts_deg), azimuths, np.radians(turns_deg), indexing='ij'
        )
    )
    # Without a tilt there is no direction.
    wanted = (tilt > 0.0) | (azimuth == azimuths[0])
    poses = workspace_pose(tilt[wanted], azimuth[wanted], turn[wanted])
    layout = model.layout
    return poses[reached(poses, layout.geometry(vector), layout.working_mode, layout.sensors)[0]]


def _towards(azimuth: float) -> str:
    """Return one of `AZIMUTHS`, which begin towards (1, -1, 0), by the motors."""
    third, rest = divmod(round(degrees(azimuth)), 120)
    return (
        f"away from leg {'ABC'[third]}'s motor"
        if rest == 90
        else f"towards leg {'BCA'[third]}'s motor"
    )
