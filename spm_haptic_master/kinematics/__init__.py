# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mechanism's mathematics: models, Jacobians, workspace, estimate of the orientation.

Imports numpy, the standard library and the top-level module `exceptions`; no clock, no I/O, no
ROS.

Angles in rad. `R` is R_base_platform, shape (..., 3, 3): platform components in, base components
out. `th1` is (..., 3), legs A, B, C. Quaternions are x, y, z, w.
"""

from spm_haptic_master.kinematics.assembly_modes import continue_mode, forward_all, track_mode
from spm_haptic_master.kinematics.closed_form import (
    forward_theta2a,
    forward_theta3a,
    theta3a_quaternion,
)
from spm_haptic_master.kinematics.estimation.estimates import Estimate, estimate
from spm_haptic_master.kinematics.estimation.sample_estimates import estimate_sample
from spm_haptic_master.kinematics.geometry import Geometry, in_usual_frames
from spm_haptic_master.kinematics.inverse_model import (
    dexterity,
    inverse,
    jacobian,
    JointAngles,
    measured_angles,
    mechanism_angles,
    parallel_determinant,
)
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.rotations import (
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
    zxz_angles,
    zxz_from_matrix,
    zxz_quaternion,
    zxz_rotation,
)
from spm_haptic_master.kinematics.workspace import singularity_locus, workspace_pose

__all__ = [
    'Estimate',
    'Geometry',
    'JointAngles',
    'UsedSensors',
    'continue_mode',
    'dexterity',
    'estimate',
    'estimate_sample',
    'forward_all',
    'forward_theta2a',
    'forward_theta3a',
    'in_usual_frames',
    'inverse',
    'jacobian',
    'matrix_from_quaternion',
    'matrix_from_zxz',
    'measured_angles',
    'mechanism_angles',
    'parallel_determinant',
    'quaternion_from_matrix',
    'singularity_locus',
    'theta3a_quaternion',
    'track_mode',
    'workspace_pose',
    'zxz_angles',
    'zxz_from_matrix',
    'zxz_quaternion',
    'zxz_rotation',
]
