# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Four CANopen encoders as a bus sees them: frames in, frames out; no clock, no bus."""

from __future__ import annotations

from math import radians
import random

import can

from spm_haptic_master.encoders import canopen, error_frames
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.simulation.fault_injection import Fault
from spm_haptic_master.simulation.noisy_motion import NoisyMotion

# What the nodes say of themselves: an encoder with absolute single-turn resolution (CiA 406), from
# nobody (vendor id 0 is not assigned).
DEVICE_TYPE = 1 << 16 | canopen.ENCODER_PROFILE
PRODUCT_CODE = 0x53504D
REVISION = 0x00010001
# Bit 0 of the error register: there is some error.
GENERIC_ERROR = 0x01


class SimulatedNode:
    """
    One CANopen encoder: NMT states, SDO identity, heartbeat, EMCY, and a TPDO on SYNC.

    Parameters
    ----------
    layout : EncoderLayout
        Its TPDO.
    node_id : int or None
        None: no CANopen node, only frames that answer SYNC.

    """

    def __init__(self, layout: EncoderLayout, node_id: int | None):
        self.layout = layout
        self.node_id = node_id
        self.state = canopen.OPERATIONAL if node_id is None else canopen.PRE_OPERATIONAL
        self._sent = 0
        self._identity = {} if node_id is None else {
            canopen.DEVICE_TYPE: DEVICE_TYPE, canopen.VENDOR_ID: 0,
            canopen.PRODUCT_CODE: PRODUCT_CODE, canopen.REVISION: REVISION,
            canopen.SERIAL_NUMBER: node_id}

    def boot(self) -> list[can.Message]:
        """Come up: the boot-up message, and pre-operational."""
        if self.node_id is None:
            return []
        self.state = canopen.PRE_OPERATIONAL
        return [canopen.frame(canopen.HEARTBEAT_BASE + self.node_id, bytes((canopen.BOOT_UP,)))]

    def heartbeat(self) -> list[can.Message]:
        """Return the heartbeat with the state."""
        if self.node_id is None:
            return []
        return [canopen.frame(canopen.HEARTBEAT_BASE + self.node_id, bytes((self.state,)))]

    def receive(self, message: can.Message) -> list[can.Message]:
        """Answer NMT and SDO."""
        data = message.data
        if self.node_id is None:
            return []
        if message.arbitration_id == canopen.NMT_ID and len(data) == 2 \
                and data[1] in (0, self.node_id):
            return self._command(data[0])
        if message.arbitration_id == canopen.SDO_REQUEST_BASE + self.node_id \
                and len(data) == canopen.SDO_LENGTH and self.state != canopen.STOPPED:
            return [self._sdo(data)]
        return []

    def answer(self, angle: float, counter_stands: bool = False) -> list[can.Message]:
        """Return the TPDO at an angle in rad, where the node is operational."""
        if self.state != canopen.OPERATIONAL:
            return []
        if not counter_stands:
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

    def _sdo(self, data: bytes) -> can.Message:
        index, subindex = canopen.sdo_object(data)
        value = self._identity.get((index, subindex))
        if data[0] != canopen.SDO_UPLOAD_REQUEST:
            return canopen.sdo_abort(self.node_id, index, subindex, canopen.SDO_UNKNOWN_COMMAND)
        if value is None:
            return canopen.sdo_abort(self.node_id, index, subindex, canopen.SDO_NO_SUCH_OBJECT)
        return canopen.sdo_answer(self.node_id, index, subindex, value)


class SimulatedBus:
    """
    Four encoders on a moving master, and the faults that befall them.

    Parameters
    ----------
    layouts : tuple of 4 EncoderLayout
        Their frames.
    node_ids : tuple of 4 int, or None
        None: they are no CANopen nodes.
    motion : NoisyMotion
        What they measure.
    faults : tuple of Fault
        What goes wrong.
    heartbeat : float
        s between heartbeats.
    seed : int
        Of the faults' noise.

    Attributes
    ----------
    news : list of str
        Faults that began or ended since somebody emptied it.

    """

    def __init__(self, layouts: tuple[EncoderLayout, ...], node_ids: tuple[int, ...] | None,
                 motion: NoisyMotion, faults: tuple[Fault, ...], heartbeat: float, seed: int):
        self._nodes = tuple(map(SimulatedNode, layouts, node_ids or (None,) * len(layouts)))
        self._motion = motion
        self._faults = faults
        self._heartbeat = heartbeat
        self._heartbeat_at = 0.0
        self._gauss = random.Random(seed).gauss
        self._began: float | None = None
        self._active: set[Fault] = set()
        self._jumped: set[Fault] = set()
        self._held: list[float | None] = [None] * len(layouts)
        self.news: list[str] = []

    def boot(self) -> list[can.Message]:
        """Switch the bus on."""
        return [message for node in self._nodes for message in node.boot()]

    def receive(self, message: can.Message) -> list[can.Message]:
        """Answer a frame that is not SYNC."""
        if message.is_error_frame or message.is_remote_frame or message.is_extended_id \
                or self._mute():
            return []
        return [answer for index, node in enumerate(self._nodes)
                if not self._is(index, 'reboot') for answer in node.receive(message)]

    def cycle(self, now: float) -> list[can.Message]:
        """Answer SYNC at `now`, s."""
        if self._began is None:
            if not any(node.state == canopen.OPERATIONAL for node in self._nodes):
                return []
            self._began = now
        t = now - self._began
        angles = self._motion.angles(t)
        if self._mute():
            return []
        if not self._active:
            return [message for node, angle in zip(self._nodes, angles, strict=True)
                    for message in node.answer(angle)]
        answers = []
        for index, (node, angle) in enumerate(zip(self._nodes, angles, strict=True)):
            if self._is(index, 'dropout') or self._is(index, 'reboot'):
                continue
            answers += node.answer(self._wrong(index, angle),
                                   self._is(index, 'counter'))
        return answers

    def tend(self, now: float) -> list[can.Message]:
        """Return what is due at `now` without being asked: faults' own frames, heartbeats."""
        sent = self._pass_faults(now)
        if now >= self._heartbeat_at:
            self._heartbeat_at = max(self._heartbeat_at + self._heartbeat, now)
            if not self._mute():
                sent += [message for index, node in enumerate(self._nodes)
                         if not self._is(index, 'reboot') for message in node.heartbeat()]
        return sent

    def _pass_faults(self, now: float) -> list[can.Message]:
        if self._began is None:
            return []
        sent = []
        t = now - self._began
        for fault in self._faults:
            if fault.active(t) == (fault in self._active):
                continue
            begins = fault not in self._active
            (self._active.add if begins else self._active.remove)(fault)
            self.news.append(f'{fault.text} {"begins" if begins else "ends"}')
            if fault.joint is not None:
                self._held[fault.joint] = None
            sent += self._messages(fault, begins)
        return sent

    def _messages(self, fault: Fault, begins: bool) -> list[can.Message]:
        """Return what is on the bus when a fault begins or ends."""
        if fault.kind == 'busoff':
            error = error_frames.BUS_OFF if begins else error_frames.RESTARTED
            return [can.Message(arbitration_id=error, is_error_frame=True, is_extended_id=False,
                                data=bytes(8))]
        if fault.joint is None:
            return []
        node = self._nodes[fault.joint]
        if fault.kind == 'emcy' and node.node_id is not None:
            code, register = (int(fault.value), GENERIC_ERROR) if begins \
                else (canopen.EMCY_ERROR_RESET, 0)
            return [canopen.emcy(node.node_id, code, register)]
        return node.boot() if fault.kind == 'reboot' and not begins else []

    def _wrong(self, index: int, angle: float) -> float:
        """Return what a joint's encoder says, rad, with its faults on top."""
        for fault in self._active:
            if fault.joint != index:
                continue
            if fault.kind == 'offset':
                angle += radians(fault.value)
            elif fault.kind == 'noise':
                angle += self._gauss(0.0, radians(fault.value))
            elif fault.kind == 'jump' and fault not in self._jumped:
                self._jumped.add(fault)
                angle += radians(fault.value)
        if self._is(index, 'stuck'):
            if self._held[index] is None:
                self._held[index] = angle
            angle = self._held[index]
        return angle

    def _mute(self) -> bool:
        return self._is(None, 'silence') or self._is(None, 'busoff')

    def _is(self, index: int | None, kind: str) -> bool:
        return any(fault.kind == kind and fault.joint == index for fault in self._active)
