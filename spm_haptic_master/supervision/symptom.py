# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is wrong with a joint sample: the reason, the sensor, how much evidence; what to do."""

from __future__ import annotations

from collections.abc import Collection
from enum import Enum, IntEnum
from typing import NamedTuple

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES


class Reason(Enum):
    """Why a sample is withheld: every word of `state` that the supervision makes."""

    STARTING = 'starting'
    OLD = 'sample not newer than the last'
    NOT_FINITE = 'angle not finite'
    MISSING = 'missing'
    OUT_OF_RANGE = 'out of range'
    FROZEN = 'frozen'
    JUMPED = 'jumped'
    NOISY = 'noisy'
    INCONSISTENT = 'inconsistent angles'
    DRIFTED = 'angles drifted apart'
    DISCONTINUOUS = 'orientation does not continue the motion'
    NO_FIT = 'no orientation fits'
    UNDETERMINED = 'orientation not determined'
    UNPROTECTED = 'protection level above the alert limit'
    NOT_CHECKED = 'not checked yet'
    UNCHECKED = 'unchecked for too long'


class Severity(IntEnum):
    """What a symptom leads to."""

    WITHHOLD = 0  # the sample is withheld; no sensor is suspected
    PENDING = 1  # a fault if it lasts
    LATCH = 2  # a fault at once


class Symptom(NamedTuple):
    """
    One thing wrong with a joint sample.

    Attributes
    ----------
    reason : Reason
        What it is.
    detail : str
        Values and limit, for people.
    sensor : int or None
        Index of the faulty one in ALL_JOINT_NAMES, if it is isolated.
    severity : Severity
        What it leads to.

    """

    reason: Reason
    detail: str = ''
    sensor: int | None = None
    severity: Severity = Severity.PENDING

    @property
    def words(self) -> str:
        """Return the reason with the name of the sensor, in the words of `state`."""
        if self.sensor is None:
            return self.reason.value
        return f'{ALL_JOINT_NAMES[self.sensor]} {self.reason.value}'


def withheld(
    reason: Reason,
    detail: str,
    sensor: int | None = None,
) -> Symptom:
    """Return a symptom that withholds a sample and suspects no sensor."""
    return Symptom(reason, detail, sensor, Severity.WITHHOLD)


def worst(symptoms: list[Symptom]) -> Symptom:
    """Return the most severe symptom, of equal ones rather one of a known sensor: the cause."""
    return max(symptoms, key=lambda symptom: (symptom.severity, symptom.sensor is not None))


def how_to_check(sensors: Collection[int]) -> str:
    """
    Return how to move the handle so that the others check sensors.

    A motor sensor and one of a passive joint are checked by the others in different places.
    """
    passive = [sensor for sensor in sensors if ALL_JOINT_NAMES[sensor].startswith('joint_3')]
    moves = []
    if len(passive) < len(sensors):
        moves.append('tilt the handle towards the centre of the workspace')
    if passive:
        moves.append('turn the handle about its axis, away from the singularity')
    return ' and '.join(moves)


# What to do about a reason of silence, by its words, for people: no program reads this.
REMEDIES = {
    Reason.NO_FIT.value: "the calibration may be another rig's, or no longer hold: "
    'calibrate --motion --check calibration.yaml'
} | {
    Symptom(Reason.NOT_CHECKED, sensor=sensor).words: how_to_check([sensor])
    for sensor in range(len(ALL_JOINT_NAMES))
}


def with_remedy(why: str, message: str) -> str:
    """Return a message about a reason of silence with what to do about it, if that is known."""
    return f'{message}: {REMEDIES[why]}' if why in REMEDIES else message
