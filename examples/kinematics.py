# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Angles of a pose, and the orientation from the angles: python examples/kinematics.py."""

from math import radians

import numpy as np
from spm_haptic_master.kinematics import dexterity, estimate, inverse, matrix_from_zxz

R = matrix_from_zxz(radians(135), radians(54.7), radians(50))  # beside the parallel singularity
joints = inverse(R)  # th1A, th1B, th1C, th2A, th3A
fit = estimate(joints.theta1, joints.theta3a, sigma=radians(0.04))
print('off by', np.abs(fit.rotation - R).max(), 'parity', fit.parity)
print('standard deviation', np.degrees(np.sqrt(np.diag(fit.covariance))), 'deg')
print('dexterity of three sensors', dexterity(R), 'and of four', dexterity(R, sensors=4))
