# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The entry of the force feedback on /diagnostics."""

from __future__ import annotations

from math import hypot

from rclpy.node import Node
from spm_haptic_master.drives.drives import DriveReport
from spm_haptic_master.force import ForceCondition, ForceController, ForceOutput
from spm_haptic_master.force.samples import ForceReason
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.nodes.force_inputs import ForceInputs
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, StatusPublisher, WARN

# Levels of the states; the others are OK.
LEVELS = {
    ForceCondition.FADING: WARN,
    ForceCondition.FAULT: ERROR,
}


class ForceStatus:
    """
    Publishes state and figures of the force feedback.

    Parameters
    ----------
    node : Node
        Node of the entry.
    controller : ForceController
        Knows how weak the mechanism is at an orientation.
    inputs : ForceInputs
        Has the wrenches, and what is wrong with them.

    """

    def __init__(
        self,
        node: Node,
        controller: ForceController,
        inputs: ForceInputs,
    ) -> None:
        self._controller = controller
        self._inputs = inputs
        self._status = StatusPublisher(
            node=node,
            aspect='force',
            hardware_id='motors',
        )

    def publish(
        self,
        output: ForceOutput,
        quaternion: Quaternion[float] | None,
        report: DriveReport | None,
    ) -> None:
        """
        Publish the entry where it is due.

        Parameters
        ----------
        output : ForceOutput
            Of the latest sample.
        quaternion : tuple of four float or None
            R_base_platform of that sample.
        report : DriveReport or None
            Of the drives; None without them.

        """
        own_level = LEVELS.get(output.state.condition, OK)
        fault = drive_fault(report)
        caution = fault or self._inputs.caution
        level = own_level
        summary = _summary(output)
        if caution:
            level = max(level, WARN)
            summary = f'{summary}; {caution}'
        if not self._status.is_due(level, summary):
            return
        logged = output.state.text
        if output.state.why is ForceReason.DRIVE and fault:
            logged = f'{logged}; {fault}'
        figures = self._figures(output, quaternion)
        figures |= _figures_of_drives(report)
        self._status.publish(level, summary, figures, logged=(own_level, logged))

    def _figures(
        self,
        output: ForceOutput,
        quaternion: Quaternion[float] | None,
    ) -> dict[str, object]:
        """Return keys and values of the entry."""
        weakness: float | str = 'none'
        if quaternion is not None:
            found = self._controller.weakness(quaternion)
            if found is not None:
                weakness = found
        age: float | str = 'none'
        wrench_age = self._inputs.age()
        if wrench_age is not None:
            age = wrench_age
        torques = [f'{torque:.3f}' for torque in output.motor_torque]
        return {
            'torque asked of the handle (N m)': hypot(*output.asked),
            'rendered fraction': _fraction(output),
            'motor torque (N m)': ' '.join(torques),
            '1 / s_3': weakness,
            'energy (mJ)': 1e3 * output.energy,
            'share of the wrench left by the energy': output.share,
            'age of the wrench (s)': age,
            'wrenches too old': self._inputs.stale,
            'wrenches in an unknown frame': self._inputs.refused,
            'sources of wrenches': self._inputs.sources.count,
            **self._inputs.modes.figures(),
        }


def drive_fault(report: DriveReport | None) -> str:
    """Return the fault that the drives report; empty without one."""
    if report is None or report.fault is None:
        return ''
    return report.fault


def _summary(output: ForceOutput) -> str:
    """
    Return the state, and behind `off` and `ready` what keeps force from beginning.

    Parameters
    ----------
    output : ForceOutput
        Output of the latest sample.

    Returns
    -------
    str
        Words of the entry, without what the drives report.

    """
    text = output.state.text
    condition = output.state.condition
    if condition not in (ForceCondition.OFF, ForceCondition.READY):
        return text
    if output.obstacle is not None:
        return f'{text}; {output.obstacle.value}'
    if condition is ForceCondition.READY:
        return f'{text}; waits for wrenches below force.small_torque'
    return text


def _fraction(output: ForceOutput) -> object:
    """Return what the handle gets over what is asked of it."""
    asked = hypot(*output.asked)
    if output.rendered is None or not asked:
        return 'none'
    return hypot(*output.rendered) / asked


def _figures_of_drives(report: DriveReport | None) -> dict[str, object]:
    """Return keys and values of the drives; none without them."""
    if report is None:
        return {}
    state = 'in operation' if report.ready else 'not in operation'
    return {
        'drives': report.fault or state,
        'age of their status (s)': report.seconds_since_status,
    }
