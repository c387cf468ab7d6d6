# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated CANopen encoders: frames in, frames out; without clock and bus."""

from __future__ import annotations

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.encoder_layout import EncoderLayout

# Device type of the nodes: an encoder with absolute single-turn resolution (CiA 406).
DEVICE_TYPE = 1 << 16 | canopen.ENCODER_PROFILE
# Vendor id of the nodes: 0 is not assigned to any vendor.
VENDOR_ID = 0
# Product code of the nodes: "SPM" in ASCII.
PRODUCT_CODE = 0x53504D
# Revision of the nodes: 1.1.
REVISION = 0x00010001


class SimulatedNode:
    """
    One encoder with NMT states, SDO identity, heartbeat and a TPDO on SYNC.

    Parameters
    ----------
    layout : EncoderLayout
        Layout of its TPDO.
    node_id : int or None
        CANopen node id; None for an encoder that only answers SYNC.

    Attributes
    ----------
    layout, node_id
        As given.
    state : int
        NMT state.

    """

    def __init__(self, layout: EncoderLayout, node_id: int | None):
        self.layout = layout
        self.node_id = node_id
        self.state = canopen.OPERATIONAL if node_id is None else canopen.PRE_OPERATIONAL
        self._sent = 0
        self._identity = {} if node_id is None else {
            canopen.DEVICE_TYPE: DEVICE_TYPE, canopen.VENDOR_ID: VENDOR_ID,
            canopen.PRODUCT_CODE: PRODUCT_CODE, canopen.REVISION: REVISION,
            canopen.SERIAL_NUMBER: node_id}

    def boot(self) -> list[can.Message]:
        """Enter pre-operational and return the boot-up message."""
        if self.node_id is None:
            return []
        self.state = canopen.PRE_OPERATIONAL
        return [canopen.frame(canopen.HEARTBEAT_BASE + self.node_id, bytes((canopen.BOOT_UP,)))]

    def heartbeat(self) -> list[can.Message]:
        """Return the heartbeat, which carries the state."""
        if self.node_id is None:
            return []
        return [canopen.frame(canopen.HEARTBEAT_BASE + self.node_id, bytes((self.state,)))]

    def receive(self, message: can.Message) -> list[can.Message]:
        """Obey an NMT command or answer an SDO request."""
        data = message.data
        if self.node_id is None:
            return []
        if message.arbitration_id == canopen.NMT_ID and len(data) == 2 \
                and data[1] in (0, self.node_id):
            return self._command(data[0])
        if message.arbitration_id == canopen.SDO_REQUEST_BASE + self.node_id \
                and len(data) == canopen.SDO_LENGTH and self.state != canopen.STOPPED:
            return [self._sdo(self.node_id, bytes(data))]
        return []

    def answer(self, angle: float, counter_stuck: bool = False) -> list[can.Message]:
        """Return the TPDO at an angle in rad, if the node is operational."""
        if self.state != canopen.OPERATIONAL:
            return []
        if not counter_stuck:
            self._sent += 1
        layout = self.layout
        return [can.Message(arbitration_id=layout.can_id, is_extended_id=layout.extended,
                            data=layout.data(angle, self._sent))]

    def _command(self, command: int) -> list[can.Message]:
        if command in (canopen.NMT_RESET_NODE, canopen.NMT_RESET_COMMUNICATION):
            return self.boot()
        self.state = {
            canopen.NMT_START: canopen.OPERATIONAL, canopen.NMT_STOP: canopen.STOPPED,
            canopen.NMT_PRE_OPERATIONAL: canopen.PRE_OPERATIONAL}.get(command, self.state)
        return []

    def _sdo(self, node_id: int, data: bytes) -> can.Message:
        index, subindex = canopen.sdo_object(data)
        value = self._identity.get((index, subindex))
        if data[0] != canopen.SDO_UPLOAD_REQUEST:
            return canopen.sdo_abort(node_id, index, subindex, canopen.SDO_UNKNOWN_COMMAND)
        if value is None:
            return canopen.sdo_abort(node_id, index, subindex, canopen.SDO_NO_SUCH_OBJECT)
        return canopen.sdo_answer(node_id, index, subindex, value)
