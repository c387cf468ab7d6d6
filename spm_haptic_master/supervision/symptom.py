# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a monitor reports of a joint sample that may not go out."""

from __future__ import annotations

from typing import NamedTuple

from spm_haptic_master.joints import ALL_JOINT_NAMES


class Symptom(NamedTuple):
    """
    One thing wrong with a joint sample.

    Attributes
    ----------
    reason : str
        Fixed words, so that symptoms can be counted.
    detail : str
        Values and limit.
    sensor : int or None
        Index of the faulty sensor in ALL_JOINT_NAMES; None where the evidence does not isolate it.
    fault : bool
        Whether this one sample makes it a fault; else it takes several in a row.
    passive : bool
        Whether it only withholds the sample, and is no evidence of a fault yet.

    """

    reason: str
    detail: str
    sensor: int | None = None
    fault: bool = False
    passive: bool = False

    @property
    def words(self) -> str:
        """Return the reason with the name of the sensor, in the words of `state`."""
        if self.sensor is None:
            return self.reason
        return f'{ALL_JOINT_NAMES[self.sensor]} {self.reason}'
