# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Simulated encoders on a bus, and their faults; without a clock.

The caller gives the time of each cycle, and sends what is returned.
"""

from __future__ import annotations

from collections import deque
from math import radians
import random

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.can_bus import BUS_OFF, RESTARTED
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.simulation.device_quirks import Quirk, quirks_of
from spm_haptic_master.simulation.fault_injection import Fault, Faults
from spm_haptic_master.simulation.noisy_motion import NoisyMotion
from spm_haptic_master.simulation.object_store import GENERIC_ERROR, heartbeat
from spm_haptic_master.simulation.simulated_axes import SimulatedAxis
from spm_haptic_master.simulation.simulated_nodes import NodeOptions, SimulatedNode

# Encoders that answer SYNC, set up.
DEFAULT_OPTIONS = NodeOptions()


class SimulatedBus:
    """
    Encoders on a moving master, and their faults.

    Parameters
    ----------
    layouts : tuple of N EncoderLayout
        Frames of the joints' encoders.
    node_ids : tuple of N int, or None
        CANopen node ids; None if the encoders only answer SYNC.
    motion : NoisyMotion
        Motion that they measure.
    faults : tuple of Fault
        Faults, timed from the first answer.
    seed : int
        Seed of noise, losses and phases.
    options : NodeOptions
        How the encoders behave.
    quirks : tuple of Quirk
        What other makers' devices do.
    axes : tuple of SimulatedAxis
        Encoders of insertion and gripper, behind those of the joints.

    Attributes
    ----------
    nodes : tuple of SimulatedNode
        All encoders, those of the axes last.
    faults : Faults
        The faults, with those that are present.

    """

    def __init__(
        self,
        layouts: tuple[EncoderLayout, ...],
        node_ids: tuple[int, ...] | None,
        motion: NoisyMotion,
        faults: tuple[Fault, ...],
        seed: int,
        options: NodeOptions = DEFAULT_OPTIONS,
        quirks: tuple[Quirk, ...] = (),
        axes: tuple[SimulatedAxis, ...] = (),
    ):
        self._axes = axes
        ids: list[int | None] = [None] * len(layouts)
        if node_ids:
            ids = list(node_ids)
        ids += [axis.node_id for axis in axes]
        layouts = (*layouts, *(axis.layout for axis in axes))
        nodes = []
        for index, layout in enumerate(layouts):
            nodes.append(
                SimulatedNode(
                    layout=layout,
                    node_id=ids[index],
                    options=options,
                    quirks=quirks_of(quirks, index),
                )
            )
        self.nodes = tuple(nodes)
        self.faults = Faults(faults)
        self._motion = motion
        # Time of each node's next heartbeat, s.
        self._heartbeat_at = [0.0] * len(layouts)
        self._random = random.Random(seed)
        # Times after the begin of a cycle at which the encoders sample and send, s.
        has_phases = any(quirk.kind == 'phases' for quirk in quirks)
        self._phases = [0.0] * len(layouts)
        if has_phases and not options.synchronised:
            self._phases = [options.period * self._random.random() for _ in layouts]
        # Answers that each late encoder has not sent yet, with the times when they are due, s.
        self._queues: list[deque[tuple[float, can.Message]]] = []
        for _ in layouts:
            self._queues.append(deque())
        self._began: float | None = None
        self._jumped: list[Fault] = []
        # Where the stuck encoders got stuck, by index (rad).
        self._held: dict[int, float] = {}

    def identifiers(self) -> list[tuple[bool, int]]:
        """Return the identifiers of TPDOs and heartbeats: whether of 29 bits, and which."""
        found = []
        for node in self.nodes:
            found.append((node.layout.extended, node.layout.can_id))
        for node in self.nodes:
            if node.node_id is not None:
                found.append((False, canopen.HEARTBEAT_BASE + node.node_id))
        return found

    def boot(self) -> list[can.Message]:
        """Switch the encoders on and return their boot-up messages."""
        sent = []
        for node in self.nodes:
            sent += node.boot()
        return sent

    def receive(self, message: can.Message) -> list[can.Message]:
        """
        Return the answers to a frame that is not SYNC.

        Parameters
        ----------
        message : can.Message
            Any frame; only NMT commands and SDO requests are answered.

        Returns
        -------
        list of can.Message
            Answers of all nodes that are neither off nor muted by a fault.

        """
        is_other = message.is_error_frame or message.is_remote_frame or message.is_extended_id
        if is_other or self._mute():
            return []
        answers = []
        for index, node in enumerate(self.nodes):
            if not self._off(index):
                answers += node.receive(message)
        return answers

    def cycle(self, now: float) -> list[can.Message]:
        """
        Return the answers to SYNC.

        The first SYNC at which a node is operational begins the motion.

        Parameters
        ----------
        now : float
            Time, s; it only increases.

        Returns
        -------
        list of can.Message
            TPDOs that are due, and the frames of faults that begin or end.

        """
        is_operational = any(node.state == canopen.OPERATIONAL for node in self.nodes)
        if self._began is None and not is_operational:
            return []
        answers = self._begin(now)
        if self._mute():
            return answers
        angles = self._angles(now)
        for index in range(len(self.nodes)):
            if self._fault(index, 'reboot', 'unplug', 'dropout') is None:
                answers += self._answers(index, now, angles[index])
        return answers

    def _answers(
        self,
        index: int,
        now: float,
        angle: float,
    ) -> list[can.Message]:
        """
        Return what an encoder sends with a SYNC.

        Parameters
        ----------
        index : int
            Index of the encoder.
        now : float
            Time of SYNC, s.
        angle : float
            Angle of its joint at that time, rad.

        Returns
        -------
        list of can.Message
            The end of an emergency, and the answers that are due; a late one comes later.

        """
        node = self.nodes[index]
        phase = self._phases[index]
        if phase:
            angle = self._angles(now + phase)[index]
        answers = node.sync(now)
        is_counter_stuck = self._fault(index, 'counter') is not None
        sent = node.sample(self._faulty(index, angle), is_counter_stuck)
        loss = self._fault(index, 'loss')
        if loss is not None and 100.0 * self._random.random() < loss.value:
            return answers
        due = now + phase
        late = self._fault(index, 'late')
        if late is not None:
            due += late.value
        for message in sent:
            self._queues[index].append((due, message))
        return answers + self._due(index, now)

    def _begin(self, now: float) -> list[can.Message]:
        """Begin the motion at the first answer; a fault at 0 s affects that answer too."""
        if self._began is not None:
            return []
        self._began = now
        return self._update_faults(now)

    def _angles(self, now: float) -> tuple[float, ...]:
        """Return the angles of joints and axes at a time, s; rad."""
        t = 0.0
        if self._began is not None:
            t = now - self._began
        of_axes = [axis.angle(t) for axis in self._axes]
        return (*self._motion.angles(t), *of_axes)

    def _due(self, index: int, now: float) -> list[can.Message]:
        """Return the answers of an encoder that are due by a time, s."""
        queue = self._queues[index]
        found = []
        while queue:
            due, message = queue[0]
            if due > now:
                break
            queue.popleft()
            found.append(message)
        return found

    def orientation(self, now: float) -> tuple[float, float, float, float] | None:
        """Return the true quaternion x, y, z, w at `now`, s; None before the first answer."""
        if self._began is None:
            return None
        return self._motion.orientation(now - self._began)

    def tend(self, now: float) -> list[can.Message]:
        """Return the unsolicited frames due at `now`, s: those of faults, and heartbeats."""
        sent = self._update_faults(now)
        for index, node in enumerate(self.nodes):
            sent += self._due(index, now)
            sent += node.supervise(now)
            period = node.heartbeat_period
            at = self._heartbeat_at[index]
            if not period or node.node_id is None or now < at:
                continue
            self._heartbeat_at[index] = max(at + period, now)
            if not self._mute() and not self._off(index):
                sent.append(heartbeat(node.node_id, node.state))
        return sent

    def _update_faults(self, now: float) -> list[can.Message]:
        """Return the frames that faults send because they begin or end by a time, s."""
        if self._began is None:
            return []
        sent = []
        for fault, begins in self.faults.update(now - self._began):
            sent += self._messages(fault, begins)
        return sent

    def _messages(self, fault: Fault, begins: bool) -> list[can.Message]:
        """Return the frames that a fault sends when it begins or ends."""
        if fault.kind == 'busoff':
            error = BUS_OFF if begins else RESTARTED
            frame = can.Message(
                arbitration_id=error,
                is_error_frame=True,
                is_extended_id=False,
                data=bytes(8),
            )
            return [frame]
        if fault.joint is None:
            return []
        if fault.kind == 'stuck':
            self._held.pop(fault.joint, None)
        if fault.kind == 'emcy':
            return self._emergency(fault, self.nodes[fault.joint], begins)
        if begins:
            return []
        if fault.kind == 'late':
            return self._due(fault.joint, float('inf'))
        if fault.kind == 'reboot':
            return self.nodes[fault.joint].boot()
        return []

    def _emergency(
        self,
        fault: Fault,
        node: SimulatedNode,
        begins: bool,
    ) -> list[can.Message]:
        """Return the emergency that begins or ends; the register has what is left."""
        if node.node_id is None:
            return []
        if begins:
            code = int(fault.value)
        else:
            code = canopen.EMCY_ERROR_RESET
        # CiA 301, 7.2.7.1.
        if self._fault(fault.joint, 'emcy') is None:
            register = 0
        else:
            register = GENERIC_ERROR
        node.put(canopen.ERROR_REGISTER, register)
        return [canopen.emcy(node.node_id, code, register)]

    def _faulty(self, index: int, angle: float) -> float:
        """Return the angle of a joint's encoder, rad, with its faults."""
        for fault in self.faults.present:
            if fault.joint != index:
                continue
            if fault.kind == 'noise':
                angle += self._random.gauss(0.0, radians(fault.value))
            elif fault.kind == 'offset':
                angle += radians(fault.value)
            elif fault.kind == 'jump' and fault not in self._jumped:
                self._jumped.append(fault)
                angle += radians(fault.value)
        if self._fault(index, 'stuck') is not None:
            angle = self._held.setdefault(index, angle)
        return angle

    def _mute(self) -> bool:
        """Return whether a fault silences the whole bus."""
        return self._fault(None, 'silence', 'busoff') is not None

    def _off(self, index: int) -> bool:
        """Return whether a fault has switched an encoder off, by its index."""
        return self._fault(index, 'reboot', 'unplug') is not None

    def _fault(self, index: int | None, *kinds: str) -> Fault | None:
        """
        Return the present fault of an encoder.

        Parameters
        ----------
        index : int or None
            Index of the encoder; None for the whole bus.
        *kinds : str
            Kinds that are looked for.

        Returns
        -------
        Fault or None
            The first one of these kinds; None without one.

        """
        for fault in self.faults.present:
            if fault.kind in kinds and fault.joint == index:
                return fault
        return None
