# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated CANopen encoders: frames in, frames out; without clock and bus."""

from __future__ import annotations

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.simulation.object_store import PRODUCT_CODE, REVISION, VENDOR_ID
from spm_haptic_master.simulation.simulated_lss import LssDevice, UNCONFIGURED
from spm_haptic_master.simulation.simulated_objects import SimulatedObjects

# Time between heartbeats of a node that is set up (s).
HEARTBEAT = 0.1


class SimulatedNode:
    """
    One encoder with NMT states, LSS, objects by SDO, heartbeat and a TPDO on SYNC.

    Without a node id it only answers SYNC; not `synchronised`, it sends by itself. From the
    `factory` it has no node id yet, and its maker's defaults: the given one is its serial number.
    """

    def __init__(self, layout: EncoderLayout, node_id: int | None, synchronised: bool = True,
                 heartbeat: float = HEARTBEAT, factory: bool = False):
        self.layout = layout
        self.node_id = None if factory else node_id
        self.state = canopen.OPERATIONAL if node_id is None else canopen.PRE_OPERATIONAL
        self._on_network = node_id is not None
        self._sent = 0
        serial = node_id or 0
        self._lss = LssDevice((VENDOR_ID, PRODUCT_CODE, REVISION, serial),
                              UNCONFIGURED if factory else serial)
        self._objects = SimulatedObjects(layout, serial, synchronised, heartbeat, factory)

    @property
    def heartbeat_period(self) -> float | None:
        """Time between heartbeats, s; None for no heartbeat."""
        return None if self.node_id is None else self._objects.heartbeat

    def boot(self, stored: bool = True) -> list[can.Message]:
        """
        Enter pre-operational and return the boot-up message.

        It returns to its stored node id, or takes the one set last.
        """
        if not self._on_network:
            return []
        node_id = self._lss.restart(stored)
        self._objects.restart()
        self.state = canopen.PRE_OPERATIONAL
        self.node_id = None if node_id == UNCONFIGURED else node_id
        return self._report(canopen.BOOT_UP)

    def heartbeat(self) -> list[can.Message]:
        """Return the heartbeat, which carries the state."""
        return self._report(self.state)

    def _report(self, state: int) -> list[can.Message]:
        return [] if self.node_id is None else [
            canopen.frame(canopen.HEARTBEAT_BASE + self.node_id, bytes((state,)))]

    def receive(self, message: can.Message) -> list[can.Message]:
        """Obey an NMT command, or answer an SDO or LSS request."""
        identifier, data = message.arbitration_id, bytes(message.data)
        if identifier == canopen.LSS_REQUEST_ID and len(data) == canopen.LSS_LENGTH \
                and self._on_network:
            answers = self._lss.receive(data)
            # A device without a node id boots when it has got one and leaves the configuration.
            if self.node_id is None and not self._lss.configuring \
                    and self._lss.node_id != UNCONFIGURED:
                answers += self.boot(stored=False)
            return answers
        if self.node_id is None:
            return []
        if identifier == canopen.NMT_ID and len(data) == 2 and data[1] in (0, self.node_id):
            return self._command(data[0])
        if identifier == canopen.SDO_REQUEST_BASE + self.node_id \
                and len(data) == canopen.SDO_LENGTH and self.state != canopen.STOPPED \
                and data[0] != canopen.SDO_ABORT:
            return [self._objects.answer(self.node_id, data)]
        return []

    def answer(self, angle: float, counter_stuck: bool = False) -> list[can.Message]:
        """Return the TPDO at an angle in rad, if the node is operational and set up to send it."""
        objects = self._objects
        if self.state != canopen.OPERATIONAL or not objects.sends:
            return []
        self._sent += not counter_stuck
        return [can.Message(arbitration_id=objects.identifier,
                            is_extended_id=self.layout.extended,
                            data=objects.layout.data(angle, self._sent) + bytes(objects.more))]

    def _command(self, command: int) -> list[can.Message]:
        if command in (canopen.NMT_RESET_NODE, canopen.NMT_RESET_COMMUNICATION):
            return self.boot(stored=command == canopen.NMT_RESET_NODE)
        self.state = {
            canopen.NMT_START: canopen.OPERATIONAL, canopen.NMT_STOP: canopen.STOPPED,
            canopen.NMT_PRE_OPERATIONAL: canopen.PRE_OPERATIONAL}.get(command, self.state)
        return []
