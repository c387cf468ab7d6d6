# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Parity vector of one joint sample: kernels of the estimate.

The parity vector is U^T r of the whitened residuals r, with an orthonormal U whose columns no
motion of the platform reaches: U^T H = 0 with the whitened Jacobian H, and U U^T = P = I - H K.
Its first entry is the parity of the first four sensors in use. Each further one is what the next
sensor differs by from the estimate of those before it, over its standard deviation.

`rows` are those of `linearise`. Each function returns entries of the
vector (unit 1) and their change with the readings of the N mounted sensors (1 / rad).
"""

from __future__ import annotations

from typing import TypeAlias

from spm_haptic_master.kinematics.estimation.linearisation import Row
from spm_haptic_master.kinematics.estimation.normal_equations import Symmetric
from spm_haptic_master.kinematics.estimation.used_sensors import FEWEST_USED, UsedSensors
from spm_haptic_master.kinematics.number_backends import Backend, N, Vector

# Change of a parity with the readings of the N mounted sensors (1 / rad).
ParityRow: TypeAlias = tuple[N, ...]
# Largest share of a sensor's variance in its residual that counts as zero (unit 1): the difference
# of two numbers of size 1 and of rounding. The others do not check such a sensor.
NO_SHARE = 1e-12


def parities(rows: tuple[Row[N], ...], sensors: UsedSensors, covariance: Symmetric[N],
             m: Backend[N]) -> tuple[tuple[N, ...], tuple[ParityRow[N], ...]]:
    """
    Compute the parity vector from the covariance of th1A, th2A, th3A of `gauss_newton_step`.

    An entry that nothing but rounding would make is 0, as is the change with a sensor left out.
    """
    if sensors.count == FEWEST_USED:
        return (), ()
    further, further_changes = further_parities(rows, sensors, covariance, m)
    # The one combination of the first four residuals that no motion of the platform changes.
    places = sensors.used[:4]
    p, q, r, s = (rows[place][1:4] for place in places)
    parts = -_volume(q, r, s), _volume(p, r, s), -_volume(p, q, s), _volume(p, q, r)
    variance: N = 0.0
    for part, place in zip(parts, places, strict=True):
        variance = variance + part * part / sensors.weights[place]
    scale = m.reciprocal_root(variance, 0.0)
    line: list[N] = [0.0] * len(rows)
    parity: N = 0.0
    for part, place in zip(parts, places, strict=True):
        line[place] = scale * part
        parity = parity + scale * part * rows[place][0]
    return (parity,) + further, (tuple(line),) + further_changes


def further_parities(
        rows: tuple[Row[N], ...], sensors: UsedSensors, covariance: Symmetric[N],
        m: Backend[N]) -> tuple[tuple[N, ...], tuple[ParityRow[N], ...]]:
    """Return the parities of the sensors in use beyond the first four; see `parities`."""
    (ra, _, _, _, weight_a), (rb, b1, b2, b3, weight_b), (rc, c1, c2, c3, weight_c), (
        r3, _, _, _, weight_3), *others = rows
    p11, p12, p13, p22, p23, p33 = covariance
    vector: list[N] = []
    changes: list[ParityRow[N]] = []
    # From the last one: the covariance is that of all sensors, and without it of those before it.
    for place in reversed(sensors.used[4:]):
        residual, x, y, z, weight = rows[place]
        g1, g2, g3 = (p11 * x + p12 * y + p13 * z, p12 * x + p22 * y + p23 * z,
                      p13 * x + p23 * y + p33 * z)
        # The variance of the sensor's residual in the fit, which it has drawn, over its own.
        share = 1.0 - weight * (x * g1 + y * g2 + z * g3)
        size = m.reciprocal_root(share, NO_SHARE) / sensors.sigma[place]
        pa, pb, pc, p3, own = (
            -size * weight_a * g1, -size * weight_b * (b1 * g1 + b2 * g2 + b3 * g3),
            -size * weight_c * (c1 * g1 + c2 * g2 + c3 * g3), -size * weight_3 * g3, size * share)
        parity = pa * ra + pb * rb + pc * rc + p3 * r3 + own * residual
        line: ParityRow[N] = (pa, pb, pc, p3)
        for residual, x, y, z, weight in others[:place - 4]:
            before = -size * weight * (x * g1 + y * g2 + z * g3)
            parity = parity + before * residual
            line += (before,)
        vector.append(parity)
        changes.append(line + (own,) + (0.0,) * (len(rows) - place - 1))
        size = size * size
        h1, h2, h3 = size * g1, size * g2, size * g3
        p11, p12, p13 = p11 + h1 * g1, p12 + h1 * g2, p13 + h1 * g3
        p22, p23, p33 = p22 + h2 * g2, p23 + h2 * g3, p33 + h3 * g3
    return tuple(vector[::-1]), tuple(changes[::-1])


def _volume(p: Vector[N], q: Vector[N], r: Vector[N]) -> N:
    """Return the determinant of three rows."""
    p1, p2, p3 = p
    q1, q2, q3 = q
    r1, r2, r3 = r
    return p1 * (q2 * r3 - q3 * r2) + p2 * (q3 * r1 - q1 * r3) + p3 * (q1 * r2 - q2 * r1)
