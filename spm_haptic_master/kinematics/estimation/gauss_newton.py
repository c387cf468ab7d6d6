# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Gauss-Newton on one joint sample, in plain floats for the 1 kHz path, and on rows of a batch.

On closures and corrections together it minimises the weighted sum of the squared corrections.
Unlike the angles of the inverse model, the closures exist for all readings, also just outside the
reach of a leg, and each leg stays in the working mode of its reading.
"""

from __future__ import annotations

from math import cos, hypot, sin, sqrt
from typing import NamedTuple

import numpy as np
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.closed_form import CLOSED_FORM_TRUST
from spm_haptic_master.kinematics.estimation.normal_equations import (
    closed_leg,
    gauss_newton_step,
    in_base_frame,
    linearise,
    NO_SHARE,
    normal_equations,
    parities,
    Row,
    State,
    Symmetric,
)
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.joints import FEWEST_MOUNTED, UsedSensors
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    Linkage,
    linkage,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.number_backends import (
    Array,
    ARRAYS,
    Batch,
    FLOATS,
    Quaternion,
    Rotation,
)
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, stack_matrix

# Largest last Gauss-Newton step (rad): each step is shorter than the one before by a factor of the
# noise (in rad) or less, so that the error after this one is 1e-8 rad at 0.04 deg.
CONVERGED_STEP = 1e-5
# Largest number of Gauss-Newton steps, of a sample and of rows together; two are usual. Rows that
# need more are done one by one.
STEPS, BATCH_STEPS = 30, 6
# Longest step along any coordinate (rad); a longer one is shortened to it.
LONGEST_STEP = 0.3
# Largest determinant of the normal equations that counts as zero (product of their diagonal).
RANK_TOLERANCE = 1e-12
# Largest |B_kk| of the wrong sign that noise causes near the boundary of a working mode (unit 1).
MODE_MARGIN = 0.02
# Largest total standard deviation of a determined orientation (rad): beyond some 6 deg the
# first-order covariance does not describe the error.
DETERMINED_DEVIATION = 0.1
DETERMINED_VARIANCE = DETERMINED_DEVIATION**2


class SampleEstimate(NamedTuple):
    """Maximum-likelihood orientation of one sample of N mounted sensors, in plain floats."""

    # Unit quaternion x, y, z, w of R_base_platform, of either sign.
    quaternion: Quaternion[float]
    # Covariance of the rotation error, a rotation vector in the base frame, rad^2, row by row.
    covariance: Rotation[float]
    # As of `Estimate`; the parity is None with three sensors.
    parity: float | None
    parity_vector: tuple[float, ...]
    determined: bool
    sensors: UsedSensors
    # Lengths of the N parity gains (1 / rad) and gains (unit 1); 0 for a sensor that is left out.
    parity_sizes: tuple[float, ...]
    gain_sizes: tuple[float, ...]
    # Of `linearise` and `gauss_newton_step`; `parity_gains` needs them.
    rows: tuple[Row[float], ...]
    spread: Symmetric[float]

    @property
    def parity_gains(self) -> tuple[tuple[float, ...], ...]:
        """Change of the parity vector with each of the N readings, 1 / rad."""
        _, changes = parities(self.rows, self.sensors, self.spread, FLOATS)
        return tuple(zip(*changes, strict=True)) if changes else ((),) * len(self.rows)


def fit(
    state: State[float],
    view: Linkage[float],
    readings: tuple[float, ...],
    sensors: UsedSensors,
    g: Geometry,
    working_mode: WorkingMode | None,
    last_step: float = CONVERGED_STEP,
) -> SampleEstimate:
    """Gauss-Newton from a state with its `linkage`; arguments, errors as of `estimate_sample`."""
    for _ in range(STEPS):
        legs, rows = linearise(state, view, readings, sensors, g, FLOATS)
        right, entries, determinant, product = normal_equations(rows)
        if not determinant > RANK_TOLERANCE * product:
            raise SingularityError(
                f'readings {readings} rad: the sensors do not measure every direction'
            )
        step, spread = gauss_newton_step(right, legs, entries, determinant)
        # By comparison: a call for each component costs as much as the step.
        d1, d2, d3, db, dc = step
        converged = (
            -last_step < d1 < last_step
            and -last_step < d2 < last_step
            and -last_step < d3 < last_step
            and -last_step < db < last_step
            and -last_step < dc < last_step
        )
        if not converged:
            scale = min(1.0, LONGEST_STEP / max(map(abs, step)))
            d1, d2, d3, db, dc = (scale * each for each in step)
        th1a, th2a, th3a, th1b, th1c = state
        th1a, th2a, th3a, th1b, th1c = state = (
            th1a + d1,
            th2a + d2,
            th3a + d3,
            th1b + db,
            th1c + dc,
        )
        if converged:
            break
        view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
    else:
        raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')
    if working_mode is not None and not _in_mode(
        th2a, legs[0][4], legs[1][4], sensors, working_mode, g
    ):
        raise SingularityError(
            f'the angles fit together only in another working mode than {list(working_mode)}'
        )
    covariance, motions = in_base_frame(th1a, th2a, spread, g, FLOATS)
    vector, changes = parities(rows, sensors, spread, FLOATS)
    parity_sizes = tuple(map(hypot, *changes)) if changes else (0.0,) * len(rows)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = motions
    gain_sizes = tuple(
        [
            weight
            * hypot(x * ax + y * bx + z * cx, x * ay + y * by + z * cy, x * az + y * bz + z * cz)
            for _, x, y, z, weight in rows
        ]
    )
    return SampleEstimate(
        chain_quaternion(th1a, th2a, th3a, g, FLOATS),
        covariance,
        vector[0] if len(vector) == 1 else hypot(*vector) if vector else None,
        vector,
        covariance[0] + covariance[4] + covariance[8] < DETERMINED_VARIANCE,
        sensors,
        parity_sizes,
        gain_sizes,
        rows,
        spread,
    )


def _in_mode(
    th2a: float,
    volume_b: float,
    volume_c: float,
    sensors: UsedSensors,
    working_mode: WorkingMode,
    g: Geometry,
) -> bool:
    """Return whether a solution is in a working mode; a leg without a sensor may have any."""
    leg, (sign_a, sign_b, sign_c) = g.legs[0], working_mode
    # B_AA, the volume of Z1A, Z2A, Z3A, is here sin alpha sin beta sin th2A.
    return (
        sign_b * volume_b > -MODE_MARGIN
        and sign_c * volume_c > -MODE_MARGIN
        and (
            sign_a * leg.sin_alpha * leg.sin_beta * sin(th2a) > -MODE_MARGIN
            or {0, 3}.isdisjoint(sensors.used)
        )
    )


def one_step(
    state: State[float],
    view: Linkage[float],
    readings: tuple[float, ...],
    sensors: UsedSensors,
    g: Geometry,
    working_mode: WorkingMode | None,
    last_step: float,
) -> SampleEstimate | None:
    """
    Estimate a sample by one step from Case 2 of its readings; None if that is not enough.

    The numbers are those of `fit`, whose kernels are written out here for th1A, th1B, th1C and
    th3A in use: the readings are the start, so that th1A and th3A have no residual.
    """
    th1a, th2a, th3a, _, _ = state
    turn_1, turn_3, leg_b, leg_c = view
    turns = turn_1, (cos(th2a), sin(th2a)), turn_3
    weight_a, weight_b, weight_c, weight_3, weight_3b, weight_3c = sensors.weights
    (left_b, b1, b2, b3, volume_b), row_3b = closed_leg(
        turns, leg_b, g, 1, readings[4] if weight_3b else None, weight_3b, FLOATS
    )
    (left_c, d1, d2, d3, volume_c), row_3c = closed_leg(
        turns, leg_c, g, 2, readings[5] if weight_3c else None, weight_3c, FLOATS
    )
    wb1, wb2, wb3 = weight_b * b1, weight_b * b2, weight_b * b3
    wc1, wc2, wc3 = weight_c * d1, weight_c * d2, weight_c * d3
    n11, n12, n13 = weight_a + wb1 * b1 + wc1 * d1, wb2 * b1 + wc2 * d1, wb3 * b1 + wc3 * d1
    n22, n23, n33 = wb2 * b2 + wc2 * d2, wb3 * b2 + wc3 * d2, weight_3 + wb3 * b3 + wc3 * d3
    y1, y2, y3 = (
        wb1 * left_b + wc1 * left_c,
        wb2 * left_b + wc2 * left_c,
        wb3 * left_b + wc3 * left_c,
    )
    further = (row_3b, row_3c)[: sensors.further]
    for residual, x, y, z, weight in further:
        wx, wy, wz = weight * x, weight * y, weight * z
        n11, n12, n13 = n11 + wx * x, n12 + wy * x, n13 + wz * x
        n22, n23, n33 = n22 + wy * y, n23 + wz * y, n33 + wz * z
        y1, y2, y3 = y1 + wx * residual, y2 + wy * residual, y3 + wz * residual
    e11, e12, e13 = n22 * n33 - n23 * n23, n13 * n23 - n12 * n33, n12 * n23 - n13 * n22
    e22, e23, e33 = n11 * n33 - n13 * n13, n12 * n13 - n11 * n23, n11 * n22 - n12 * n12
    determinant = n11 * e11 + n12 * e12 + n13 * e13
    if not determinant > RANK_TOLERANCE * (n11 * n22 * n33):
        return None
    p11, p12, p13 = e11 / determinant, e12 / determinant, e13 / determinant
    p22, p23, p33 = e22 / determinant, e23 / determinant, e33 / determinant
    x, y, z = (
        p11 * y1 + p12 * y2 + p13 * y3,
        p12 * y1 + p22 * y2 + p23 * y3,
        p13 * y1 + p23 * y2 + p33 * y3,
    )
    if not (
        -last_step < x < last_step
        and -last_step < y < last_step
        and -last_step < z < last_step
        and -last_step < b1 * x + b2 * y + b3 * z - left_b < last_step
        and -last_step < d1 * x + d2 * y + d3 * z - left_c < last_step
    ):
        return None
    th1a, th2a, th3a = th1a + x, th2a + y, th3a + z
    if working_mode is not None and not _in_mode(
        th2a, volume_b, volume_c, sensors, working_mode, g
    ):
        return None
    covariance = p11, p12, p13, p22, p23, p33
    spread, motions = in_base_frame(th1a, th2a, covariance, g, FLOATS)
    na, nb, nc, n3 = b2 * d1 - b1 * d2, d2, -b2, b2 * d3 - b3 * d2
    variance = na * na / weight_a + nb * nb / weight_b + nc * nc / weight_c + n3 * n3 / weight_3
    scale = 1.0 / sqrt(variance) if variance > 0.0 else 0.0
    parity = scale * (nb * left_b + nc * left_c)
    vector: tuple[float, ...] = (parity,)
    rows: tuple[Row[float], ...] = (
        (0.0, 1.0, 0.0, 0.0, weight_a),
        (left_b, b1, b2, b3, weight_b),
        (left_c, d1, d2, d3, weight_c),
        (0.0, 0.0, 0.0, 1.0, weight_3),
    )
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = motions
    gain_sizes: tuple[float, ...] = (
        weight_a * hypot(ax, ay, az),
        weight_b
        * hypot(
            b1 * ax + b2 * bx + b3 * cx, b1 * ay + b2 * by + b3 * cy, b1 * az + b2 * bz + b3 * cz
        ),
        weight_c
        * hypot(
            d1 * ax + d2 * bx + d3 * cx, d1 * ay + d2 * by + d3 * cy, d1 * az + d2 * bz + d3 * cz
        ),
        weight_3 * hypot(cx, cy, cz),
    )
    parity_sizes: tuple[float, ...]
    if sensors.count == FEWEST_MOUNTED:
        parity_sizes = abs(scale * na), abs(scale * nb), abs(scale * nc), abs(scale * n3)
    else:
        # P = I - H K is a projector: a size is the root of weight and share, P's diagonal.
        t12, t13, t23 = 2.0 * p12, 2.0 * p13, 2.0 * p23
        share_a, share_3 = 1.0 - weight_a * p11, 1.0 - weight_3 * p33
        share_b = 1.0 - (
            wb1 * (p11 * b1 + t12 * b2 + t13 * b3) + wb2 * (p22 * b2 + t23 * b3) + wb3 * b3 * p33
        )
        share_c = 1.0 - (
            wc1 * (p11 * d1 + t12 * d2 + t13 * d3) + wc2 * (p22 * d2 + t23 * d3) + wc3 * d3 * p33
        )
        parity_sizes = (
            sqrt(weight_a * share_a) if share_a > NO_SHARE else 0.0,
            sqrt(weight_b * share_b) if share_b > NO_SHARE else 0.0,
            sqrt(weight_c * share_c) if share_c > NO_SHARE else 0.0,
            sqrt(weight_3 * share_3) if share_3 > NO_SHARE else 0.0,
        )
    if further:
        rows += further
        sizes: tuple[float, ...] = ()
        gains: tuple[float, ...] = ()
        more: tuple[float, ...] = ()
        last = h1 = h2 = h3 = 0.0
        square = parity * parity
        # Backwards: each parity compares a sensor with those before it.
        for residual, u, v, w, weight in reversed(further):
            g1, g2, g3 = (
                p11 * u + p12 * v + p13 * w,
                p12 * u + p22 * v + p23 * w,
                p13 * u + p23 * v + p33 * w,
            )
            share = 1.0 - weight * (u * g1 + v * g2 + w * g3)
            size = sqrt(weight * share) if share > NO_SHARE else 0.0
            sizes = (size,) + sizes
            gains = (
                weight
                * hypot(
                    u * ax + v * bx + w * cx, u * ay + v * by + w * cy, u * az + v * bz + w * cz
                ),
            ) + gains
            if not weight:
                continue
            left = residual - u * x - v * y - w * z
            if more:
                cross = u * h1 + v * h2 + w * h3
                left, share = left + cross * last, share - weight * cross * cross
                size = sqrt(weight * share) if share > NO_SHARE else 0.0
            scale = weight / size if size else 0.0
            last = scale * left
            square += last * last
            h1, h2, h3 = scale * g1, scale * g2, scale * g3
            more = (last,) + more
        gain_sizes += gains
        parity_sizes += sizes
        if more:
            vector, parity = vector + more, sqrt(square)
    # As SampleEstimate(...) does, without its call.
    return tuple.__new__(
        SampleEstimate,
        (
            chain_quaternion(th1a, th2a, th3a, g, FLOATS),
            spread,
            parity,
            vector,
            spread[0] + spread[4] + spread[8] < DETERMINED_VARIANCE,
            sensors,
            parity_sizes,
            gain_sizes,
            rows,
            covariance,
        ),
    )


def fit_rows(readings: Array, sensors: UsedSensors, g: Geometry) -> tuple[Array, Array, Array]:
    """Fit rows (n, N), rad: rotation, covariance, parity vector; NaN without convergence."""
    columns: tuple[Batch, ...] = tuple(np.ascontiguousarray(readings.T))
    th1a, th1b, th1c, th3a = columns[:4]
    view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
    th2a: Batch = np.arctan2(sine * determinant, cosine * determinant)
    state: State[Batch] = th1a, th2a, th3a, th1b, th1c
    trusted = np.abs(determinant) > CLOSED_FORM_TRUST * sensors.largest
    # Rows that are not trusted may diverge here; they are done one by one afterwards.
    with np.errstate(all='ignore'):
        for _ in range(BATCH_STEPS):
            legs, rows = linearise(state, view, columns, sensors, g, ARRAYS)
            right, entries, determinant, product = normal_equations(rows)
            step, spread = gauss_newton_step(right, legs, entries, determinant)
            d1, d2, d3, db, dc = step
            th1a, th2a, th3a, th1b, th1c = state = (
                th1a + d1,
                th2a + d2,
                th3a + d3,
                th1b + db,
                th1c + dc,
            )
            longest = np.max([np.abs(each) for each in step], axis=0)
            trusted &= (longest < LONGEST_STEP) & (determinant > RANK_TOLERANCE * product)
            settled = trusted & (longest < CONVERGED_STEP)
            if np.array_equal(settled, trusted):
                break
            view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
        vector = np.stack(parities(rows, sensors, spread, ARRAYS)[0], axis=-1)
        covariance = stack_matrix(in_base_frame(th1a, th2a, spread, g, ARRAYS)[0])
        quaternion = chain_quaternion(th1a, th2a, th3a, g, ARRAYS)
        rotation = stack_matrix(rotation_from_quaternion(*quaternion))
    rotation[~settled], covariance[~settled], vector[~settled] = np.nan, np.nan, np.nan
    return rotation, covariance, vector
