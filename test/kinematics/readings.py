# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings of a pose and the bound of their estimate, from the inverse model."""

import math

import numpy as np
from spm_haptic_master.kinematics import Geometry, inverse, jacobian

PAPER = Geometry()
# Standard deviation of the rig's sensors (rad).
SIGMA = math.radians(0.04)


def four_angles(R, g=PAPER, mode=(1, 1, 1)):
    """Return the true readings th1A, th1B, th1C, th3A."""
    joints = inverse(R, g, mode)
    return np.concatenate([joints.theta1, joints.theta3a[..., None]], axis=-1)


def bound(R, sigma, g=PAPER, mode=(1, 1, 1)):
    """Cramer-Rao bound: covariance of the rotation vector, from the Jacobian."""
    G = jacobian(R, g, mode, sensors=4) / np.broadcast_to(sigma, 4)[:, None]
    return np.linalg.inv(G.T @ G)
