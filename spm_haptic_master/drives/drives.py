# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The drives of all motors on their bus: torques in, state out, one call a sample.

The start-up is a generator that each sample advances: read back, set the mode, prove that the
motors become free without this master.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import suppress
from functools import partial
from math import inf, isfinite
from pathlib import Path
from typing import NamedTuple

import can
from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import State
from spm_haptic_master.drives.drive import Drive, ENABLE_TIMEOUT, Handler, Steps
from spm_haptic_master.drives.passed_check import Identity, passed_check, PassedCheck, read_check
from spm_haptic_master.drives.plan import check_load, make_plan, Plan, torque_frames
from spm_haptic_master.encoders import can_bus, canopen
from spm_haptic_master.exceptions import SettingError, SetupError
from spm_haptic_master.parameters.setting import Values

# Time between two attempts to open the bus (s).
REOPEN = 1.0
# Largest number of frames read in one step; the rest waits for the next one.
FRAMES_AT_ONCE = 500
# Samples for which the reset of a fault is on, then off: drives act on its edge.
RESET_SAMPLES = 8
# Time in which a drive has to disable its motor after the last frame, against the configured one
# (unit 1): its own grid of time, and the frames on their way.
FALL_OUT_FACTOR = 2.0
# Time for which a drive is watched longer than that (s), so that its real time can be reported.
WATCHED = 0.3
# Number of proofs of which one has to be in time: this machine may be late itself.
PROOFS = 3
# States without torque, which a drive has to fall into.
WITHOUT_TORQUE = (State.DISABLED, State.READY, State.SWITCHED_ON, State.FAULT)


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
    ):
        self.plan = plan
        self._open_bus = open_bus
        self._name = name
        self._check: PassedCheck | None = None
        self._drives = tuple(Drive(own, plan, self._send) for own in plan.drives)
        self._handlers: dict[int, tuple[int, Handler]] = {
            identifier: handler
            for drive in self._drives
            for identifier, handler in drive.handlers.items()
        }
        self.motors = len(self._drives)
        self._bus: can.BusABC | None = None
        self._now = 0.0
        self._retry_at = -inf
        # The start-up; None after it. In it frames without torque go out if `_sends`, to enable
        # the operation if `_operate`, and faults are reset.
        self._start_up: Steps | None = self._start()
        self._sends = self._operate = False
        self._fault: str | None = None
        self._missing: str | None = None  # why the bus is not open
        # Whether the drives are read back: before, no torque frame goes out.
        self._known = False
        self._samples = 0
        self._heartbeat = canopen.frame(
            canopen.HEARTBEAT_BASE + plan.master_id, bytes((canopen.OPERATIONAL,))
        )
        self._sync = canopen.frame(canopen.SYNC_ID, b'')
        self._heartbeat_at = -inf
        self._sync_at = -inf
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
        if self._start_up is not None and self._starts(self._start_up):
            return self._report(False)
        self._look_for_faults(torques)
        is_ready = self._command(torques)
        return self._report(is_ready)

    def _command(self, torques: tuple[float, ...] | None) -> bool:
        """Send the torques of this sample, or none; return whether all drives make them."""
        operate = torques is not None and self._fault is None
        is_ready = operate and self._are_enabled()
        if self._known:
            self._send_torques(operate, torques if is_ready else None)
        if is_ready and self._fault is not None:
            # A frame was refused: the torque of the other drives ends with it.
            self._send_torques(False, None)
            return False
        return is_ready

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
            if self._fault:
                trouble = None
            else:
                trouble = drive.trouble(torques is not None)
            if trouble:
                self._fail(trouble)

    def acknowledge(self) -> None:
        """Clear a fault: the drives are read back, reset and proven again, before any torque."""
        if self._fault is None:
            return
        self._fault, self._start_up = None, self._start()
        self._known = self._sends = False
        for drive in self._drives:
            drive.clear()

    def close(self) -> None:
        """Send zero torque, then disable voltage, and close the bus for good."""
        if self._known:
            is_operating = self._fault is None and self._are_enabled()
            for operate in (is_operating, False):
                self._send_torques(operate, None)
        if self._bus is not None:
            self._close_bus(self._bus)
        self._retry_at = inf
        self._missing = f'{self._name}: closed'

    def _starts(self, start_up: Steps) -> bool:
        """
        Advance the start-up by one step.

        While it sends frames, all of them have zero torque.

        Parameters
        ----------
        start_up : generator
            The start-up.

        Returns
        -------
        bool
            Whether it continues; False if it has ended or failed.

        """
        try:
            next(start_up)
        except StopIteration:
            self._start_up = None
        except SetupError as error:
            self._fail(str(error))
        # It may have ended, or failed; a frame may have been refused.
        if self._start_up is None:
            return False
        if self._sends:
            self._known = True
            self._send_torques(self._operate, None, resets=True)
        return True

    def _start(self) -> Steps:
        """Read the drives back, set their modes, and prove that they fall out."""
        for drive in self._drives:
            yield from drive.read_back()
        self._compare_identities()
        for drive in self._drives:
            yield from drive.set_mode()
        yield from self._prove()
        yield from self._reach(State.DISABLED)

    def require(self, check: PassedCheck) -> None:
        """
        Give torque to the drives of a passed check alone; to be called before the first step.

        Parameters
        ----------
        check : PassedCheck
            Its drives are compared with the identities (1018h) that are read in each start-up.

        """
        self._check = check

    def _compare_identities(self) -> None:
        """
        Compare the drives with those of the passed check, if one is required.

        Raises
        ------
        SetupError
            Another drive answers with the node id of a checked one.

        """
        for index, drive in enumerate(self._drives):
            identity = drive.identity
            if self._check is not None and identity is not None:
                stranger = self._check.stranger(index, identity)
                if stranger is not None:
                    raise SetupError(f'{drive.own.name}: {stranger}')

    def passed_check(self, date: str) -> PassedCheck:
        """
        Return the check of these drives, to be written to a file.

        The drives must have been ready, so that their identities are known.

        Parameters
        ----------
        date : str
            Date and time at which it passed, as ISO 8601.

        """
        identities = [
            drive.identity
            or Identity(
                vendor=None,
                product=None,
                serial=None,
            )
            for drive in self._drives
        ]
        return passed_check(date, self.plan.drives, identities)

    def _prove(self) -> Steps:
        """
        Pause all frames at zero torque: each drive has to leave Operation enabled in time.

        One of PROOFS attempts has to be in time: within FALL_OUT_FACTOR times its configured
        time-out and a status period.

        Raises
        ------
        SetupError
            A drive stays enabled or leaves too late, has booted, or does not answer.

        """
        plan = self.plan
        limit = FALL_OUT_FACTOR * (
            (plan.event_timer or plan.heartbeat_timeout) + plan.status_period
        )
        for _ in range(PROOFS):
            yield from self._reach(State.DISABLED)
            yield from self._reach(State.ENABLED)
            self._sends = False
            times = yield from self._fall_out_times(limit + WATCHED)
            self._refuse_booted()
            drive, longest = max(times.items(), key=lambda item: item[1])
            if longest <= limit:
                return
        took = (
            'did not leave Operation enabled'
            if longest == inf
            else f'left Operation enabled after {1e3 * longest:.0f} ms'
        )
        raise SetupError(
            f'{drive.own.name} {took} without frames of this master; expected within '
            f'{1e3 * limit:.0f} ms by its event timer (0x1400:05), heartbeat (0x1016) and abort '
            'option (0x6007): no torque without that'
        )

    def _fall_out_times(self, longest: float) -> Generator[None, None, dict[Drive, float]]:
        """
        Return the time after which each drive is without torque.

        Parameters
        ----------
        longest : float
            Time for which they are watched, s.

        Returns
        -------
        dict of Drive to float
            Time in s; inf for a drive that is still enabled.

        """
        began = self._now
        times = dict.fromkeys(self._drives, inf)
        while self._now - began <= longest and inf in times.values():
            for drive in [each for each, time in times.items() if time == inf]:
                # By SDO: a drive that loses its heartbeat may end its status frames.
                word = yield from drive.read(cia402.STATUSWORD)
                if word is not None and cia402.state_of(word) in WITHOUT_TORQUE:
                    times[drive] = self._now - began
        return times

    def _reach(self, state: State) -> Steps:
        """
        Bring all drives into Operation enabled, or out of it, and reset their faults.

        Each must confirm it by a status frame of its own within ENABLE_TIMEOUT.

        Parameters
        ----------
        state : State
            ENABLED or DISABLED.

        Raises
        ------
        SetupError
            A drive is late, has booted, or deviates from its command.

        """
        if not self._sends:
            for drive in self._drives:
                self._send(canopen.nmt(canopen.NMT_START, drive.own.node_id))
        asked = self._now
        self._sends = True
        self._operate = state is State.ENABLED
        while True:
            self._refuse_booted()
            waiting = self._waiting(asked, state)
            if waiting and self._now - asked > ENABLE_TIMEOUT:
                raise SetupError(self._late(waiting[0], asked, state))
            if self._operate:
                self._refuse_deviations()
            if not waiting:
                break
            yield
        # What the pause has caused is over.
        for drive in self._drives:
            drive.clear()

    def _waiting(self, asked: float, state: State) -> list[Drive]:
        """Return the drives that have not reported a state since a time, s."""
        return [
            drive for drive in self._drives if drive.status_at <= asked or drive.state is not state
        ]

    def _late(
        self,
        drive: Drive,
        asked: float,
        state: State,
    ) -> str:
        """Return in words that a drive did not reach a state that was asked for at a time, s."""
        if drive.status_at <= asked:
            shown = 'no status frame'
        else:
            shown = drive.state.value
        cause = f' ({drive.emergency})' if drive.emergency else ''
        return (
            f'{drive.own.name}: {shown} {ENABLE_TIMEOUT:g} s after its start{cause}; expected '
            f'{state.value}'
        )

    def _refuse_booted(self) -> None:
        """Raise SetupError for a drive that has booted since it was read back."""
        for drive in self._drives:
            if drive.booted:
                raise SetupError(
                    f'{drive.own.name} booted during the start-up: its settings are lost'
                )

    def _refuse_deviations(self) -> None:
        """Raise SetupError for another mode or torque on the way to Operation enabled."""
        for drive in self._drives:
            found = drive.refusal(operate=True)
            if found:
                raise SetupError(f'{drive.own.name}: {found}')

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

    def _send_torques(
        self,
        operate: bool,
        torques: tuple[float, ...] | None,
        resets: bool = False,
    ) -> None:
        """
        Send torques with the controlword of each drive's next transition.

        The heartbeat of this master and SYNC go out with them, if due.

        Parameters
        ----------
        operate : bool
            Whether Operation enabled is the goal of the controlwords.
        torques : tuple of N float, or None
            Torques at the joints, N m; None for zero.
        resets : bool
            Whether faults are reset; the bit toggles, as drives act on its edge.

        """
        words = []
        values = []
        for index, drive in enumerate(self._drives):
            word = cia402.controlword(drive.state, operate)
            if resets and drive.state is State.FAULT and self._samples & RESET_SAMPLES:
                word = cia402.FAULT_RESET
            if torques is None:
                value = 0
            else:
                value = drive.own.per_mille(torques[index])
            drive.command(value)
            words.append(word)
            values.append(value)
        due = self._now - self._heartbeat_at >= self.plan.heartbeat
        if due:
            self._heartbeat_at = self._now
            self._send(self._heartbeat)
        self._send_sync()
        for identifier, data in torque_frames(
            plan=self.plan,
            controlwords=words,
            torques=values,
            controls=due or words != self._controlwords,
        ):
            self._send(canopen.frame(identifier, data))
        self._controlwords = words

    def _send_sync(self) -> None:
        """Ask for the status frames, where the drives send them on SYNC of this master."""
        if self.plan.sends_sync and self._now - self._sync_at >= self.plan.status_period:
            self._sync_at = self._now
            self._send(self._sync)

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


def make_drives(values: Values) -> Drives | None:
    """
    Return the drives by checked settings; the first step opens their bus.

    Parameters
    ----------
    values : Values
        Checked values of DRIVE_SETTINGS, and `rate`.

    Returns
    -------
    Drives or None
        None without `drives.channel`.

    Raises
    ------
    SettingError
        Settings contradict each other, or the drives have not passed a force_check.
    InputError
        The file of the check cannot be read.

    """
    drives = make_unchecked_drives(values)
    if drives is not None:
        drives.require(_check_of(values, drives.plan))
    return drives


def make_unchecked_drives(values: Values) -> Drives | None:
    """
    Return the drives as `make_drives` does, for the force_check that is still due.

    Parameters
    ----------
    values : Values
        Checked values of DRIVE_SETTINGS, and `rate`.

    Returns
    -------
    Drives or None
        None without `drives.channel`.

    Raises
    ------
    SettingError
        Settings contradict each other, or the bus cannot carry the frames.

    """
    interface = values['drives.interface']
    channel = values['drives.channel']
    bitrate = values['drives.bitrate']
    if not channel:
        return None
    can_bus.check_interface(interface, 'drives.interface')
    plan = make_plan(values)
    check_load(plan, bitrate)
    return Drives(
        plan,
        partial(can_bus.open_bus, interface, channel, bitrate),
        can_bus.bus_name(interface, channel),
    )


def _check_of(values: Values, plan: Plan) -> PassedCheck:
    """
    Return the passed check of the configured drives.

    Raises
    ------
    SettingError
        No file is given, or it is that of other drives.
    InputError
        The file cannot be read.

    """
    path = values['drives.check_file']
    if not path:
        raise SettingError(
            name='drives.check_file',
            value=path,
            expected=(
                'the file that force_check --record --output has written for these drives: no '
                'torque without a passed check'
            ),
        )
    check = read_check(Path(path))
    difference = check.difference(plan.drives)
    if difference is not None:
        raise SettingError(
            name='drives.check_file',
            value=path,
            expected=f'a check of these drives ({difference})',
        )
    return check
