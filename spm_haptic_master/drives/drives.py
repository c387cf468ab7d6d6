# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The drives of all motors on their bus: torques in, state out, one call a sample."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import NamedTuple

import can
from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import State
from spm_haptic_master.drives.drive import Drive, Handler
from spm_haptic_master.drives.plan import check_load, make_plan, Plan, torque_frames
from spm_haptic_master.drives.start_up import StartUp
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_errors import BUS_ERRORS, bus_name, first_line
from spm_haptic_master.encoders.can_source import check_interface, open_bus
from spm_haptic_master.exceptions import SetupError
from spm_haptic_master.parameters.setting import Values

# Time between two attempts to open the bus (s).
REOPEN = 1.0
# Most frames read in one step: what waits beyond them is read in the next.
FRAMES_AT_ONCE = 500
# Samples for which the reset of a fault is on, and off again: it counts by its edge.
RESET_SAMPLES = 8


class DriveReport(NamedTuple):
    """What the drives report."""

    ready: bool  # all in Operation enabled, and proven to fall out
    fault: str | None  # why there is no torque, until `acknowledge`
    torques: tuple[float, ...]  # reported, N m at the joints
    seconds_since_status: float  # of the oldest latest status frame; inf: none


class Drives:
    """
    Drives by CiA 402 over CANopen; never blocks.

    Each step of the first samples takes the start-up further: read back, mode, proof. Every fault
    of one drive is zero torque of all in the same step. `open_bus` returns an open bus, or raises
    one of BUS_ERRORS; `name` is that of the bus in texts.
    """

    def __init__(self, plan: Plan, open_bus: Callable[[], can.BusABC], name: str):
        self._plan, self._open_bus, self._name = plan, open_bus, name
        self._drives = tuple(Drive(own, plan) for own in plan.drives)
        self._handlers: dict[int, tuple[int, Handler]] = {
            identifier: handler for drive in self._drives
            for identifier, handler in drive.handlers().items()}
        self._bus: can.BusABC | None = None
        self._retry_at = float('-inf')
        self._start_up: StartUp | None = StartUp(plan, self._drives, self._send)
        self._fault: str | None = None
        # Why the bus is not open.
        self._missing: str | None = None
        # Whether the drives are read back: before, no torque frame goes out.
        self._known = False
        self._samples = 0
        self._heartbeat = canopen.frame(canopen.HEARTBEAT_BASE + plan.master_id,
                                        bytes((canopen.OPERATIONAL,)))
        self._heartbeat_at = float('-inf')
        self._controlwords: list[int] = []

    @property
    def motors(self) -> int:
        """Return the number of drives: of torques that `step` takes."""
        return len(self._drives)

    def step(self, torques: tuple[float, ...] | None, now: float) -> DriveReport:
        """
        Read what the drives have sent, and send their torques; `now` only increases, s.

        `torques` are those at the joints, N m, each limited to `drives.torque_limit`. None: the
        motors are to be without voltage. Zeros: Operation enabled without torque.
        """
        bus = self._bus or self._open(now)
        if bus is None:
            return self._report(False, now)
        self._samples += 1
        self._receive(bus, now)
        if self._start_up is not None and self._starts(self._start_up, now):
            return self._report(False, now)
        if torques is not None and not isfinite(sum(torques)):
            self._fail(f'torques {torques} N m; expected finite ones')
        for drive in self._drives:
            if self._fault is None and (trouble := drive.trouble(now, torques is not None)):
                self._fail(trouble)
        operate = torques is not None and self._fault is None
        ready = operate and all(drive.state is State.ENABLED for drive in self._drives)
        if self._known:
            self._send_torques(operate, torques if ready else None, now)
        # A frame may have been refused.
        return self._report(ready and self._fault is None, now)

    def acknowledge(self) -> None:
        """Clear a fault: the drives are read back, reset and proven again, before any torque."""
        if self._fault is None:
            return
        self._fault, self._known = None, False
        for drive in self._drives:
            drive.restart()
        self._start_up = StartUp(self._plan, self._drives, self._send)

    def close(self) -> None:
        """Send zero torque, then disable voltage, and close the bus."""
        if self._bus is None:
            return
        if self._known:
            for operate in (True, False):
                self._send_torques(operate, None, self._heartbeat_at)
        self._close_bus()

    def _starts(self, start_up: StartUp, now: float) -> bool:
        """Take the start-up one step further; return whether it goes on."""
        try:
            done = start_up.advance(now)
        except SetupError as error:
            self._fail(str(error))
            return False
        # A frame may have been refused.
        if done or self._fault is not None:
            self._start_up = None
            return False
        if start_up.sends:
            self._known = True
            self._send_torques(start_up.operate, None, now, resets=True)
        return True

    def _fail(self, text: str) -> None:
        """Latch a fault: the first one is the reason of those that follow."""
        if self._fault is None:
            self._fault = text
        self._start_up = None

    def _report(self, ready: bool, now: float) -> DriveReport:
        fault = self._fault or self._missing
        if fault is None and self._start_up is not None:
            fault = self._start_up.waits
        return DriveReport(
            ready, fault, tuple(drive.torque / drive.own.scale for drive in self._drives),
            max(now - drive.status_at for drive in self._drives))

    def _receive(self, bus: can.BusABC, now: float) -> None:
        """Take all frames that wait."""
        try:
            for _ in range(FRAMES_AT_ONCE):
                message = bus.recv(0.0)
                if message is None:
                    return
                handler = self._handlers.get(message.arbitration_id)
                if handler is not None and len(message.data) == handler[0] \
                        and not (message.is_extended_id or message.is_error_frame
                                 or message.is_remote_frame):
                    handler[1](message.data, now)
        except BUS_ERRORS as error:
            self._lose_bus(error, now)

    def _send_torques(self, operate: bool, torques: tuple[float, ...] | None, now: float,
                      resets: bool = False) -> None:
        """Send torques, zero for None, with the controlword of each drive's next transition."""
        words, values = [], []
        for index, drive in enumerate(self._drives):
            word = cia402.controlword(drive.state, operate)
            if resets and drive.state is State.FAULT and self._samples & RESET_SAMPLES:
                word = cia402.FAULT_RESET
            value = 0 if torques is None else drive.own.per_mille(torques[index])
            drive.command(value)
            words.append(word)
            values.append(value)
        due = now - self._heartbeat_at >= self._plan.heartbeat
        if due:
            self._heartbeat_at = now
            self._send(self._heartbeat)
        for identifier, data in torque_frames(self._plan, words, values,
                                              due or words != self._controlwords):
            self._send(canopen.frame(identifier, data))
        self._controlwords = words

    def _send(self, message: can.Message) -> None:
        """Send a frame without waiting; a refusal is a fault."""
        if self._bus is None:
            return
        try:
            self._bus.send(message, 0.0)
        except BUS_ERRORS as error:
            self._fail(f'{self._name}: frame 0x{message.arbitration_id:X} not sent: '
                       f'{first_line(error)}')

    def _open(self, now: float) -> can.BusABC | None:
        if now < self._retry_at:
            return None
        self._retry_at = now + REOPEN
        try:
            self._bus = self._open_bus()
        except BUS_ERRORS as error:
            self._missing = f'{self._name}: {first_line(error)}'
            return None
        self._missing = None
        return self._bus

    def _lose_bus(self, error: Exception, now: float) -> None:
        self._fail(f'{self._name}: {first_line(error)}')
        self._retry_at = now + REOPEN
        self._close_bus()

    def _close_bus(self) -> None:
        if self._bus is not None:
            try:
                self._bus.shutdown()
            except BUS_ERRORS:
                pass  # the failure that closes it is already reported
            self._bus = None


def make_drives(values: Values) -> Drives | None:
    """
    Return the drives of checked values of DRIVE_SETTINGS and `rate`; None without a channel.

    The bus is not opened before the first step. SettingError: settings contradict each other,
    python-can has no such interface, or the bus cannot carry the frames.
    """
    interface, channel = values['drives.interface'], values['drives.channel']
    if not channel:
        return None
    check_interface(interface, 'drives.interface')
    plan, bitrate = make_plan(values), values['drives.bitrate']
    check_load(plan, bitrate)
    return Drives(plan, partial(open_bus, interface, channel, bitrate),
                  bus_name(interface, channel))
