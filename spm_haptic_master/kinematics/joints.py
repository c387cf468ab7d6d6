# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Names and order of the measured joints, in every module and on every topic."""

import re

# Names of the joints of th1A, th1B, th1C on the motor axes of the legs A, B, C, and of th3A on
# leg A's passive joint, in the order of a sample.
JOINT_NAMES = ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a')

# The same with the fifth sensor, on leg B's joint of th3B, and the sixth, on leg C's of th3C.
ALL_JOINT_NAMES = (*JOINT_NAMES, 'joint_3b', 'joint_3c')

# The joints with sensors in short, as the paper has them after th.
SHORT_NAMES = ('1A', '1B', '1C', '3A', '3B', '3C')

# Names of all nine joints of the mechanism: th1k, th2k, th3k of leg A, then of B and of C.
MECHANISM_JOINT_NAMES = tuple(f'joint_{number}{leg}' for leg in 'abc' for number in (1, 2, 3))

# Numbers of sensors, in words.
NUMBER_WORDS = {4: 'four', 5: 'five', 6: 'six'}


def named_joints(text: str) -> tuple[str, ...]:
    """Return the joints with sensors that a text names, in their order."""
    words = re.findall(r'\w+', text)
    return tuple(name for name in ALL_JOINT_NAMES if name in words)
