# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Directions of the encoders: verified by a calibration, or accepted unverified.

A wrong direction of joint_3a cannot be detected from the angles: on the centre line the mirrored
angle fits another assembly mode exactly.
"""

from __future__ import annotations

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.encoders import ACCEPT_SETTING, VERIFIED_SETTING
from spm_haptic_master.parameters.setting import Values


def unverified_joints(values: Values) -> tuple[str, ...]:
    """
    Return the joints with an unverified direction; none for a source that decodes no counts.

    Raise SettingError if there is one, and the checked settings do not accept that.
    """
    verified = values.get(VERIFIED_SETTING.name)
    if verified is None:
        return ()
    joints = tuple(joint for joint, known in zip(ALL_JOINT_NAMES, verified, strict=False)
                   if not known)
    if joints and not values[ACCEPT_SETTING.name]:
        raise SettingError(
            VERIFIED_SETTING.name, list(verified),
            f'true for each: the direction of {", ".join(joints)} is not verified; calibrate at '
            'two poses (calibrate --pose ... --pose ...) and give the file that it writes, or set '
            f'{ACCEPT_SETTING.name} to true to run at WARN')
    return joints
