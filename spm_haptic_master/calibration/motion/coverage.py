# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a motion determines, and which further motion would determine the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.mechanism_parameters import Array
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.kinematics.joints import LEG_NAMES

# Poses at which the calibration has to be right: tilt from the centre and self-rotation (deg).
TARGET_TILTS_DEG = (0.0, 8.0, 16.0)
TARGET_TURNS_DEG = (0.0, 20.0, 40.0, 60.0, 80.0)
# Directions of tilt (rad), in which poses are taken and motions proposed.
AZIMUTHS = tuple(np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False).tolist())
# Tilts of a proposed motion (deg).
PROPOSED_TILTS_DEG = (6.0, 12.0, 18.0, 24.0)
# Self-rotations of a proposed turn (deg), to the right and to the left.
RIGHT_TURNS_DEG = (-15.0, -5.0, 5.0, 15.0)
LEFT_TURNS_DEG = (60.0, 75.0, 90.0, 105.0)
# Length of a proposed motion (s).
PROPOSED_SECONDS = 3.0


@dataclass(frozen=True, slots=True)
class Proposal:
    """A further motion."""

    text: str  # what to do with the handle, as an instruction
    gain: float  # factor by which it reduces the variance of the orientation error


def reachable(model: MotionModel, vector: Array, tilts_deg: Sequence[float],
              azimuths: Sequence[float], turns_deg: Sequence[float]) -> Array:
    """Return the poses, (n, 3, 3), of a grid that are within reach; the azimuths in rad."""
    tilt, azimuth, turn = (grid.ravel() for grid in np.meshgrid(
        np.radians(tilts_deg), azimuths, np.radians(turns_deg), indexing='ij'))
    # Without a tilt there is no direction.
    wanted: NDArray[np.bool_] = np.asarray((tilt > 0.0) | (azimuth == azimuths[0]))
    poses = workspace_pose(tilt[wanted], azimuth[wanted], turn[wanted])
    readings = model.readings(poses, vector)
    within = model.linearised(
        np.nan_to_num(readings), poses, vector).usable & np.isfinite(readings).all(axis=1)
    found: Array = poses[within]
    return found


def aligned_changes(model: MotionModel, rotation: Array, vector: Array) -> Array:
    """
    Return the changes of orientations within reach with the parameters, but for the frames.

    A rotation of the base and one of the platform that all poses share are taken off. Shape
    (n, 3, P), rad/rad, in the base frame.
    """
    changes = model.orientation_changes(rotation, vector)
    n = len(rotation)
    frames = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), rotation], axis=2)
    basis = np.linalg.svd(frames.reshape(3 * n, 6), full_matrices=False)
    kept = basis[0][:, basis[1] > 1e-9 * basis[1][0]]
    flat = changes.reshape(3 * n, -1)
    found: Array = (flat - kept @ (kept.T @ flat)).reshape(changes.shape)
    return found


def orientation_error(changes: Array, covariance: Array) -> float:
    """Return the error of orientations, rad rms, by changes and the parameters' covariance."""
    return float(np.sqrt(variances(changes, covariance).sum() / len(changes)))


def variances(changes: Array, covariance: Array) -> Array:
    """Return the variances, shape (...), of what changes with the parameters, shape (..., P)."""
    found: Array = ((changes @ covariance) * changes).sum(axis=-1)
    return found


def proposals(model: MotionModel, vector: Array, information: Array, rate: float,
              changes: Array) -> list[Proposal]:
    """
    Return further motions, the one that determines most first.

    They add samples of the model's noise at a rate, Hz, to the information, (P, P), 1/rad^2, of
    the motion so far and of what was known before. The error counts at the poses of `changes`.
    """
    before = orientation_error(changes, inverse(information))
    columns = tuple(range(model.layout.count))
    found = []
    for text, poses in _motions(model, vector):
        if not len(poses):
            continue
        derivative = model.linearised(
            model.readings(poses, vector), poses, vector, columns).derivative
        rows = derivative.reshape(-1, derivative.shape[2])
        more = rows.T @ rows * (PROPOSED_SECONDS * rate / len(poses))
        after = orientation_error(changes, inverse(information + more))
        found.append(Proposal(text, (before / after) ** 2))
    return sorted(found, key=lambda proposal: -proposal.gain)


def inverse(information: Array) -> Array:
    """Return the covariance of an information matrix; large where it has none."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = np.linalg.eigh(information * scale[:, None] * scale)
    values = np.maximum(values, 1e-13)
    half = vectors / np.sqrt(values) * scale[:, None]
    found: Array = half @ half.T
    return found


def _motions(model: MotionModel, vector: Array) -> list[tuple[str, Array]]:
    """Return instructions and the poses that they lead to."""
    found = [(f'tilt the handle farther {_towards(azimuth)}',
              reachable(model, vector, PROPOSED_TILTS_DEG, (azimuth,), TARGET_TURNS_DEG))
             for azimuth in AZIMUTHS]
    tilts = (0.0, 8.0)
    return [*found,
            ('turn the handle farther to the right (clockwise)',
             reachable(model, vector, tilts, AZIMUTHS[::3], RIGHT_TURNS_DEG)),
            ('turn the handle farther to the left (counter-clockwise)',
             reachable(model, vector, tilts, AZIMUTHS[::3], LEFT_TURNS_DEG))]


@lru_cache(maxsize=len(AZIMUTHS))
def _towards(azimuth: float) -> str:
    """Return a direction of tilt by the legs' motors."""
    centre, tilted = (workspace_pose(tilt, azimuth, 0.0)[:, 2] for tilt in (0.0, 0.2))
    # The nominal motors A, B, C are on z, x, y.
    along = (tilted - centre)[[2, 0, 1]]
    order = np.argsort(-along)
    first, second, last = (LEG_NAMES[leg] for leg in order)
    if along[order[1]] < 0.4 * along[order[0]] or along[order[1]] < 0.0:
        return f"towards leg {first}'s motor"
    if along[order[0]] - along[order[1]] < 0.5 * along[order[0]]:
        return f"away from leg {last}'s motor"
    return f'between the motors of legs {first} and {second}'
