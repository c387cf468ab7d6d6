# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Protection level of an orientation: how wrong one faulty sensor can make it without an alarm.

The theory is that of receiver autonomous integrity monitoring (Brown and Chin 1997: slope; Blanch
et al. 2012: nominal bias). A fault of sensor i turns the orientation by |K_i| and moves the parity
by |p_i|, each per rad: its slope is |K_i| / |p_i|. A fault is detected with the missed-detection
rate of `MISSED_DETECTION` where it moves the mean parity beyond threshold, noise and nominal bias.
The bias counts twice: it widens the threshold, and the biases of the other sensors may oppose the
fault. A smaller fault turns the orientation by the slope times that, at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf, pi, sqrt

from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.supervision.anchor import FOLD, TURN_DEVIATIONS

# Standard deviations by which a fault at the protection level exceeds the threshold (unit 1): it
# stays undetected, or noise alone turns an orientation further, with a probability of 1e-7.
MISSED_DETECTION = 5.3


@dataclass(slots=True)
class Integrity:
    """
    What an orientation is worth if one of its sensors is faulty.

    Attributes
    ----------
    healthy : float
        What noise and nominal bias do to the orientation of healthy sensors, rad.
    deviation : float
        Total standard deviation of the orientation with the measured noise, rad.
    noise : float
        Bound of the parity's standard deviation as measured (unit 1); exact for one entry.
    bias : float
        What the nominal biases do to the parity at most, in standard deviations.
    fold_share : float
        Noise and bias of the readings, over the reading error that takes the orientation to where
        two solutions meet (unit 1): see `FOLD`.
    slopes : sequence of float, length N
        Rotation error of each sensor's fault over the parity that it makes, rad; infinite for a
        sensor that the others cannot check here, and for one that is left out.

    """

    healthy: float
    deviation: float
    noise: float
    bias: float
    fold_share: float
    slopes: Sequence[float]

    def parts(self, undetected: float, window_bias: float = 0.0) -> list[float]:
        """
        Return each sensor's part of the protection level, rad.

        Parameters
        ----------
        undetected : float
            Mean parity up to which a fault may stay undetected, with the configured noise and
            without nominal bias, in standard deviations.
        window_bias : float
            Mean of `bias` over the samples of that mean parity, in standard deviations: where the
            device slows down, its readings were later before, and hid a larger fault.

        Returns
        -------
        list of float
            slope_i (undetected noise + 2 bias) + healthy of each of the N sensors, with the larger
            of the two biases; infinite if unchecked.

        """
        parity = undetected * self.noise + 2.0 * max(self.bias, window_bias)
        return [slope * parity + self.healthy for slope in self.slopes]


def protection_level(parts: list[float], alert_limit: float, healthy: float) -> float:
    """
    Return the protection level of an orientation, rad.

    Parameters
    ----------
    parts : list of float, length N
        Each sensor's part of the level, rad.
    alert_limit : float
        Largest part of a sensor that counts as checked, rad; a larger one is not in the level.
    healthy : float
        What noise and nominal bias do to the orientation of healthy sensors, rad.

    Returns
    -------
    float
        The largest part of a checked sensor; `healthy` at least.

    """
    level = healthy
    for part in parts:
        if level < part <= alert_limit:
            level = part
    return level


def integrity(
    estimate: SampleEstimate,
    bias: tuple[float, ...],
    factors: tuple[float, ...],
    parity_bias: float = pi,
) -> Integrity:
    """
    Return the integrity of an estimate from three to six sensors in use of N mounted ones.

    Parameters
    ----------
    estimate : SampleEstimate
        Orientation with its gains K_i and parity gains p_i.
    bias : tuple of float, length N
        Nominal bias of each sensor, rad.
    factors : tuple of float, length N
        Measured noise of each sensor over the configured one, at least 1.
    parity_bias : float
        Bound of the length of that part of the nominal biases that no motion explains, rad. A unit
        vector n over the sensors moves the parity by at most that, and the whitened parity by that
        times the length of its derivative by the readings.

    Returns
    -------
    Integrity
        healthy = k_md deviation + sum |K_i| b_i, slope_i = |K_i| / |p_i|, and fold_share =
        4 FOLD sum |K_i|^2 (`TURN_DEVIATIONS` sigma_i + b_i).

    """
    gains = estimate.gain_sizes
    parity_gains = estimate.parity_sizes
    weights = estimate.sensors.weights
    sigma = estimate.sensors.sigma
    slopes = []
    # Noise and bias of each reading, rad, over what takes the orientation to where two solutions
    # meet.
    fold_share = 0.0
    # What the biases do at most to the orientation, rad, and to the parity, in standard
    # deviations; and the square of their whitened length.
    turned = 0.0
    moved = 0.0
    whitened = 0.0
    for sensor, offset in enumerate(bias):
        gain = gains[sensor]
        parity_gain = parity_gains[sensor]
        reading_error = TURN_DEVIATIONS * factors[sensor] * sigma[sensor] + offset
        fold_share += gain * gain * reading_error
        turned += gain * offset
        moved += parity_gain * offset
        whitened += weights[sensor] * offset * offset
        slopes.append(gain / parity_gain if parity_gain else inf)
    fold_share *= 4.0 * FOLD
    # No projection is longer than what it is of, nor than the sum of its parts.
    moved = min(moved, sqrt(whitened), parity_bias * hypot(*parity_gains))
    deviation, noise = _deviations(estimate, factors)
    # To the second order: the nearer it takes the orientation to where two solutions meet, the
    # further the bias turns it, up to twice as far there.
    turned *= 2.0 / (1.0 + sqrt(max(1.0 - fold_share, 0.0)))
    return Integrity(
        healthy=MISSED_DETECTION * deviation + turned,
        deviation=deviation,
        noise=noise,
        bias=moved,
        fold_share=fold_share,
        slopes=slopes,
    )


def _deviations(estimate: SampleEstimate, factors: tuple[float, ...]) -> tuple[float, float]:
    """Return what the measured noise does to orientation, rad, and parity: their deviations."""
    covariance = estimate.covariance
    variance = covariance[0] + covariance[4] + covariance[8]
    parity_variance = 1.0
    if max(factors) > 1.0:
        sigma = estimate.sensors.sigma
        sensors = zip(
            estimate.gain_sizes,
            estimate.parity_sizes,
            factors,
            sigma,
            strict=True,
        )
        for gain, parity_gain, factor, configured in sensors:
            excess = (factor * factor - 1.0) * configured * configured
            variance += excess * gain * gain
            parity_variance += excess * parity_gain * parity_gain
    return sqrt(variance), sqrt(parity_variance)
