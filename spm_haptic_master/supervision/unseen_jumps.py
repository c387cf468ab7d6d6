# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Jumps of single sensors that the parity cannot show: they are found by the joint's own motion.

The parity cannot show a jump of a sensor that it could not check when all joints were last on
their motion, nor of one with a rival that was born since: the jump itself may have led to it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from spm_haptic_master.supervision.exposure import Exposure
from spm_haptic_master.supervision.joint_monitors import JointMonitors
from spm_haptic_master.supervision.rivals import Rivals
from spm_haptic_master.supervision.symptom import Symptom


class UnseenJumps:
    """
    What the parity could not see when all joints were last on their motion.

    Parameters
    ----------
    joints : JointMonitors
        Has the joints that left their motion.
    exposure : Exposure
        Has the sensors that the others cannot check.
    rivals : Rivals
        Has the sensors whose steps may lead onto another orientation.

    """

    def __init__(self, joints: JointMonitors, exposure: Exposure, rivals: Rivals) -> None:
        self._joints = joints
        self._exposure = exposure
        self._rivals = rivals
        # Stamp (ns) of the latest sample with all joints on their motion.
        self._undisturbed = 0
        self.restart()

    def restart(self) -> None:
        """Count every step of every sensor as unseen: the exposure has restarted."""
        # Sensors that the others could not check at that sample; by sensor, the least step (rad)
        # that the parity did not show then.
        self._hidden = self._exposure.hidden
        self._unseen_steps: Mapping[int, float] = {}

    def note_undisturbed(self, stamp: int) -> None:
        """Note that all joints are on their motion, at a stamp, ns."""
        self._undisturbed = stamp
        self._hidden = self._exposure.hidden
        self._unseen_steps = self._rivals.unseen_steps

    def found(self, used: tuple[int, ...], is_gap: bool, any_step: bool) -> list[Symptom]:
        """
        Return the sensors that jumped alone, where the parity cannot show it.

        Parameters
        ----------
        used : tuple of int
            Places of the sensors in use.
        is_gap : bool
            Whether samples are missing before this one, in which the sensor may have jumped.
        any_step : bool
            Whether a step counts that is too small to lead to a rival: that of a healthy joint
            that is shaken is so small, too. After a gap the step may have been larger.

        """
        born = self._rivals.born_since(self._undisturbed)
        unseen = {
            sensor
            for sensor in (*self._hidden, *born)
            if any_step or self._joints.distance(sensor) >= self._least_step(sensor, born)
        }
        return self._joints.jumps(used, unseen, is_gap)

    def _least_step(self, sensor: int, born: Collection[int]) -> float:
        """Return the least step of a sensor that the parity may not show, rad."""
        least = self._unseen_steps.get(sensor, 0.0)
        if sensor in born:
            least = min(least, self._rivals.unseen_steps.get(sensor, 0.0))
        return least
