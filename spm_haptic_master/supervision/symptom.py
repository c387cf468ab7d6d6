# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A symptom: what a monitor detects in one sample, and the words in which it is reported."""

from __future__ import annotations

from typing import NamedTuple

from spm_haptic_master.joints import JOINT_NAMES

# Beginning of the reasons that concern all four sensors together and need no sensor's name.
ALL_SENSORS = 'no orientation'


class Symptom(NamedTuple):
    """
    Evidence that a sample is wrong.

    Attributes
    ----------
    reason : str
        Fixed words without values, so that diagnostics can count them.
    detail : str
        Measured value and limit, with their unit.
    sensor : int or None
        Index in `JOINT_NAMES` of the faulty sensor; None while it is undetermined.
    fault : bool
        Latched by this one sample; otherwise a fault takes several bad samples in a row.
    self_timed : bool
        Timed by the monitor itself: it is neither pending nor counted as a bad sample.
    complete : bool
        The reason names the faulty sensors itself.

    """

    reason: str
    detail: str
    sensor: int | None = None
    fault: bool = False
    self_timed: bool = False
    complete: bool = False

    @property
    def text(self) -> str:
        """Reason with the name of the sensor, or with the fact that it is undetermined."""
        if self.sensor is not None:
            return f'{JOINT_NAMES[self.sensor]} {self.reason}'
        if self.complete or self.reason.startswith(ALL_SENSORS):
            return self.reason
        return f'{self.reason}, sensor undetermined'
