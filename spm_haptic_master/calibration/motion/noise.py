# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The white noise that the parity allows.

Differences of consecutive readings hold the noise, and what the joint moved by between a reading
and its stamp: sets that come at irregular times look noisy in motion. The parity does not, as no
motion changes it. With the gain g of the parity (whitened, unit 1/rad) and the variance s_i of
sensor i, the mean of its square is the mean of sum_i g_i^2 s_i. Differences that predict more
are cut to a common noise with which the prediction is what was measured.
"""

from __future__ import annotations

import numpy as np
from spm_haptic_master.calibration.motion.fit import Normal
from spm_haptic_master.calibration.motion.model import Array, MotionModel

# Predicted over measured mean square of the parity up to which both agree (unit 1): 12,000 means
# give it to 1.3 %.
AGREEMENT = 1.05
# Samples of which the gains are computed.
SAMPLES = 3000
# Bisections of the common noise: 1e-6 of the largest.
BISECTIONS = 20


def allowed_noise(
    model: MotionModel,
    turned: Array,
    vector: Array,
    normal: Normal,
) -> Array:
    """
    Return the noise of each sensor, at most that of the model, that the parity of a fit allows.

    The common noise to which it is cut is found by bisection.

    Parameters
    ----------
    model : MotionModel
        The mechanism, with the noise by the differences of readings, rad.
    turned : ndarray, shape (n, N)
        Readings times their directions, with the zeros still in them, rad.
    vector : ndarray, shape (P,)
        Parameters of the fit, rad.
    normal : Normal
        Normal equations of the fit, with the parity of each sample.

    Returns
    -------
    ndarray, shape (N,)
        Noise of each sensor, rad, 1 standard deviation.

    """
    kept = np.flatnonzero(normal.kept)
    rows = kept[:: max(1, len(kept) // SAMPLES)]
    zeros = tuple(range(model.layout.sensors))
    linear = model.linearised(
        turned[rows],
        normal.rotation[rows],
        vector,
        zeros,
    )
    gains = linear.derivative
    # Mean square of the parity for each unit of variance, (N,).
    sums = np.sum(gains**2, axis=1)
    squares = np.mean(sums, axis=0)
    parities = np.sum(normal.parity[kept] ** 2, axis=1)
    measured = float(np.mean(parities))
    if float(squares @ model.sigma**2) <= AGREEMENT * measured:
        return model.sigma
    low = 0.0
    high = float(model.sigma.max())
    for _ in range(BISECTIONS):
        common = 0.5 * (low + high)
        if float(squares @ np.minimum(model.sigma, common) ** 2) > measured:
            high = common
        else:
            low = common
    return np.minimum(model.sigma, low)
