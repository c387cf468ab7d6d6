# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the slow part of the parity says about a calibration: which sensor's zero has slipped.

The whitened errors e of N readings move the parity vector by U^T e, with the columns of U
orthogonal to the whitened Jacobian. A zero that slipped by d in sensor i adds U_i d / sigma_i at
every pose, where U_i changes with the pose; a systematic error of a healthy rig, up to `bias_deg`
of each sensor, is another number at every pose. Readings are summed by pose, so that white noise
averages out in each. A pose's mean parity then has the covariance

    C = 1 + H diag(bias / 2)^2 H^T,   H: parity by error of each sensor, of the pose's mean,

as a bound is two standard deviations, and weighted least squares over the poses give each
sensor's slip, its standard deviation, and the part of the parity that it explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, radians, remainder, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics import Geometry, jacobian, measured_angles
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.inverse_model import batch_angles, velocity_rows
from spm_haptic_master.kinematics.number_backends import Array, FLOATS, MODE_BOUNDARY, Quaternion
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, wrapped

# Turn of a joint after which a systematic error counts as another number (rad): 15 deg, a region
# of the parity map; a second harmonic has gone through a third of its half wave.
POSE_STEP = radians(15.0)
# Standard deviations of the systematic error that its bound `bias_deg` is at least (unit 1):
# calibrate sets 2.5.
BIAS_DEVIATIONS = 2.0
# Standard deviations of the chi-square test of the whole parity (unit 1): false in 1 of 30,000.
TOTAL_DEVIATIONS = 4.0
# Least difference of the misfits of two sensors' slips with which the better one is isolated (unit
# 1): 3 standard deviations.
ISOLATION = 9.0
# Slip that a motion has to show to decide anything, over the larger of `bias_deg` and `sigma_deg`
# (unit 1): supervision lives with once that.
DECIDABLE = 2.0


class Parities(NamedTuple):
    """
    Parity of n samples, in a basis of each sample's own.

    Attributes
    ----------
    usable : ndarray of bool, shape (n,)
        Which samples have an orientation within reach; the values of the others are 0.
    parity : ndarray, shape (n, N - 3)
        Parity vectors, standard deviations of white noise.
    gain : ndarray, shape (n, N - 3, N)
        Parity by the error of each reading, 1/rad.
    step : ndarray, shape (n, 3)
        Rotation vectors to the maximum-likelihood orientations, base frame, rad.

    """

    usable: NDArray[np.bool_]
    parity: Array
    gain: Array
    step: Array


def sensor_angles(
    rotation: Array,
    geometry: Geometry,
    working_mode: WorkingMode,
    sensors: int,
) -> Array:
    """
    Return the joint angles of the sensors by the inverse model.

    Parameters
    ----------
    rotation : ndarray, shape (n, 3, 3)
        Orientations R_base_platform; NaN where there is none.
    geometry : Geometry
        Link angles and axes of the mechanism.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.
    sensors : int
        Number N of sensors.

    Returns
    -------
    ndarray, shape (n, N)
        Angles in the order of ALL_JOINT_NAMES, rad; NaN out of reach.

    """
    found = batch_angles(rotation, geometry, working_mode)
    return np.column_stack([found.theta1, found.theta3a, found.theta3b, found.theta3c])[
        :, :sensors
    ]


def reached(
    rotation: Array,
    geometry: Geometry,
    working_mode: WorkingMode,
    sensors: int,
) -> tuple[NDArray[np.bool_], Array, Array, Array]:
    """
    Return joint angles and Jacobians of the orientations that are within reach.

    Parameters
    ----------
    rotation : ndarray, shape (n, 3, 3)
        Orientations R_base_platform; NaN where there is none.
    geometry : Geometry
        Link angles and axes of the mechanism.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.
    sensors : int
        Number N of sensors.

    Returns
    -------
    usable : ndarray of bool, shape (n,)
        Which orientations are within reach.
    matrices : ndarray, shape (n, 3, 3)
        The orientations; the unit matrix for one with NaN.
    angles : ndarray, shape (n, N)
        Joint angles, rad; 0 where not usable.
    rates : ndarray, shape (n, N, 3)
        Jacobians d angles / d rotation, base frame.

    """
    usable = np.all(np.isfinite(rotation), axis=(1, 2))
    matrices = np.where(usable[:, None, None], rotation, np.eye(3))
    angles = sensor_angles(matrices, geometry, working_mode, sensors)
    rates = jacobian(matrices, geometry, working_mode, sensors=sensors)
    # Without its angle a joint has no rate.
    usable &= np.isfinite(rates).all(axis=(1, 2))
    angles[~usable] = 0.0
    rates[~usable] = np.eye(sensors, 3)
    return usable, matrices, angles, rates


def parities(
    angles: Array,
    rotation: Array,
    sigma: Array,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> Parities:
    """
    Return the parity of samples near given orientations, and its gains.

    Parameters
    ----------
    angles : ndarray, shape (n, N)
        Joint angles, rad.
    rotation : ndarray, shape (n, 3, 3)
        Orientations near the maximum-likelihood ones; NaN where there is none.
    sigma : ndarray, shape (N,)
        White noise of each reading, rad, 1 standard deviation.
    geometry : Geometry
        Link angles and axes of the mechanism.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.

    Returns
    -------
    Parities
        Parity, gains and a step of the orientations.

    """
    usable, _, expected, rates = reached(
        rotation,
        geometry,
        working_mode,
        angles.shape[1],
    )
    return projected(usable, wrapped(angles - expected), rates, sigma)


def parity_of_sample(
    angles: Sequence[float],
    quaternion: Quaternion[float],
    sigma: Array,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> Parities | None:
    """
    Return `parities` of one sample, in plain floats as far as can be: a tenth of the time.

    Parameters
    ----------
    angles : sequence of float
        Readings of the N sensors, rad.
    quaternion : tuple of 4 float
        R_base_platform near the maximum-likelihood one, x, y, z, w.
    sigma : ndarray, shape (N,)
        White noise of each reading, rad, 1 standard deviation.
    geometry : Geometry
        Link angles and axes of the mechanism.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.

    Returns
    -------
    Parities or None
        None if a reading is missing, or the orientation is out of reach or near the edge of the
        working mode.

    """
    rotation = rotation_from_quaternion(*quaternion)
    try:
        expected = measured_angles(rotation, geometry, working_mode, len(angles))
    except UnreachableError:
        return None
    first_a, first_b, first_c, *_ = expected
    rows, diagonal = velocity_rows(
        rotation,
        (first_a, first_b, first_c),
        geometry,
        FLOATS,
    )
    residual = np.array(
        [remainder(angle - each, 2.0 * pi) for angle, each in zip(angles, expected, strict=True)]
    )
    if not min(map(abs, diagonal[:3])) >= MODE_BOUNDARY or np.isnan(residual).any():
        return None
    sensors = len(angles)
    rates = np.array(rows[:sensors]) / np.array(diagonal[:sensors])[:, None]
    return projected(
        usable=np.ones(1, bool),
        residual=residual[None],
        rates=rates[None],
        sigma=sigma,
    )


def projected(
    usable: NDArray[np.bool_],
    residual: Array,
    rates: Array,
    sigma: Array,
) -> Parities:
    """
    Split whitened residuals into what a rotation explains and what none does.

    By a QR decomposition of the whitened Jacobian: its first three columns give the least-squares
    rotation (a Gauss-Newton step), the others, orthogonal to the Jacobian, the parity.

    Parameters
    ----------
    usable : ndarray of bool, shape (n,)
        Which samples count; the parity of the others is 0.
    residual : ndarray, shape (n, N)
        Reading minus angle at the orientations, rad.
    rates : ndarray, shape (n, N, 3)
        Jacobian J = d angles / d rotation of each sample.
    sigma : ndarray, shape (N,)
        White noise of each reading, rad, 1 standard deviation.

    Returns
    -------
    Parities
        Parity, gains and steps.

    """
    white = np.where(usable[:, None], residual / sigma, 0.0)
    orthogonal, upper = np.linalg.qr(rates / sigma[:, None], mode='complete')
    across = orthogonal[:, :, 3:].swapaxes(1, 2)
    explained = orthogonal[:, :, :3].swapaxes(1, 2)
    along = explained @ white[:, :, None]
    step = np.linalg.solve(upper[:, :3], along)[:, :, 0]
    gain = np.where(usable[:, None, None], across / sigma, 0.0)
    return Parities(
        usable=usable,
        parity=(across @ white[:, :, None])[:, :, 0],
        gain=gain,
        step=step,
    )


def poses_of(angles: Array) -> NDArray[np.int64]:
    """
    Return the pose that each sample counts for: its motor angles in units of `POSE_STEP`.

    Parameters
    ----------
    angles : ndarray, shape (n, N)
        Joint angles, rad.

    Returns
    -------
    ndarray of int, shape (n, 3)
        The same numbers for samples of one pose.

    """
    return np.floor(wrapped(angles[:, :3]) / POSE_STEP).astype(np.int64)


class PoseSums(NamedTuple):
    """
    Sums over the samples of each of m poses, independent of the basis of the parity.

    Attributes
    ----------
    samples : ndarray, shape (m,)
        Number of samples, or their weight.
    information : ndarray, shape (m, N, N)
        Sum of gain^T gain, 1/rad^2.
    score : ndarray, shape (m, N)
        Sum of gain^T parity, 1/rad.

    """

    samples: Array
    information: Array
    score: Array


def summed(angles: Array, found: Parities) -> PoseSums:
    """
    Return the sums over the usable ones of samples by pose.

    Parameters
    ----------
    angles : ndarray, shape (n, N)
        Joint angles, rad.
    found : Parities
        Parities of the samples.

    Returns
    -------
    PoseSums
        Sums of the poses that have samples.

    """
    usable = found.usable
    of_samples = poses_of(angles[usable])
    poses, row = np.unique(of_samples, axis=0, return_inverse=True)
    sensors = angles.shape[1]
    sums = PoseSums(
        samples=np.zeros(len(poses)),
        information=np.zeros((len(poses), sensors, sensors)),
        score=np.zeros((len(poses), sensors)),
    )
    row = row.ravel()
    gain = found.gain[usable]
    parity = found.parity[usable]
    np.add.at(sums.samples, row, 1.0)
    np.add.at(sums.information, row, gain.swapaxes(1, 2) @ gain)
    np.add.at(sums.score, row, np.einsum('nki,nk->ni', gain, parity))
    return sums


@dataclass(frozen=True, slots=True)
class Evaluation:
    """
    What the slow parity says of each sensor.

    Attributes
    ----------
    slip : ndarray, shape (N,)
        Reading less true angle if this sensor alone slipped, rad.
    deviation : ndarray, shape (N,)
        Standard deviation of the slip by noise and bias, rad.
    explained : ndarray, shape (N,)
        What such a slip explains of `misfit` (unit 1); noise and bias alone: about 1.
    together : ndarray, shape (N,)
        Slips of all sensors if all of them slipped, rad.
    misfit : float
        Sum of squared parities over their variances (unit 1); healthy: about `freedom`.
    freedom : int
        Number of poses times N - 3.
    slow : float
        Slow parity, rad rms.
    expected : float
        What noise and bias allow of it, rad rms.
    white : float
        What noise alone allows of it, rad rms.

    """

    slip: Array
    deviation: Array
    explained: Array
    together: Array
    misfit: float
    freedom: int
    slow: float
    expected: float
    white: float

    @property
    def threshold(self) -> float:
        """
        Return the detection threshold of a slip, in standard deviations.

        All sensors at the bound of their bias, with the worst signs, make sqrt(N) times two of
        them at one pose: that is no slip.
        """
        return BIAS_DEVIATIONS * sqrt(len(self.slip))

    @property
    def visible(self) -> Array:
        """Return the smallest slip of each sensor that would show, rad."""
        return self.threshold * self.deviation

    @property
    def merit(self) -> float:
        """Return the figure of merit: slow parity over what noise and bias allow, rms (unit 1)."""
        return sqrt(self.misfit / self.freedom)

    @property
    def limit(self) -> float:
        """
        Return what a healthy misfit exceeds in 1 of 30,000.

        The quantile of chi-square with `freedom` degrees, approximated by Wilson and Hilferty
        (1931).
        """
        part = 2.0 / (9.0 * self.freedom)
        return self.freedom * (1.0 - part + TOTAL_DEVIATIONS * sqrt(part)) ** 3

    @property
    def poses(self) -> int:
        """Return the number of independent poses."""
        return self.freedom // (len(self.slip) - 3)

    def holds(self, part: float = 1.0) -> bool:
        """
        Return whether noise and bias explain the parity.

        Parameters
        ----------
        part : float, optional
            Factor of the limits (unit 1): below 1 it is stricter, for a hysteresis.

        Returns
        -------
        bool
            True if no slip is beyond its threshold, nor the misfit beyond its limit.

        """
        slipped = (self.explained > (part * self.threshold) ** 2).any()
        return not slipped and self.misfit <= part * self.limit


def suspects(
    left: Array,
    freedom: int,
    limit: float,
) -> tuple[int, ...]:
    """
    Return the sensors whose slips explain the parity about as well as the best one does.

    Differences count in units of what the best one leaves, where that is less than `bias_deg`
    allows: as if N further numbers had been as large as that. One sensor alone is isolated.

    Parameters
    ----------
    left : ndarray, shape (N,)
        Misfit that each sensor's slip leaves (unit 1).
    freedom : int
        Number of poses times N - 3.
    limit : float
        Largest misfit that a slip may leave.

    Returns
    -------
    tuple of int
        Indices, the best one first; empty where each slip leaves more than the limit.

    """
    order = np.argsort(left).tolist()
    least = float(left.min())
    if least > limit or not np.isfinite(least):
        return ()
    scale = min(1.0, (len(left) + least) / (len(left) + freedom))
    return tuple(sensor for sensor in order if left[sensor] - least < ISOLATION * scale)


def evaluate(sums: PoseSums, bias: Array) -> Evaluation:
    """
    Return what sums by pose say of each sensor.

    Weighted least squares over the poses with the covariance C of the module's description.

    Parameters
    ----------
    sums : PoseSums
        Sums of m poses, at least one of them with a sample.
    bias : ndarray, shape (N,)
        Bound of each sensor's systematic error, rad.

    Returns
    -------
    Evaluation
        Slips, their standard deviations, and how much of the parity is left.

    """
    sensors = len(bias)
    kept = sums.samples > 0.0
    samples = sums.samples[kept]
    values, vectors = np.linalg.eigh(sums.information[kept])
    # Within a pose the gains are nearly one: the largest N - 3 values are those of its mean.
    values = values[:, 3:]
    vectors = vectors[:, :, 3:]
    root = np.sqrt(np.maximum(values, np.finfo(float).tiny))
    parity = np.einsum('mik,mi->mk', vectors, sums.score[kept]) / root
    gain = root[:, :, None] * vectors.swapaxes(1, 2)
    variance = (bias / BIAS_DEVIATIONS) ** 2
    by_bias = (gain * variance) @ gain.swapaxes(1, 2)
    covariance = np.eye(sensors - 3) + by_bias
    # C^-1 times gains and parity: normal equations of weighted least squares over the poses.
    columns = np.concatenate([gain, parity[:, :, None]], axis=2)
    weighted = np.linalg.solve(covariance, columns)
    every = np.einsum('mki,mkj->ij', gain, weighted[:, :, :sensors])
    information = np.diag(every)
    score = np.einsum('mki,mk->i', gain, weighted[:, :, sensors])
    misfit = float(np.einsum('mk,mk->', parity, weighted[:, :, sensors]))
    # Without information there is no score, and the deviation is beyond all bounds.
    seen = np.maximum(information, np.finfo(float).tiny)
    together = np.linalg.lstsq(every, score, rcond=None)[0]

    def rms(squares: Array) -> float:
        """Return the root mean square of what has these squares, weighted by samples."""
        of_poses = squares.mean(axis=1)
        return float(np.sqrt(np.average(of_poses, weights=samples)))

    diagonal = np.einsum('mkk->mk', covariance)
    return Evaluation(
        slip=score / seen,
        deviation=seen**-0.5,
        explained=score**2 / seen,
        together=together,
        misfit=misfit,
        freedom=parity.size,
        slow=rms((parity / root) ** 2),
        expected=rms(diagonal / root**2),
        white=rms(root**-2.0),
    )
