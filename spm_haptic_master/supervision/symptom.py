# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is wrong with a joint sample: the reason, the sensor, and how much evidence it is."""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import NamedTuple

from spm_haptic_master.joints import ALL_JOINT_NAMES


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
        What is wrong.
    detail : str
        Values and limit.
    sensor : int or None
        Place of the faulty sensor in ALL_JOINT_NAMES; None where the evidence does not isolate it.
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


def withheld(reason: Reason, detail: str, sensor: int | None = None) -> Symptom:
    """Return a symptom that withholds a sample and suspects no sensor."""
    return Symptom(reason, detail, sensor, Severity.WITHHOLD)
