# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The name of each sensor on the page: th1B, as in the paper, for the joint joint_1b."""

from __future__ import annotations

import re

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, SHORT_NAMES

# Names of the sensors in the order of a sample.
SENSOR_NAMES = tuple(f'th{short}' for short in SHORT_NAMES)
# Name of a joint in a text.
JOINT = re.compile(r'\bjoint_([123])([abc])\b')


def with_sensor_names(text: str) -> str:
    """
    Return a text with th1B for joint_1b.

    Parameters
    ----------
    text : str
        Words with names of joints, such as a state's.

    Returns
    -------
    str
        The same words with the names of the sensors.

    """
    return JOINT.sub(lambda match: f'th{match[1]}{match[2].upper()}', text)


def joint_of(sensor: str) -> str:
    """
    Return the joint of a sensor: joint_1b of th1B.

    Raises
    ------
    ValueError
        The name is not one of SENSOR_NAMES.

    """
    return ALL_JOINT_NAMES[SENSOR_NAMES.index(sensor)]
