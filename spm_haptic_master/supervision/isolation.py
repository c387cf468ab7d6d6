# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which of five or six sensors is faulty: the direction of the parity vector.

A fault of sensor i moves the parity vector along the direction u_i of that sensor, column i of
P = I - H K. What of a parity vector is perpendicular to u_i is what no fault of sensor i explains.
Four sensors have one direction, so that any of them explains everything.
"""

from __future__ import annotations

from math import inf, sqrt

from spm_haptic_master.kinematics.sample_estimation import SampleEstimate

# Largest square of a direction that counts as zero (unit 1), as `protection.NO_SHARE`.
NO_SHARE = 1e-12


def unexplained(vector: tuple[float, ...],
                directions: tuple[tuple[float, ...], ...]) -> list[float]:
    """
    Return what a fault of each sensor leaves of a parity vector.

    Parameters
    ----------
    vector : tuple of float
        A parity vector, or the mean of several, in standard deviations.
    directions : tuple of N tuples of float
        Of `SampleEstimate.directions`.

    Returns
    -------
    list of N float
        Length of the part that is perpendicular to each direction, in standard deviations: noise
        alone for the sensor that is faulty. For a sensor that is missing, or that moves the
        parity not at all, the length of the vector.

    """
    square = sum(part * part for part in vector)
    left = []
    for direction in directions:
        size = sum(part * part for part in direction)
        along = sum(part * other for part, other in zip(vector, direction, strict=True))
        left.append(sqrt(max(square - along * along / size, 0.0)) if size > NO_SHARE
                    else sqrt(square))
    return left


def isolable_steps(estimate: SampleEstimate, threshold: float) -> list[float]:
    """
    Return the least step of each sensor that no other sensor's fault explains.

    Parameters
    ----------
    estimate : SampleEstimate
        Estimate with the weights and directions of the sensors.
    threshold : float
        What of the mean parity vector has to be unexplained by each other sensor, in standard
        deviations.

    Returns
    -------
    list of N float
        Steps, rad; infinite where another sensor explains a fault of any size, and for a sensor
        that is missing.

    """
    directions = estimate.directions
    if not directions:
        return [inf] * len(estimate.weights)
    steps = []
    for sensor, (direction, weight) in enumerate(zip(directions, estimate.weights, strict=True)):
        others = [each for other, each in enumerate(directions)
                  if other != sensor and estimate.weights[other]]
        least = min(unexplained(direction, tuple(others)))
        # Two directions of one line differ by the root of the rounding of their squares.
        apart = weight > 0.0 and least * least > NO_SHARE
        steps.append(threshold / (sqrt(weight) * least) if apart else inf)
    return steps
