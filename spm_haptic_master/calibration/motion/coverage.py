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
AZIMUTHS = tuple(
    np.linspace(
        0.0,
        2.0 * np.pi,
        12,
        endpoint=False,
    ).tolist()
)
# Tilts of a proposed motion and its self-rotations (deg).
PROPOSED_TILTS_DEG = (6.0, 12.0, 18.0, 24.0)
PROPOSED_TURNS_DEG = (0.0, 20.0, 40.0, 60.0, 80.0)
# Self-rotations of a proposed turn (deg), to the right and to the left.
RIGHT_TURNS_DEG = (-15.0, -5.0, 5.0, 15.0)
LEFT_TURNS_DEG = (60.0, 75.0, 90.0, 105.0)
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
TILTS = 3
TURNS = 5
# Least tilt of a region and extent of its self-rotation (deg): a smaller one is no workspace.
LEAST_TILT_DEG = 8.0
LEAST_TURN_DEG = 20.0


@dataclass(frozen=True, slots=True)
class Region:
    """
    Part of the workspace: tilts in all directions from its centre, and self-rotations.

    Attributes
    ----------
    tilt_deg : float
        Largest tilt of the platform's axis from the workspace's centre, deg.
    from_deg : float
        Least self-rotation phi, deg.
    to_deg : float
        Largest self-rotation phi, deg.

    """

    tilt_deg: float
    from_deg: float
    to_deg: float

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
        """
        Return poses of the region within reach, on a grid of tilts, directions and self-rotations.

        Parameters
        ----------
        model : MotionModel
            The mechanism with its encoders.
        vector : ndarray, shape (P,)
            Parameters, rad.

        Returns
        -------
        ndarray, shape (n, 3, 3)
            R_base_platform.

        """
        return _reachable(
            model=model,
            vector=vector,
            tilts_deg=np.linspace(0.0, self.tilt_deg, TILTS),
            azimuths=AZIMUTHS,
            turns_deg=np.linspace(self.from_deg, self.to_deg, TURNS),
        )


# Where a calibration has to be right.
WORKSPACE = Region(
    tilt_deg=16.0,
    from_deg=0.0,
    to_deg=80.0,
)


def region_of(rotation: Array) -> Region:
    """
    Return the region that orientations are in, to whole degrees.

    The rim that `RIM_PERCENT` of the samples are in at either edge does not count.

    Parameters
    ----------
    rotation : ndarray, shape (n, 3, 3)
        Orientations R_base_platform; NaN where there is none.

    Returns
    -------
    Region
        The region, inside the orientations' extent.

    """
    known = np.isfinite(rotation).all(axis=(1, 2))
    tilts, turns = tilt_and_turn(rotation[known])
    turns_deg = np.degrees(around_middle(turns))
    low, high = np.percentile(turns_deg, (RIM_PERCENT, 100.0 - RIM_PERCENT))
    tilt = np.percentile(np.degrees(tilts), 100.0 - 2.0 * RIM_PERCENT)
    return Region(
        tilt_deg=float(np.floor(tilt)),
        from_deg=float(np.ceil(low)),
        to_deg=float(np.floor(high)),
    )


def around_middle(angles: Array) -> Array:
    """
    Return angles on the turn around their mean direction, so that they do not jump.

    Parameters
    ----------
    angles : ndarray, shape (n,)
        Angles, rad, or NaN.

    Returns
    -------
    ndarray, shape (n,)
        The same angles within half a turn of their mean direction, rad.

    """
    middle = np.angle(np.nanmean(np.exp(1j * angles)))
    return np.asarray(middle + wrapped(angles - middle))


def sensor_bounds(
    model: MotionModel,
    vector: Array,
    covariance: Array,
    poses: Array,
    unexplained: Array,
) -> Array:
    """
    Return the bound of each sensor's systematic error over poses: what becomes `bias_deg`.

    `BOUND_SIGMAS` standard deviations, by the covariance of zeros and harmonics, at the worst
    pose, and what no parameter explains; raised by one factor where the orientations' errors need
    it, and rounded up to `UNIT`.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    vector : ndarray, shape (P,)
        Parameters, rad.
    covariance : ndarray, shape (P, P)
        Covariance of the parameters' errors, rad^2.
    poses : ndarray, shape (n, 3, 3)
        Orientations within reach.
    unexplained : ndarray, shape (N,)
        Error of each sensor that no parameter explains, rad.

    Returns
    -------
    ndarray, shape (N,)
        Bounds, rad.

    """
    zeros = model.layout.slices['zeros']
    angles = model.joint_angles(poses, model.layout.geometry(vector))
    # The change of each reading with each parameter, (n, N, P), as if the mechanism were known.
    each_alone = np.eye(len(vector))
    changes = np.stack([model.linear_part(angles, unit) for unit in each_alone], axis=2)
    largest = variances(changes, covariance).max(axis=0)
    bound = BOUND_SIGMAS * np.sqrt(largest) + unexplained
    # A zero's error is one of the reading.
    spread = model.orientation_changes(poses, vector)[:, :, zeros]
    of_orientation = aligned_changes(model, poses, vector)
    turned = np.sqrt(variances(of_orientation, covariance).sum(axis=1))
    by_bounds = np.linalg.norm(spread, axis=1) @ bound
    factor = BOUND_SIGMAS * float((turned / by_bounds).max())
    units: Array = np.ceil(max(1.0, factor) * bound / UNIT)
    return units * UNIT


def parity_bound(
    model: MotionModel,
    vector: Array,
    covariance: Array,
    poses: Array,
    unexplained: float,
) -> float:
    """
    Return a bound of what the systematic errors of all sensors do to the parity.

    Errors of the parameters have to agree with each other in what the motion showed, which was the
    parity: together they change it much less than the bounds of single sensors allow.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    vector : ndarray, shape (P,)
        Parameters, rad.
    covariance : ndarray, shape (P, P)
        Covariance of the parameters' errors, rad^2.
    poses : ndarray, shape (n, 3, 3)
        Orientations within reach.
    unexplained : float
        Slow part of the parity that no parameter explains, rad.

    Returns
    -------
    float
        Bound of the length of the part of the errors that no rotation explains, rad, rounded up to
        `UNIT`.

    """
    # With a noise of 1 rad the parity is that part.
    unweighted = MotionModel(model.layout, np.ones(model.layout.sensors))
    changes = unweighted.linearised(
        unweighted.readings(poses, vector),
        poses,
        vector,
        tuple(range(model.layout.count)),
    ).derivative
    squares = variances(changes, covariance).sum(axis=1)
    deviation = np.sqrt(squares.max())
    return float(np.ceil((BOUND_SIGMAS * deviation + unexplained) / UNIT) * UNIT)


def aligned_changes(
    model: MotionModel,
    rotation: Array,
    vector: Array,
) -> Array:
    """
    Return the changes of orientations with the parameters, but for the choice of the frames.

    A rotation of the base and one of the platform that all poses share are projected out (the left
    singular vectors of their 6 columns): no motion determines them, and a mounting takes them.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    rotation : ndarray, shape (n, 3, 3)
        Orientations within reach.
    vector : ndarray, shape (P,)
        Parameters, rad.

    Returns
    -------
    ndarray, shape (n, 3, P)
        Rotation vectors in the base frame by each parameter, rad/rad.

    """
    changes = model.orientation_changes(rotation, vector)
    of_base = np.broadcast_to(np.eye(3), rotation.shape)
    frames = np.concatenate([of_base, rotation], axis=2)
    columns = frames.reshape(-1, 6)
    left, size, _ = np.linalg.svd(columns, full_matrices=False)
    kept = left[:, size > 1e-9 * size[0]]
    flat = changes.reshape(-1, changes.shape[2])
    across: Array = flat - kept @ (kept.T @ flat)
    return across.reshape(changes.shape)


def orientation_error(changes: Array, covariance: Array) -> float:
    """
    Return the predicted error of orientations by the errors of the parameters.

    Parameters
    ----------
    changes : ndarray, shape (n, 3, P)
        Of `aligned_changes`, rad/rad.
    covariance : ndarray, shape (P, P)
        Covariance of the parameters' errors, rad^2.

    Returns
    -------
    float
        Length of the rotation vector, rad rms.

    """
    total = variances(changes, covariance).sum()
    return float(np.sqrt(total / len(changes)))


def variances(changes: Array, covariance: Array) -> Array:
    """
    Return the variances of what changes with the parameters: the diagonal of A C A^T.

    Parameters
    ----------
    changes : ndarray
        Derivatives A, shape (..., P).
    covariance : ndarray, shape (P, P)
        Covariance of the parameters' errors, rad^2.

    Returns
    -------
    ndarray
        Variances, shape (...).

    """
    products: Array = (changes @ covariance) * changes
    return np.asarray(products.sum(axis=-1))


def inverse(information: Array) -> Array:
    """
    Return the covariance of an information matrix by its eigenvalues.

    The matrix is scaled to a unit diagonal first, and small eigenvalues are raised to a floor: the
    variance of what nothing determines is large and finite.

    Parameters
    ----------
    information : ndarray, shape (P, P)
        Normal matrix, 1/rad^2.

    Returns
    -------
    ndarray, shape (P, P)
        Covariance, rad^2.

    """
    largest = np.maximum(np.diag(information), 1e-12)
    scale = 1.0 / np.sqrt(largest)
    values, vectors = np.linalg.eigh(information * scale[:, None] * scale)
    half = vectors / np.sqrt(np.maximum(values, 1e-13)) * scale[:, None]
    found: Array = half @ half.T
    return found


def further_motions(
    model: MotionModel,
    vector: Array,
    information: Array,
    rate: float,
    changes: Array,
) -> dict[str, float]:
    """
    Return what further motions would gain, the one that determines most first.

    A proposed motion of `PROPOSED_SECONDS` adds its samples' information, predicted by the model,
    to that so far.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    vector : ndarray, shape (P,)
        Parameters, rad.
    information : ndarray, shape (P, P)
        Information of the motion so far and of the tolerances, 1/rad^2.
    rate : float
        Rate of the samples, Hz.
    changes : ndarray, shape (n, 3, P)
        Changes of the orientations whose error counts, of `aligned_changes`.

    Returns
    -------
    dict of str to float
        By instruction, the factor by which it reduces the variance of the orientations' error.

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
            model.readings(poses, vector),
            poses,
            vector,
            columns,
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
    """
    Return the poses of a grid that are within reach, in all directions of tilt.

    Parameters
    ----------
    model : MotionModel
        The mechanism with its encoders.
    vector : ndarray, shape (P,)
        Parameters, rad.
    tilts_deg : sequence of float or ndarray
        Tilts from the workspace's centre, deg.
    azimuths : sequence of float
        Directions of the tilt, rad.
    turns_deg : sequence of float or ndarray
        Self-rotations phi, deg.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        R_base_platform; without a tilt only once for each self-rotation.

    """
    tilt, azimuth, turn = (
        grid.ravel()
        for grid in np.meshgrid(
            np.radians(tilts_deg),
            azimuths,
            np.radians(turns_deg),
            indexing='ij',
        )
    )
    # Without a tilt there is no direction.
    wanted = (tilt > 0.0) | (azimuth == azimuths[0])
    poses = workspace_pose(tilt[wanted], azimuth[wanted], turn[wanted])
    layout = model.layout
    geometry = layout.geometry(vector)
    usable, *_ = reached(
        poses,
        geometry,
        layout.working_mode,
        layout.sensors,
    )
    return poses[usable]


def _towards(azimuth: float) -> str:
    """Return one of `AZIMUTHS`, which begin towards (1, -1, 0), by the motors."""
    third, rest = divmod(round(degrees(azimuth)), 120)
    return (
        f"away from leg {'ABC'[third]}'s motor"
        if rest == 90
        else f"towards leg {'BCA'[third]}'s motor"
    )
