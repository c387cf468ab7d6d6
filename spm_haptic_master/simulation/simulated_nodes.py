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

    Parameters
    ----------
    layout : EncoderLayout
        Layout of its TPDO.
    node_id : int or None
        CANopen node id; None for an encoder that only answers SYNC.
    synchronised : bool
        Whether the TPDO answers SYNC; otherwise the encoder sends it by itself.
    heartbeat : float
        Time between heartbeats, s.
    factory : bool
        Whether it has no node id yet, and its maker's defaults. `node_id` is its serial number
        then.

    Attributes
    ----------
    layout : EncoderLayout
        As given.
    node_id : int or None
        Its present node id; None also while it has none yet.
    state : int
        NMT state.

    """

    def __init__(self, layout: EncoderLayout, node_id: int | None, synchronised: bool = True,
                 heartbeat: float = HEARTBEAT, factory: bool = False):
        self.layout = layout
        self.node_id = None if factory else node_id
        self.state = canopen.OPERATIONAL if node_id is None else canopen.PRE_OPERATIONAL
        self._sent = 0
        self._objects: SimulatedObjects | None = None
        if node_id is None:
            return
        self._lss = LssDevice((VENDOR_ID, PRODUCT_CODE, REVISION, node_id),
                              UNCONFIGURED if factory else node_id)
        self._objects = SimulatedObjects(layout, node_id, node_id, synchronised, heartbeat,
                                         factory)

    @property
    def heartbeat_period(self) -> float | None:
        """Time between heartbeats, s; None for no heartbeat."""
        return None if self.node_id is None or self._objects is None else self._objects.heartbeat

    def boot(self, stored: bool = True) -> list[can.Message]:
        """
        Enter pre-operational and return the boot-up message.

        Parameters
        ----------
        stored : bool
            Whether it returns to its stored node id; otherwise it takes the one set last.

        """
        if self._objects is None:
            return []
        node_id = self._lss.restart(stored)
        self._objects.restart()
        self.state = canopen.PRE_OPERATIONAL
        self.node_id = None if node_id == UNCONFIGURED else node_id
        if self.node_id is None:
            return []
        return [canopen.frame(canopen.HEARTBEAT_BASE + self.node_id, bytes((canopen.BOOT_UP,)))]

    def heartbeat(self) -> list[can.Message]:
        """Return the heartbeat, which carries the state."""
        if self.node_id is None:
            return []
        return [canopen.frame(canopen.HEARTBEAT_BASE + self.node_id, bytes((self.state,)))]

    def receive(self, message: can.Message) -> list[can.Message]:
        """Obey an NMT command, or answer an SDO or LSS request."""
        data = bytes(message.data)
        if self._objects is None:
            return []
        if message.arbitration_id == canopen.LSS_REQUEST_ID and len(data) == canopen.LSS_LENGTH:
            return self._layer_setting(data)
        if self.node_id is None:
            return []
        if message.arbitration_id == canopen.NMT_ID and len(data) == 2 \
                and data[1] in (0, self.node_id):
            return self._command(data[0])
        if message.arbitration_id == canopen.SDO_REQUEST_BASE + self.node_id \
                and len(data) == canopen.SDO_LENGTH and self.state != canopen.STOPPED \
                and data[0] != canopen.SDO_ABORT:
            return [self._objects.answer(self.node_id, data)]
        return []

    def answer(self, angle: float, counter_stuck: bool = False) -> list[can.Message]:
        """Return the TPDO at an angle in rad, if the node is operational and set up to send it."""
        if self.state != canopen.OPERATIONAL:
            return []
        objects = self._objects
        if objects is not None and not objects.sends:
            return []
        if not counter_stuck:
            self._sent += 1
        if objects is None:
            return [_tpdo(self.layout.can_id, self.layout, angle, self._sent)]
        return [_tpdo(objects.identifier, objects.layout, angle, self._sent, objects.more)]

    def _command(self, command: int) -> list[can.Message]:
        if command in (canopen.NMT_RESET_NODE, canopen.NMT_RESET_COMMUNICATION):
            return self.boot(stored=command == canopen.NMT_RESET_NODE)
        self.state = {
            canopen.NMT_START: canopen.OPERATIONAL, canopen.NMT_STOP: canopen.STOPPED,
            canopen.NMT_PRE_OPERATIONAL: canopen.PRE_OPERATIONAL}.get(command, self.state)
        return []

    def _layer_setting(self, data: bytes) -> list[can.Message]:
        answers = self._lss.receive(data)
        # A device without a node id boots when it has got one and leaves the configuration.
        if self.node_id is None and not self._lss.configuring \
                and self._lss.node_id != UNCONFIGURED:
            return [*answers, *self.boot(stored=False)]
        return answers


def _tpdo(identifier: int, layout: EncoderLayout, angle: float, sent: int,
          more: int = 0) -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=layout.extended,
                       data=layout.data(angle, sent) + bytes(more))
