# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Asks fkm for the settings that the page needs: mechanism, mounting, sensors and limits."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.parameters import geometry
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete, SENSORS_SETTING, Values
from spm_haptic_master.timing import Periodic

# Settings of fkm alone that the page shows.
SHOWN = 'alert_limit_deg', 'calibration'
SETTINGS = (
    *geometry.MECHANISM_SETTINGS,
    *geometry.MOUNTING_SETTINGS,
    SENSORS_SETTING,
    *(setting for setting in FKM_SETTINGS if setting.name in SHOWN),
)
# Period of asking (s): another fkm may have another mechanism or mounting.
PERIOD = 1.0


class SettingsClient:
    """
    Calls a function with the checked settings of a parameter service, once a second.

    Parameters
    ----------
    node : Node
        Node that calls the service.
    service : str
        Name of the service `get_parameters` of fkm.
    take : callable
        Is called with the values by name. Its SpmError is ignored, as are settings that are not
        valid.

    """

    def __init__(
        self,
        node: Node,
        service: str,
        take: Callable[[Values], None],
    ) -> None:
        self._node = node
        self._take = take
        self._client = node.create_client(GetParameters, service)
        self._due = Periodic(PERIOD)

    def tick(self, now: float) -> None:
        """
        Ask if that is due at a time, s.

        Parameters
        ----------
        now : float
            Present time, s, monotonic.

        """
        if self._client.service_is_ready() and self._due.is_due(now):
            names = [setting.name for setting in SETTINGS]
            asked = self._client.call_async(GetParameters.Request(names=names))
            asked.add_done_callback(self._on_answer)

    def close(self) -> None:
        """End the client."""
        self._node.destroy_client(self._client)

    def _on_answer(self, future: Future) -> None:
        """
        Take the answer; ignore one that no fkm of this package gives.

        A parameter that fkm does not have has no value in the answer: it has its default.
        """
        answer = future.result()
        if answer is None:
            return
        given = {}
        for setting, value in zip(SETTINGS, answer.values, strict=False):
            python = parameter_value_to_python(value)
            if python is not None:
                given[setting.name] = python
        with suppress(SpmError):
            self._take(complete(SETTINGS, given))
