# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where in a region of the workspace the other sensors can check each sensor: known before use."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, inf, radians, sqrt

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.estimation.sample_estimates import estimate_sample
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.inverse_model import measured_angles, RIG_WORKING_MODE
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, UsedSensors
from spm_haptic_master.kinematics.rotations import quaternion_from_matrix, rotation_from_quaternion
from spm_haptic_master.kinematics.workspace import workspace_pose
from spm_haptic_master.parameters.fkm import Limits, limits_from, sigma_from
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.supervision.parity import WINDOW_SAMPLES
from spm_haptic_master.supervision.protection import integrity, MISSED_DETECTION

# The part of the workspace that a device is used in: tilts to 20 deg on both sides of the
# singularity, which lies near a self-rotation of 50 deg.
WORKSPACE_TILT = radians(20.0)
WORKSPACE_TURNS = (0.0, radians(90.0))
# Numbers of tilts, azimuths and self-rotations at which a region is evaluated.
TILTS = 5
AZIMUTHS = 8
TURNS = 13


@dataclass(frozen=True, slots=True)
class Checkability:
    """
    How far the others can check each of N sensors in a region, in the order of ALL_JOINT_NAMES.

    Attributes
    ----------
    share : tuple of float
        Share of the reachable poses at which each sensor's part of the protection level is within
        the alert limit, 0 to 1.
    least_limit : tuple of float
        Smallest part of each sensor at any of the poses, rad: with an alert limit below it, the
        sensor is checked nowhere. Infinite if no pose is within reach.

    """

    share: tuple[float, ...]
    least_limit: tuple[float, ...]

    @property
    def nowhere(self) -> tuple[int, ...]:
        """Return the indices of the sensors that are checked at no pose of the region."""
        return tuple(sensor for sensor, share in enumerate(self.share) if share == 0.0)


def region_poses(tilt: float, first: float, last: float) -> NDArray[np.float64]:
    """
    Return orientations spread evenly over a region of the workspace.

    Parameters
    ----------
    tilt : float
        Largest tilt of the platform axis from the centre of the workspace, rad.
    first, last : float
        Least and largest self-rotation, rad.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        R_base_platform, each for the same area of the cone.

    """
    middles = (np.arange(TILTS) + 0.5) / TILTS
    tilts = np.arccos(1.0 - middles * (1.0 - np.cos(tilt)))
    azimuths = np.linspace(0.0, 2.0 * np.pi, AZIMUTHS, endpoint=False)
    turns = np.linspace(first, last, TURNS)
    grid = np.meshgrid(tilts, azimuths, turns, indexing='ij')
    return workspace_pose(*(axis.ravel() for axis in grid))


def checkability(
    geometry: Geometry,
    sigma: tuple[float, ...],
    limits: Limits,
    poses: NDArray[np.float64] | None = None,
    rate: float = 1000.0,
    working_mode: WorkingMode = RIG_WORKING_MODE,
) -> Checkability:
    """
    Return where in a region the others can check each sensor, all of them in use.

    These are the checks of `fkm` with consistent readings at these poses, once its window is full
    and no rival orientation is left, to the first order: near a fold, where two solutions of the
    others meet, `fkm` has larger parts (see `folds`).

    Parameters
    ----------
    geometry : Geometry
        The mechanism.
    sigma : tuple of float, length N
        Standard deviation of the noise of each of 4, 5 or 6 sensors, rad.
    limits : Limits
        Nominal biases, alert limit, window and rate of false alarms (see `limits_from`).
    poses : ndarray, shape (n, 3, 3), optional
        R_base_platform of the region; by default the workspace within a tilt of 20 deg.
    rate : float
        Rate of the samples, Hz.
    working_mode : tuple of int
        Signs of B_kk of the legs A, B, C (eq. 10).

    Returns
    -------
    Checkability
        Share and smallest alert limit of each sensor. Poses out of reach do not count.

    """
    if poses is None:
        poses = region_poses(WORKSPACE_TILT, *WORKSPACE_TURNS)
    sensors = UsedSensors(sigma)
    samples = max(WINDOW_SAMPLES, limits.window * rate)
    threshold = limits.threshold(sensors.count - 3)
    undetected = (threshold + MISSED_DETECTION) / sqrt(samples)
    noise = (1.0,) * len(sigma)
    parts = []
    for pose in poses:
        try:
            x, y, z, w = quaternion_from_matrix(pose).tolist()
            prior = x, y, z, w
            rotation = rotation_from_quaternion(*prior)
            readings = measured_angles(rotation, geometry, working_mode, len(sigma))
            estimate = estimate_sample(readings, sensors, geometry, prior, working_mode)
        except SpmError:
            continue
        worth = integrity(estimate, limits.bias, noise, limits.parity_bias)
        parts.append(worth.parts(undetected))
    if not parts:
        none = (0.0,) * len(sigma)
        return Checkability(share=none, least_limit=(inf,) * len(sigma))
    table = np.array(parts)
    share = np.mean(table <= limits.alert_limit, axis=0)
    least = np.min(table, axis=0)
    return Checkability(share=tuple(share.tolist()), least_limit=tuple(least.tolist()))


def unchecked_anywhere(values: Values) -> str:
    """
    Return which sensors the others can check nowhere in the workspace, in words.

    Parameters
    ----------
    values : dict
        Checked settings of `fkm`.

    Returns
    -------
    str
        One line for people with the least alert limit of each; empty if there is none.

    """
    sigma = sigma_from(values)
    found = checkability(
        geometry_from(values),
        sigma,
        limits_from(values),
        rate=values['rate'],
        working_mode=values['working_mode'],
    )
    if not found.nowhere:
        return ''
    names = ', '.join(
        f'{ALL_JOINT_NAMES[sensor]} (from {degrees(found.least_limit[sensor]):.2f} deg on)'
        for sensor in found.nowhere
    )
    limit = values['alert_limit_deg']
    return f'checked nowhere in the workspace at alert_limit_deg {limit:g}: {names}'
