# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What to do about a reason of silence, for people: no program reads these words."""

from __future__ import annotations

from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision.symptom import Reason, Symptom

# Where the other sensors can check a motor sensor, and one of a passive joint.
HOW_TO_CHECK = ('tilt the handle towards the centre of the workspace',
                'turn the handle about its axis, away from the singularity')
# Remedies by the reason of a silence.
REMEDIES = {
    Symptom(Reason.NOT_CHECKED, sensor=sensor).words: HOW_TO_CHECK[name.startswith('joint_3')]
    for sensor, name in enumerate(ALL_JOINT_NAMES)} | {
    Reason.NO_FIT.value: "the calibration may be another rig's, or no longer hold: "
    'calibrate --motion --check calibration.yaml',
}


def with_remedy(why: str, message: str) -> str:
    """Return a message about a reason of silence with what to do about it, if that is known."""
    remedy = REMEDIES.get(why)
    return f'{message}: {remedy}' if remedy else message
