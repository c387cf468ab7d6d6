# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mechanism of a device: parameters of its fkm."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import (
    GEOMETRY_SETTINGS,
    mechanism_checksum,
    MOUNTING_SETTINGS,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.parameters.shared import SENSORS_SETTING
from spm_haptic_master.ros.diagnostic_status import CHECKSUM_KEY

# Settings of fkm that the page needs.
(ALERT_LIMIT_SETTING,) = (each for each in FKM_SETTINGS if each.name == 'alert_limit_deg')
SETTINGS = (*GEOMETRY_SETTINGS, WORKING_MODE_SETTING, *MOUNTING_SETTINGS, SENSORS_SETTING,
            ALERT_LIMIT_SETTING)
# Time after which fkm is asked again without an answer, and after one (s): another fkm may have
# another mechanism or mounting.
ANSWER_TIMEOUT, ASK_PERIOD = 1.0, 5.0


class MechanismQuery:
    """
    Asks fkm for its parameters, again and again.

    `build` is called with checked settings that differ from the last ones; it raises SpmError if
    they cannot be drawn.
    """

    def __init__(self, node: Node, service: str, build: Callable[[dict[str, Any]], None]) -> None:
        self._build = build
        self._client = node.create_client(GetParameters, service)
        # Settings of the mechanism that is drawn, none before the first, and its checksum.
        self._known: dict[str, Any] = {}
        self._checksum = ''
        # When fkm was asked (s, monotonic), and whether its mechanism is drawn, as far as known.
        self._asked_at, self._answered = -inf, False

    def ask(self, now: float) -> None:
        """Ask when that is due, at a time, s."""
        period = ASK_PERIOD if self._answered else ANSWER_TIMEOUT
        if now - self._asked_at >= period and self._client.service_is_ready():
            self._asked_at, self._answered = now, False
            request = GetParameters.Request(names=[setting.name for setting in SETTINGS])
            self._client.call_async(request).add_done_callback(self._on_answer)

    def check(self, entry: DiagnosticStatus) -> None:
        """Ask again soon if fkm reports another mechanism than the drawn one."""
        reported = next((value.value for value in entry.values if value.key == CHECKSUM_KEY), '')
        if reported not in ('', self._checksum):
            self._answered = False

    def take(self, values: dict[str, Any]) -> None:
        """Build the mechanism of checked settings if they are new."""
        if values != self._known:
            self._build(values)
            self._known, self._checksum = values, mechanism_checksum(values)

    def _on_answer(self, future: Future) -> None:
        answers = map(parameter_value_to_python, future.result().values)
        given = {setting.name: value for setting, value in zip(SETTINGS, answers, strict=False)
                 if value is not None}
        try:
            self.take(complete(SETTINGS, given))
        except SpmError:
            return  # of another version: asked again
        self._answered = True
