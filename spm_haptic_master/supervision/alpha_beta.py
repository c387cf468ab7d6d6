# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The alpha-beta filter that follows a joint, for a sensor of unit variance and a period of 1.

The variances are those of the steady state (Kalata 1984).
"""

from __future__ import annotations

from math import sqrt

# Gains (unit 1) with the least transient for alpha (Benedict and Bordner 1962), between those of
# fast samples, where noise counts more, and of slow ones, where what a joint may do does: 500
# rad/s^2 lag the filter by 0.08 deg at 1 kHz, by 1.2 deg at 250 Hz.
ALPHA = 0.7
BETA = ALPHA * ALPHA / (2.0 - ALPHA)
# Standard deviation of the difference between two innovations in a row, which motion hardly
# changes.
DIFFERENCE = 2.4623

_TOTAL = ALPHA * (4.0 - 2.0 * ALPHA - BETA)
# Variance of the filtered position, of the velocity, and their covariance.
_POSITION = (2.0 * ALPHA * ALPHA + BETA * (2.0 - 3.0 * ALPHA)) / _TOTAL
_VELOCITY = 2.0 * BETA * BETA / _TOTAL
_COVARIANCE = BETA * (2.0 * ALPHA - BETA) / _TOTAL


def deviation(periods: float) -> float:
    """Return the standard deviation of an innovation some periods after the last reading."""
    return sqrt(1.0 + _POSITION + periods * (periods * _VELOCITY + 2.0 * _COVARIANCE))


def lag(periods: float) -> float:
    """Return what an acceleration of 1 per period^2 moves the joint off its prediction."""
    return (1.0 - ALPHA) / BETA + periods * (ALPHA / BETA - 0.5 + 0.5 * periods)
