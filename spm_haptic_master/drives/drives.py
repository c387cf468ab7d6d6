# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The drives of all motors on their bus: torques in, state out, one call a sample.

The first samples advance the start-up; a fault is latched, and no torque follows it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from math import inf, isfinite
from typing import NamedTuple

import can
from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import State
from spm_haptic_master.drives.drive import Drive, Handler
from spm_haptic_master.drives.passed_check import Identity, passed_check, PassedCheck
from spm_haptic_master.drives.plan import Plan, torque_frames
from spm_haptic_master.drives.start_up import StartUp
from spm_haptic_master.encoders import can_bus, canopen
from spm_haptic_master.exceptions import SetupError
from spm_haptic_master.timing import Periodic

# Time between two attempts to open the bus (s).
REOPEN = 1.0
# Largest number of frames read in one step; the rest waits for the next one.
FRAMES_AT_ONCE = 500
# Samples for which the reset of a fault is on, then off: drives act on its edge.
RESET_SAMPLES = 8


class DriveReport(NamedTuple):
    """
    What the drives report after a sample.

    Attributes
    ----------
    ready : bool
        Whether all are in Operation enabled, and proven to fall out of it without this master.
    fault : str or None
        Why there is no torque. A fault is latched until `acknowledge`; a bus that is not open, or
        a drive that is waited for, ends by itself.
    torques : tuple of N float
        Torques that the drives report, N m at the joints, in the order of the motors.
    seconds_since_status : float
        Age of the status frame of the drive that has been silent for longest, s; inf before the
        first.

    """

    ready: bool
    fault: str | None
    torques: tuple[float, ...]
    seconds_since_status: float


class Drives:
    """
    Drives by CiA 402 over CANopen; never blocks.

    Each step of the first samples takes the start-up further: read back, mode, proof. Every fault
    of one drive is zero torque of all in the same step.

    Parameters
    ----------
    plan : Plan
        What is configured.
    open_bus : callable
        Returns an open bus, or raises one of `BUS_ERRORS`.
    name : str
        Name of the bus in texts.
    check : PassedCheck or None
        Check whose drives alone get torque; None for the one that is still due.

    Attributes
    ----------
    plan : Plan
        As given.
    motors : int
        Number of drives.

    """

    def __init__(
        self,
        plan: Plan,
        open_bus: Callable[[], can.BusABC],
        name: str,
        check: PassedCheck | None,
    ):
        self.plan = plan
        self._open_bus = open_bus
        self._name = name
        self._check = check
        self._drives = tuple(Drive(own, plan, self._send) for own in plan.drives)
        self._handlers: dict[int, tuple[int, Handler]] = {
            identifier: handler
            for drive in self._drives
            for identifier, handler in drive.handlers.items()
        }
        self._handlers[canopen.HEARTBEAT_BASE + plan.master_id] = (
            canopen.HEARTBEAT_LENGTH,
            self._on_master,
        )
        self.motors = len(self._drives)
        self._bus: can.BusABC | None = None
        self._now = 0.0
        self._retry_at = -inf
        self._start_up: StartUp | None = self._new_start_up()  # None after it
        self._fault: str | None = None
        self._missing: str | None = None  # why the bus is not open
        self._samples = 0
        self._heartbeat = canopen.frame(
            canopen.HEARTBEAT_BASE + plan.master_id, bytes((canopen.OPERATIONAL,))
        )
        self._heartbeats = Periodic(plan.heartbeat)
        self._sync = canopen.frame(canopen.SYNC_ID, b'')
        self._syncs = Periodic(plan.status_period)
        # The latest ones; empty until a start-up has read the drives back: no frame goes out then.
        self._controlwords: list[int] = []

    def step(self, torques: tuple[float, ...] | None, now: float) -> DriveReport:
        """
        Read what the drives have sent, and send their torques.

        Parameters
        ----------
        torques : tuple of N float, or None
            Torques at the joints, N m; each is limited to `drives.torque_limit`. None: the motors
            are to be without voltage. Zeros: Operation enabled without torque.
        now : float
            Time, s; it only increases.

        Returns
        -------
        DriveReport
            States and torques after the frames that were waiting.

        """
        self._set_time(now)
        bus = self._bus or self._open()
        if bus is None:
            return self._report(False)
        self._samples += 1
        self._receive(bus)
        if self._start_up is not None and self._continues(self._start_up):
            return self._report(False)
        self._look_for_faults(torques)
        is_ready = bool(self._controlwords) and self._command(torques)
        return self._report(is_ready)

    def _command(self, torques: tuple[float, ...] | None) -> bool:
        """Send the torques of this sample, or zero; return whether all drives make them."""
        if torques is None or self._fault is not None:
            self._send_zero(operate=False)
            return False
        if not self._are_enabled():
            self._send_zero(operate=True)
            return False
        self._send_torques(torques, operate=True)
        if self._fault is not None:
            # A frame was refused: the torque of the other drives ends with it.
            self._send_zero(operate=False)
        return self._fault is None

    def _set_time(self, now: float) -> None:
        """Give all drives the time of this sample, s."""
        self._now = now
        for drive in self._drives:
            drive.now = now

    def _are_enabled(self) -> bool:
        """Return whether all drives report Operation enabled."""
        return all(drive.state is State.ENABLED for drive in self._drives)

    def _look_for_faults(self, torques: tuple[float, ...] | None) -> None:
        """Latch what is wrong with the torques or with a drive: the first fault found."""
        if torques is not None and not isfinite(sum(torques)):
            self._fail(f'torques {torques} N m; expected finite ones')
        for drive in self._drives:
            # All of them are asked: each notes since when it is to operate.
            fault = drive.fault(operate=torques is not None)
            if fault:
                self._fail(fault)

    def acknowledge(self) -> None:
        """Clear a fault: the drives are read back, reset and proven again, before any torque."""
        if self._fault is None:
            return
        self._fault = None
        self._start_up = self._new_start_up()
        self._controlwords = []
        for drive in self._drives:
            drive.clear()

    def close(self) -> None:
        """Send zero torque, then disable voltage, and close the bus for good."""
        if self._controlwords:
            self._send_zero(operate=self._fault is None and self._are_enabled())
            self._send_zero(operate=False)
        if self._bus is not None:
            self._close_bus(self._bus)
        self._retry_at = inf
        self._missing = f'{self._name}: closed'

    def _new_start_up(self) -> StartUp:
        """Return a start-up from its beginning."""
        return StartUp(
            plan=self.plan,
            drives=self._drives,
            check=self._check,
            send=self._send,
        )

    def _continues(self, start_up: StartUp) -> bool:
        """Advance the start-up, with zero torque; return False if it has ended or failed."""
        try:
            if not start_up.step():
                self._start_up = None
        except SetupError as error:
            self._fail(str(error))
        # A frame may have been refused.
        if self._start_up is None:
            return False
        if start_up.goal is not None:
            self._send_zero(operate=start_up.goal is State.ENABLED, resets=True)
        return True

    def passed_check(self, date: str) -> PassedCheck:
        """
        Return the check of these drives, to be written to a file.

        The drives must have been ready, so that their identities are known.

        Parameters
        ----------
        date : str
            Date and time at which it passed, as ISO 8601.

        """
        identities = [drive.identity or Identity() for drive in self._drives]
        return passed_check(date, self.plan.drives, identities)

    def _fail(self, text: str) -> None:
        """Latch a fault: the first one is the reason for those that follow. The start-up ends."""
        if self._fault is None:
            self._fault = text
        self._start_up = None

    def _report(self, ready: bool) -> DriveReport:
        """Return the report of this sample, with the reported torques in N m at the joints."""
        absent = next((drive.absent for drive in self._drives if drive.absent), None)
        return DriveReport(
            ready=ready,
            fault=self._fault or self._missing or absent,
            torques=tuple(drive.torque / drive.own.scale for drive in self._drives),
            seconds_since_status=max(self._now - drive.status_at for drive in self._drives),
        )

    def _receive(self, bus: can.BusABC) -> None:
        """
        Give all waiting frames, up to FRAMES_AT_ONCE, to the drives.

        Frames of another length, and those that are extended, remote or error frames, are ignored.
        An error of the bus is a fault, and closes the bus.
        """
        try:
            for _ in range(FRAMES_AT_ONCE):
                message = bus.recv(0.0)
                if message is None:
                    return
                handler = self._handlers.get(message.arbitration_id)
                if (
                    handler is not None
                    and len(message.data) == handler[0]
                    and not (
                        message.is_extended_id or message.is_error_frame or message.is_remote_frame
                    )
                ):
                    handler[1](message.data)
        except can_bus.BUS_ERRORS as error:
            self._fail(f'{self._name}: {can_bus.first_line(error)}')
            self._retry_at = self._now + REOPEN
            self._close_bus(bus)

    def _on_master(self, _: bytearray) -> None:
        """Pass a heartbeat of this master to the start-up, which has not sent any yet."""
        if self._start_up is not None:
            self._start_up.note_master()

    def _send_zero(self, operate: bool, resets: bool = False) -> None:
        """Send zero torque to all drives, as `_send_torques`."""
        self._send_torques((0.0,) * self.motors, operate, resets)

    def _send_torques(
        self,
        torques: tuple[float, ...],
        operate: bool,
        resets: bool = False,
    ) -> None:
        """
        Send torques with the controlword of each drive's next transition.

        The heartbeat of this master and SYNC go out with them, if due.

        Parameters
        ----------
        torques : tuple of N float
            Torques at the joints, N m.
        operate : bool
            Whether Operation enabled is the goal of the controlwords.
        resets : bool
            Whether faults are reset; the bit toggles, as drives act on its edge.

        """
        words = []
        values = []
        for drive, torque in zip(self._drives, torques, strict=True):
            word = cia402.controlword(drive.state, operate)
            if resets and drive.state is State.FAULT and self._samples & RESET_SAMPLES:
                word = cia402.FAULT_RESET
            value = drive.own.per_mille(torque)
            drive.torques.command(value)
            words.append(word)
            values.append(value)
        is_heartbeat_due = self._heartbeats.is_due(self._now)
        if is_heartbeat_due:
            self._send(self._heartbeat)
        if self.plan.sends_sync and self._syncs.is_due(self._now):
            self._send(self._sync)
        for identifier, data in torque_frames(
            plan=self.plan,
            controlwords=words,
            torques=values,
            controls=is_heartbeat_due or words != self._controlwords,
        ):
            self._send(canopen.frame(identifier, data))
        self._controlwords = words

    def _send(self, message: can.Message) -> None:
        """Send a frame without waiting; a refusal is a fault."""
        if self._bus is None:
            return
        try:
            self._bus.send(message, 0.0)
        except can_bus.BUS_ERRORS as error:
            self._fail(
                f'{self._name}: frame 0x{message.arbitration_id:X} not sent: '
                f'{can_bus.first_line(error)}'
            )

    def _open(self) -> can.BusABC | None:
        """Open the bus, at most once in REOPEN; return it, or None with the reason kept."""
        if self._now < self._retry_at:
            return None
        self._retry_at = self._now + REOPEN
        try:
            self._bus = self._open_bus()
        except can_bus.BUS_ERRORS as error:
            self._missing = f'{self._name}: {can_bus.first_line(error)}'
            return None
        self._missing = None
        return self._bus

    def _close_bus(self, bus: can.BusABC) -> None:
        """Close the bus; the next step opens it again."""
        self._bus = None
        with suppress(*can_bus.BUS_ERRORS):  # the failure that closes it is already reported
            bus.shutdown()
