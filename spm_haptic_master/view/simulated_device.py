# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The knobs of a device and the topics behind them, where its source is simulated."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, FAULTS_TOPIC, STEER_TOPIC
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.view.simulation_knobs import SimulationKnobs
from std_msgs.msg import Float64MultiArray, String
from viser import GuiApi

# Words on the topic `source` of a simulation.
SIMULATED = 'sim'


class SimulatedDevice:
    """
    What a client of the page can operate: with any other source than a simulation, nothing.

    Parameters
    ----------
    node : Node
        Node that subscribes and publishes.
    gui : GuiApi
        Panel of the page.
    folder : context manager
        The device's part of the panel.
    order : float
        Where the knobs are in it.
    name : callable
        Name of a topic in the device's namespace.

    Attributes
    ----------
    knobs : SimulationKnobs or None
        The knobs; None with any other source.
    happened : list of str
        Changes of the faults, in words; the caller empties it.

    """

    def __init__(self, node: Node, gui: GuiApi, folder: AbstractContextManager[Any],
                 order: float, name: Callable[[str], str]) -> None:
        self._node, self._gui, self._folder, self._name = node, gui, folder, name
        self._order = order
        self._simulated = False
        self._faults = ''
        self._steer_out: Publisher | None = None
        self._fail_out: Publisher | None = None
        self.knobs: SimulationKnobs | None = None
        self.happened: list[str] = []

    def show(self, source: str, sensors: int) -> None:
        """Show the knobs of a simulated source with a number of sensors, of another one none."""
        self._simulated = source == SIMULATED
        if self._simulated and self._steer_out is None:
            node, name = self._node, self._name
            self._steer_out = node.create_publisher(Float64MultiArray, name(STEER_TOPIC), 1)
            self._fail_out = node.create_publisher(String, name(FAULT_TOPIC), 1)
            node.create_subscription(String, name(FAULTS_TOPIC), self._on_faults, STATE)
        if self.knobs is not None and not (self._simulated and self.knobs.sensors == sensors):
            self.knobs.remove()
            self.knobs = None
        if self._simulated and self.knobs is None:
            with self._folder:
                self.knobs = SimulationKnobs(
                    self._gui, self._order, self._steer, self._fail, sensors)
        if self.knobs is not None:
            self.knobs.show(self._faults)

    def tick(self, now: float) -> str:
        """Go on with the story that is played, at a time, s; return its words, empty without."""
        if self.knobs is None:
            return ''
        self.knobs.player.tick(now)
        return self.knobs.player.words

    def _on_faults(self, message: String) -> None:
        if message.data != self._faults:
            self.happened.append(f'faults: {message.data or "none"}')
        self._faults = message.data
        if self.knobs is not None:
            self.knobs.show(self._faults)

    def _steer(self, *pose: float) -> None:
        if self._steer_out is not None and self._simulated:
            self._steer_out.publish(Float64MultiArray(data=list(pose)))

    def _fail(self, faults: str) -> None:
        if self._fail_out is not None and self._simulated:
            self._fail_out.publish(String(data=faults))
