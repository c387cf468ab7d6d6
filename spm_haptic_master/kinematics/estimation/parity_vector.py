# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Parity vector of one joint sample: kernels of the estimate.

The parity vector is U^T r of the whitened residuals r, with an orthonormal U whose columns no
motion of the platform reaches: U^T H = 0 with the whitened Jacobian H, and U U^T = P = I - H K.
Its first entry is the parity of the first four sensors in use. Each further one is what the next
sensor differs by from the estimate of those before it, over its standard deviation.

`rows` are those of `linearise`.
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
    places = sensors.used
    p11, p12, p13, p22, p23, p33 = covariance
    lines: list[list[N]] = []
    # From the last one: the covariance is that of all sensors, and without it of those before it.
    for index in range(sensors.count - 1, 3, -1):
        place = places[index]
        _, x, y, z, weight = rows[place]
        g1, g2, g3 = (p11 * x + p12 * y + p13 * z, p12 * x + p22 * y + p23 * z,
                      p13 * x + p23 * y + p33 * z)
        # The variance of the sensor's residual in the fit, which it has drawn, over its own.
        share = 1.0 - weight * (x * g1 + y * g2 + z * g3)
        size = m.reciprocal_root(share, NO_SHARE) / sensors.sigma[place]
        line: list[N] = [0.0] * len(rows)
        for before in places[:index]:
            _, x, y, z, weight = rows[before]
            line[before] = -size * weight * (x * g1 + y * g2 + z * g3)
        line[place] = size * share
        lines.append(line)
        size = size * size
        h1, h2, h3 = size * g1, size * g2, size * g3
        p11, p12, p13 = p11 + h1 * g1, p12 + h1 * g2, p13 + h1 * g3
        p22, p23, p33 = p22 + h2 * g2, p23 + h2 * g3, p33 + h3 * g3
    # The one combination of the first four residuals that no motion of the platform changes.
    p, q, r, s = (rows[place][1:4] for place in places[:4])
    parts = -_volume(q, r, s), _volume(p, r, s), -_volume(p, q, s), _volume(p, q, r)
    variance: N = 0.0
    for part, place in zip(parts, places[:4], strict=True):
        variance = variance + part * part / sensors.weights[place]
    scale = m.reciprocal_root(variance, 0.0)
    line = [0.0] * len(rows)
    for part, place in zip(parts, places[:4], strict=True):
        line[place] = scale * part
    lines.append(line)
    vector: list[N] = []
    for line in reversed(lines):
        parity: N = 0.0
        for part, row in zip(line, rows, strict=True):
            parity = parity + part * row[0]
        vector.append(parity)
    return tuple(vector), tuple(map(tuple, reversed(lines)))


def _volume(p: Vector[N], q: Vector[N], r: Vector[N]) -> N:
    """Return the determinant of three rows."""
    p1, p2, p3 = p
    q1, q2, q3 = q
    r1, r2, r3 = r
    return p1 * (q2 * r3 - q3 * r2) + p2 * (q3 * r1 - q1 * r3) + p3 * (q1 * r2 - q2 * r1)
