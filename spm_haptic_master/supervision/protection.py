# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Protection level of an orientation: how wrong one faulty sensor can make it without an alarm.

The theory is that of receiver autonomous integrity monitoring (Brown and Chin 1997: slope; Blanch
et al. 2012: nominal bias). With H the whitened Jacobian of the N readings, K = pinv(H) and
P = I - H K, a fault of sensor i moves the parity by |P_i| and the orientation by |K_i| a unit: its
slope is |K_i| / |P_i|. A fault is detected with the missed-detection rate of `MISSED_DETECTION`
where it moves the mean parity beyond threshold and noise; a smaller one turns the orientation by
the slope times that, at most.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

from spm_haptic_master.kinematics.normal_equations import consistency
from spm_haptic_master.kinematics.sample_estimation import SampleEstimate

# Standard deviations that a fault at the protection level exceeds the threshold by (unit 1): it
# stays undetected, or noise alone turns an orientation further, with a probability of 1e-7.
MISSED_DETECTION = 5.3

# Largest share of a sensor's variance in the residuals of five or six sensors, or all but one of
# them, that counts as zero (unit 1): the difference of two numbers of size 1 and of rounding.
NO_SHARE = 1e-12


class Integrity(NamedTuple):
    """
    What an orientation is worth if one of its sensors is faulty.

    Attributes
    ----------
    healthy : float
        What noise and nominal bias do to the orientation of healthy sensors, rad.
    bias : float
        What the nominal biases do to the parity at most, in standard deviations.
    deviation : float
        Total standard deviation of the orientation with the configured noise, rad.
    slopes : tuple of N float
        Rotation error of each sensor's fault over the parity that it makes, rad; infinite for a
        sensor that the others cannot check here, 0 for one that is missing.

    """

    healthy: float
    bias: float
    deviation: float
    slopes: tuple[float, ...]

    def levels(self, threshold: float) -> list[float]:
        """
        Return each sensor's part of the protection level, rad.

        Parameters
        ----------
        threshold : float
            Mean parity, without nominal bias, beyond which a fault is detected in all but 1e-7 of
            the cases: threshold and missed-detection deviations of the window's mean.

        """
        reach, healthy = threshold + self.bias, self.healthy
        if len(self.slopes) > 4:
            return [slope * reach + healthy for slope in self.slopes]
        a, b, c, third = self.slopes
        return [a * reach + healthy, b * reach + healthy, c * reach + healthy,
                third * reach + healthy]


def integrity(estimate: SampleEstimate, bias: tuple[float, ...], noise: float) -> Integrity:
    """
    Return the integrity of an estimate.

    Parameters
    ----------
    estimate : SampleEstimate
        From all four sensors, or from five or six with one of them missing at most.
    bias : tuple of N float
        Nominal bias of each sensor, rad: bound of what is systematic on a healthy rig.
    noise : float
        Measured noise over the configured one, at least 1.

    """
    if len(estimate.weights) > 4:
        return _integrity_of_more(estimate, bias, noise)
    (_, b1, b2, b3), (_, c1, c2, c3) = estimate.slopes
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = estimate.motions
    weight_a, weight_b, weight_c, weight_3 = estimate.weights
    na, nb, nc, n3 = consistency(estimate.slopes)
    deviation = sqrt(na * na / weight_a + nb * nb / weight_b + nc * nc / weight_c
                     + n3 * n3 / weight_3)
    x, y, z = b1 * ax + b2 * bx + b3 * cx, b1 * ay + b2 * by + b3 * cy, b1 * az + b2 * bz + b3 * cz
    gain_a = weight_a * sqrt(ax * ax + ay * ay + az * az)
    gain_b = weight_b * sqrt(x * x + y * y + z * z)
    x, y, z = c1 * ax + c2 * bx + c3 * cx, c1 * ay + c2 * by + c3 * cy, c1 * az + c2 * bz + c3 * cz
    gain_c = weight_c * sqrt(x * x + y * y + z * z)
    gain_3 = weight_3 * sqrt(cx * cx + cy * cy + cz * cz)
    na, nb, nc, n3 = abs(na), abs(nb), abs(nc), abs(n3)
    bias_a, bias_b, bias_c, bias_3 = bias
    covariance = estimate.covariance
    total = sqrt(covariance[0] + covariance[4] + covariance[8])
    return Integrity(
        MISSED_DETECTION * noise * total
        + gain_a * bias_a + gain_b * bias_b + gain_c * bias_c + gain_3 * bias_3,
        (na * bias_a + nb * bias_b + nc * bias_c + n3 * bias_3) / deviation, total,
        (gain_a * deviation / na if na else inf, gain_b * deviation / nb if nb else inf,
         gain_c * deviation / nc if nc else inf, gain_3 * deviation / n3 if n3 else inf))


def _integrity_of_more(estimate: SampleEstimate, bias: tuple[float, ...],
                       noise: float) -> Integrity:
    """Return the integrity of five or six sensors, the parity being the norm of its vector."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = estimate.motions
    e11, e12, e13, e22, e23, e33 = estimate.entries
    slopes = []
    turn = along = square = 0.0
    for (x, y, z), weight, each in zip(estimate.rows, estimate.weights, bias, strict=True):
        if not weight:
            slopes.append(0.0)
            continue
        gx, gy, gz = x * ax + y * bx + z * cx, x * ay + y * by + z * cy, x * az + y * bz + z * cz
        gain = weight * sqrt(gx * gx + gy * gy + gz * gz)
        # P_ii, the square of what a fault of one standard deviation moves the parity by.
        share = 1.0 - weight / estimate.determinant * (
            x * (e11 * x + e12 * y + e13 * z) + y * (e12 * x + e22 * y + e23 * z)
            + z * (e13 * x + e23 * y + e33 * z))
        root = sqrt(weight)
        size = sqrt(share) if share > NO_SHARE else 0.0
        slopes.append(gain / (root * size) if size else inf)
        turn += gain * each
        along += size * root * each
        square += weight * each * each
    covariance = estimate.covariance
    total = sqrt(covariance[0] + covariance[4] + covariance[8])
    # No projection is longer than what it is of, nor than the sum of its parts.
    return Integrity(MISSED_DETECTION * noise * total + turn, min(sqrt(square), along), total,
                     tuple(slopes))
