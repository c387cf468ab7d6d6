# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Simulated drives of CiA 402 and their faults: frames in, frames out; without clock and bus.

They follow the state machine of the profile, its reactions to a lost master, and I2t.
"""

from __future__ import annotations

from dataclasses import replace

import can
from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import State
from spm_haptic_master.drives.drive_objects import drive_objects
from spm_haptic_master.drives.plan import DrivePlan, LARGEST_SYNCS, Plan
from spm_haptic_master.encoders import canopen
from spm_haptic_master.simulation.fault_injection import Fault, Faults
from spm_haptic_master.simulation.object_store import (
    Entry,
    GENERIC_ERROR,
    heartbeat,
    identity,
    is_nmt_command,
    is_sdo_request,
    Key,
    Mapped,
    ObjectStore,
    RESETS,
    SdoAbortError,
    STATES,
    STORES_ON_COMMAND,
)

# Device type: a servo drive.
DEVICE_TYPE = 0x00020000 | canopen.DRIVE_PROFILE
# Numbers of the PDOs that a drive takes.
PDOS = (0, 1)
# Modes that the drive has: profile torque and cyclic synchronous torque.
MODE_NUMBERS = (cia402.PROFILE_TORQUE, cia402.CYCLIC_TORQUE)
# These modes as an object has them: one bit a mode, mode 1 is bit 0.
MODES = sum(1 << number - 1 for number in MODE_NUMBERS)
# Statusword of each state, with voltage and remote on.
STATUSWORDS = {
    State.DISABLED: 0x0250,
    State.READY: 0x0231,
    State.SWITCHED_ON: 0x0233,
    State.ENABLED: 0x0237,
    State.FAULT: 0x0218,
}
# Error codes of EMCY: loss of the heartbeat, of a PDO, too much heat.
HEARTBEAT_LOST = 0x8130
PDO_LOST = 0x8250
TOO_HOT = 0x2350
# Heat above that of the rated torque at which the drive has a fault: twice the rated torque for
# a second (s, in shares of the rated heat).
HEAT_LIMIT = 3.0
# Default of the abort connection option: a fault.
FAULT_ON_ABORT = 1


class DriveObjects(ObjectStore):
    """
    Objects of one drive.

    Parameters
    ----------
    plan : Plan
        All drives on their bus.
    own : DrivePlan
        This drive.
    factory : bool
        Whether nothing of them is set up yet; its PDOs are then off.

    """

    def __init__(
        self,
        plan: Plan,
        own: DrivePlan,
        factory: bool,
    ):
        wanted = drive_objects(plan, own)
        entries = identity(DEVICE_TYPE, own.node_id)
        for each in wanted.every:
            if each.of_device or not factory:
                value = each.value
            else:
                value = 0
            entries[each.index, each.subindex] = Entry(
                value=value,
                size=each.size,
                writable=not each.of_device,
            )
        if factory:
            for pdo in wanted.pdos:
                key = (pdo.identifier.index, canopen.TPDO_IDENTIFIER)
                entries[key] = Entry(pdo.identifier.value | canopen.TPDO_OFF)
            entries[cia402.ABORT_OPTION] = Entry(FAULT_ON_ABORT, 2)
        entries[canopen.STORE] = Entry(STORES_ON_COMMAND)
        entries[cia402.MODE] = Entry(value=0, size=1)
        entries[cia402.STATUSWORD] = Entry(
            value=0,
            size=2,
            writable=False,
        )
        entries[cia402.SUPPORTED_MODES] = Entry(MODES, writable=False)
        super().__init__(entries)

    def show(self, key: Key, value: int) -> None:
        """
        Set the value of an object that the drive itself makes, such as its statusword.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.
        value : int
            New value.

        """
        entry = self._entries[key]
        self._entries[key] = replace(entry, value=value)

    def _check_state(self, key: Key, value: int) -> None:
        """Refuse a mode of operation (6060h) that the drive does not have."""
        # A mode is one byte with a sign; the drive has none beyond 32.
        if key == cia402.MODE and not MODES >> (value - 1 & 0x1F) & 1:
            raise SdoAbortError(canopen.SDO_WRONG_VALUE)


class SimulatedDrive:
    """
    One drive with its states, time-outs, heat and faults.

    Parameters
    ----------
    plan : Plan
        All drives on their bus.
    own : DrivePlan
        This drive.
    factory : bool
        Whether it is not set up yet.

    Attributes
    ----------
    node_id : int
        CANopen node id.
    objects : DriveObjects
        Its objects.
    faults : dict of str to float
        Present faults of DRIVE_KINDS, with their values.
    nmt : int
        NMT state.
    state : State
        State of CiA 402.

    """

    def __init__(
        self,
        plan: Plan,
        own: DrivePlan,
        factory: bool,
    ):
        self.node_id = own.node_id
        self.objects = DriveObjects(plan, own, factory)
        self.faults: dict[str, float] = {}
        # Times of the own latest heartbeat, status frame and step, s.
        self._heartbeat_at = float('-inf')
        self._status_at = float('-inf')
        self._now: float | None = None
        self._heat = 0.0
        self._control = 0
        self._target = 0
        self._syncs = 0  # since the latest status frame
        self.boot()

    @property
    def torque(self) -> int:
        """Torque of the motor within the drive's own cap, per mille of the rated one."""
        cap = self.objects.value(*cia402.MAXIMUM_TORQUE)
        if self.state is not State.ENABLED:
            return 0
        return max(-cap, min(cap, self._target))

    def boot(self) -> list[can.Message]:
        """Enter pre-operational, and return the boot-up message."""
        self.objects.restart()
        self.nmt = canopen.PRE_OPERATIONAL
        self.state = State.DISABLED
        # Times of the latest torque frame and heartbeat of the master, s; None before the first
        # and after they were missed.
        self._torque_at: float | None = None
        self._master_at: float | None = None
        return [heartbeat(self.node_id, canopen.BOOT_UP)]

    def receive(self, message: can.Message, now: float) -> list[can.Message]:
        """
        Return the answers to a frame.

        Parameters
        ----------
        message : can.Message
            Any frame on the bus.
        now : float
            Time, s.

        Returns
        -------
        list of can.Message
            SDO answer, boot-up message, status frame or emergency; usually none.

        """
        if 'drive_unplug' in self.faults:
            return []
        identifier = message.arbitration_id
        data = bytes(message.data)
        if is_nmt_command(identifier, data, self.node_id):
            return self._command(data[0])
        if is_sdo_request(identifier, data, self.node_id):
            self.objects.show(cia402.STATUSWORD, STATUSWORDS[self.state])
            answer = self.objects.answer(self.node_id, data)
            return [answer]
        if identifier == canopen.SYNC_ID and self._is_sync_due():
            return self._status()
        if identifier == self._master_heartbeat:
            self._master_at = now
        return self._take_pdo(identifier, data, now)

    @property
    def _master_heartbeat(self) -> int | None:
        """Return the identifier of the heartbeat that the drive supervises; None: it has none."""
        master = self.objects.value(*cia402.HEARTBEAT_CONSUMER)
        if master:
            return canopen.HEARTBEAT_BASE + (master >> 16 & 0x7F)
        return None

    def _take_pdo(
        self,
        identifier: int,
        data: bytes,
        now: float,
    ) -> list[can.Message]:
        """Take a frame that is one of its RPDOs, while the node is operational."""
        found: list[can.Message] = []
        if self.nmt != canopen.OPERATIONAL:
            return found
        for number in PDOS:
            own = self.objects.value(canopen.RPDO_PARAMETERS + number, 1)
            if identifier == own:
                found += self._take(number, data, now)
        return found

    @property
    def _syncs_a_status(self) -> int:
        """SYNC frames from one status frame to the next; 0: it is sent by its timer."""
        syncs = self.objects.value(canopen.TPDO_PARAMETERS, canopen.TPDO_TYPE)
        return syncs if syncs <= LARGEST_SYNCS else 0

    def _is_sync_due(self) -> bool:
        """Count a SYNC; return whether a status frame follows it."""
        syncs = self._syncs_a_status
        if not syncs or self.nmt != canopen.OPERATIONAL:
            return False
        self._syncs = (self._syncs + 1) % syncs
        return self._syncs == 0

    def tend(self, now: float) -> list[can.Message]:
        """
        Let time go on: time-outs, heat, heartbeat and timed status frames.

        Parameters
        ----------
        now : float
            Time, s; it only increases.

        Returns
        -------
        list of can.Message
            Frames that are due.

        """
        elapsed = 0.0
        if self._now is not None:
            elapsed = now - self._now
        sent = self._time_out(now)
        sent += self._heat_up(elapsed)
        self._now = now
        if 'drive' in self.faults and self.state is not State.FAULT:
            code = int(self.faults['drive'])
            sent += self._fail(code)
        objects = self.objects
        period = 1e-3 * objects.value(*canopen.HEARTBEAT_TIME)
        if period and now - self._heartbeat_at >= period:
            self._heartbeat_at = now
            sent.append(heartbeat(self.node_id, self.nmt))
        if self._is_status_due(now):
            self._status_at = now
            sent += self._status()
        if 'drive_unplug' in self.faults:
            return []
        return sent

    def _is_status_due(self, now: float) -> bool:
        """Return whether the timer of the status frame has run out."""
        if self._syncs_a_status or self.nmt != canopen.OPERATIONAL:
            return False
        timer = self.objects.value(canopen.TPDO_PARAMETERS, canopen.TPDO_EVENT_TIMER)
        period = 1e-3 * timer
        return period > 0.0 and now - self._status_at >= period

    def _command(self, command: int) -> list[can.Message]:
        """Follow an NMT command; only an operational node has its motor enabled."""
        if command in RESETS:
            return self.boot()
        self.nmt = STATES.get(command, self.nmt)
        if self.nmt != canopen.OPERATIONAL:
            self._disable()
        return []

    def _take(
        self,
        number: int,
        data: bytes,
        now: float,
    ) -> list[can.Message]:
        """
        Take a PDO, as it is mapped.

        Parameters
        ----------
        number : int
            Number of the RPDO, from 0 on.
        data : bytes
            Its data.
        now : float
            Time, s.

        Returns
        -------
        list of can.Message
            Emergencies that a controlword causes.

        """
        sent: list[can.Message] = []
        for entry in self.objects.mapped(canopen.RPDO_MAPPING + number):
            mapped = Mapped.of(entry)
            value = int.from_bytes(data[: mapped.length], 'little', signed=True)
            data = data[mapped.length :]
            key = mapped.key
            if key == cia402.CONTROLWORD:
                sent += self._controlword(value & 0xFFFF)
            elif key == cia402.TARGET_TORQUE:
                self._target = value
                self._torque_at = now
        return sent

    def _controlword(self, word: int) -> list[can.Message]:
        """Follow a controlword, one transition a frame."""
        # A rising edge.
        resets = word & ~self._control & cia402.FAULT_RESET
        self._control = word
        state = self.state
        if state is State.FAULT:
            return self._reset_fault() if resets else []
        command = word & 0x0F
        if command & 0x06 != 0x06:
            self._disable()
        elif command & 0x07 == cia402.SHUTDOWN:
            self.state = State.READY
        elif state is State.READY or command == cia402.SWITCH_ON:
            if state is not State.DISABLED:
                self.state = State.SWITCHED_ON
        elif state is State.SWITCHED_ON and self.objects.value(*cia402.MODE):
            self.state = State.ENABLED
        return []

    def _reset_fault(self) -> list[can.Message]:
        """End a fault whose cause is gone; return the emergency that says so."""
        if 'drive' in self.faults:
            return []
        self.state = State.DISABLED
        self._heat = 0.0
        ended = canopen.emcy(self.node_id, canopen.EMCY_ERROR_RESET, 0)
        return [ended]

    def _time_out(self, now: float) -> list[can.Message]:
        """Follow the abort option where torque frames or the master's heartbeat have stopped."""
        if 'drive_deaf' in self.faults:
            return []
        objects = self.objects
        sent = []
        timers = []
        for number in PDOS:
            parameters = canopen.RPDO_PARAMETERS + number
            timers.append(objects.value(parameters, canopen.TPDO_EVENT_TIMER))
        if _is_over(self._torque_at, max(timers), now):
            self._torque_at = None
            sent += self._abort(PDO_LOST)
        limit = objects.value(*cia402.HEARTBEAT_CONSUMER) & 0xFFFF
        if _is_over(self._master_at, limit, now):
            self._master_at = None
            sent += self._abort(HEARTBEAT_LOST)
            if not objects.value(*cia402.ERROR_BEHAVIOUR):
                self.nmt = canopen.PRE_OPERATIONAL
        return sent

    def _abort(self, code: int) -> list[can.Message]:
        """Follow the abort connection option (6007h); return the emergency with an error code."""
        option = self.objects.value(*cia402.ABORT_OPTION)
        if option == FAULT_ON_ABORT:
            return self._fail(code)
        if option == cia402.DISABLE_VOLTAGE_ON_ABORT:
            self._disable()
        return [self._error(code)]

    def _fail(self, code: int) -> list[can.Message]:
        """Enter the state Fault; return the emergency with an error code."""
        self.state = State.FAULT
        return [self._error(code)]

    def _error(self, code: int) -> can.Message:
        """Return EMCY with an error code."""
        return canopen.emcy(self.node_id, code, GENERIC_ERROR)

    def _disable(self) -> None:
        """Disable the voltage; a fault stays one."""
        if self.state is not State.FAULT:
            self.state = State.DISABLED

    def _heat_up(self, elapsed: float) -> list[can.Message]:
        """
        Count the heat of the motor, I2t.

        It grows with the square of the torque, and the heat of the rated torque is led away.

        Parameters
        ----------
        elapsed : float
            Time since the latest step, s.

        Returns
        -------
        list of can.Message
            The emergency, if it is too hot; empty otherwise.

        """
        share = self.torque / cia402.PER_MILLE
        above_rated = share * share - 1.0
        self._heat = max(0.0, self._heat + above_rated * elapsed)
        if self._heat > HEAT_LIMIT:
            return self._fail(TOO_HOT)
        return []

    def _status(self) -> list[can.Message]:
        """Return the status frame, as it is mapped."""
        objects = self.objects
        identifier = objects.value(canopen.TPDO_PARAMETERS, canopen.TPDO_IDENTIFIER)
        if identifier & canopen.TPDO_OFF:
            return []
        off = 0.01 * self.faults.get('drive_torque', 0.0)
        reported = self.torque * (1.0 + off)
        shown = {
            cia402.STATUSWORD: STATUSWORDS[self.state],
            cia402.TORQUE_ACTUAL: round(reported),
            cia402.MODE_DISPLAY: objects.value(*cia402.MODE),
        }
        data = b''
        for entry in objects.mapped(canopen.TPDO_MAPPING):
            mapped = Mapped.of(entry)
            every_bit = (1 << 8 * mapped.length) - 1
            value = shown.get(mapped.key, 0) & every_bit
            data += value.to_bytes(mapped.length, 'little')
        status = canopen.frame(identifier & canopen.TPDO_ID_MASK, data)
        return [status]


def _is_over(
    since: float | None,
    limit: int,
    now: float,
) -> bool:
    """Return whether a limit, ms, has passed since a time, s; 0 is no limit, None no time."""
    if not limit or since is None:
        return False
    return now - since > 1e-3 * limit


class SimulatedDrives:
    """
    Drives and their faults, which are timed from the first start of a node.

    Parameters
    ----------
    plan : Plan
        All drives on their bus.
    faults : tuple of Fault
        Faults; those of other joints are ignored.
    factory : bool
        Whether the drives are not set up yet.

    Attributes
    ----------
    drives : tuple of SimulatedDrive
        The drives, in the order of the motors.
    faults : Faults
        The faults, with those that are present.

    """

    def __init__(
        self,
        plan: Plan,
        faults: tuple[Fault, ...] = (),
        factory: bool = False,
    ):
        self.drives = tuple(SimulatedDrive(plan, own, factory) for own in plan.drives)
        known = range(len(self.drives))
        self.faults = Faults(fault for fault in faults if fault.joint in known)
        self._began: float | None = None

    def boot(self) -> list[can.Message]:
        """Switch the drives on, and return their boot-up messages."""
        sent = []
        for drive in self.drives:
            sent += drive.boot()
        return sent

    def receive(self, message: can.Message, now: float) -> list[can.Message]:
        """Return the answers to a frame that comes at a time, s."""
        if message.is_error_frame or message.is_remote_frame or message.is_extended_id:
            return []
        answers = []
        for drive in self.drives:
            answers += drive.receive(message, now)
        return answers

    def tend(self, now: float) -> list[can.Message]:
        """Let time go on to `now`, s; return the frames that are due."""
        is_operational = any(drive.nmt == canopen.OPERATIONAL for drive in self.drives)
        if self._began is None and is_operational:
            self._began = now
        if self._began is not None and self.faults.update(now - self._began):
            self._distribute_faults()
        sent = []
        for drive in self.drives:
            sent += drive.tend(now)
        return sent

    def _distribute_faults(self) -> None:
        """Give each drive its present faults."""
        for drive in self.drives:
            drive.faults = {}
        for fault in self.faults.present:
            if fault.joint is not None:
                self.drives[fault.joint].faults[fault.kind] = fault.value
