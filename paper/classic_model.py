# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's classic forward model (eqs. 1 to 7), its mode chosen by the true orientation."""

from __future__ import annotations

import numpy as np
from spm_haptic_master.kinematics import forward_all


def nearest_modes(th1: np.ndarray, R: np.ndarray) -> np.ndarray:
    """
    Return the assembly mode nearest to the true orientation, for each sample.

    Parameters
    ----------
    th1 : ndarray, shape (n, 3)
        Active joints A, B, C, rad.
    R : ndarray, shape (n, 3, 3)
        True orientations, R_base_platform.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        R_base_platform; NaN where the active joints close no mechanism.

    """
    nearest = np.full(R.shape, np.nan)
    for row, (angles, truth) in enumerate(zip(th1, R, strict=True)):
        modes = forward_all(angles)
        if len(modes):
            nearest[row] = modes[np.argmin(((modes - truth) ** 2).sum(axis=(1, 2)))]
    return nearest
