# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One drive as its frames show it, and the requests that set it up; without bus and clock.

`Drives` passes the frames and the time to it; it returns states, and reasons for no torque.
"""

from __future__ import annotations

from collections.abc import Callable, Generator

import can
from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import mode_words, State, state_of
from spm_haptic_master.drives.drive_objects import drive_objects
from spm_haptic_master.drives.passed_check import Identity
from spm_haptic_master.drives.plan import DrivePlan, Plan, STATUS
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.node_setup import Comparison, Key
from spm_haptic_master.exceptions import SetupError

# Deviation of the torque from its command (share of it) that is a fault if it lasts (s). Below a
# quarter of the cap friction and noise of the drive are larger than such a share.
TORQUE_SHARE = 0.2
TORQUE_FLOOR = 0.25
TORQUE_TIME = 0.05
# Time from the request for Operation enabled to it (s).
ENABLE_TIMEOUT = 2.0
# Longest wait for the answer to a request by SDO (s), and number of requests.
ANSWER_TIMEOUT = 0.2
REQUESTS = 3

# Takes the data of a frame.
Handler = Callable[[bytearray], None]
# Steps, each of which waits for the next sample.
Steps = Generator[None, None, None]


class Drive:
    """
    State of one drive: what it has sent, what it was commanded, and what is wrong with it.

    Parameters
    ----------
    own : DrivePlan
        Its configuration.
    plan : Plan
        All drives on their bus.
    send : callable
        Sends one frame; used for requests by SDO.

    Attributes
    ----------
    own : DrivePlan
        As given.
    now : float
        Time of the present sample, s; the caller sets it before each step.
    state : State
        State of the latest statusword.
    torque : int
        Torque that the drive reports (6077h), per mille of the rated torque.
    status_at : float
        Time of the latest status frame, s; -inf before the first.
    mode : int or None
        Mode of operation that it was set to; None before.
    identity : Identity or None
        Identity object (1018h); None before it was read.
    absent : str or None
        Why the start-up waits for the drive; None if it does not.
    emergency : str or None
        Latest EMCY in words, until `clear`.
    booted : bool
        Whether it has booted since it was read back: its settings may be lost.
    handlers : dict of int to (int, callable)
        Data length and handler of each of its frames, by identifier.

    """

    def __init__(
        self,
        own: DrivePlan,
        plan: Plan,
        send: Callable[[can.Message], None],
    ):
        self.own = own
        self._plan = plan
        self._send = send
        self.now = 0.0
        self.state = State.UNKNOWN
        self.torque = 0
        self.status_at = float('-inf')
        self.mode: int | None = None
        self.identity: Identity | None = None
        self.absent: str | None = None
        self._answer: bytes | None = None  # latest one by SDO, until it is removed
        self.emergency: str | None = None
        self._shown_mode = 0
        # NMT state, None before the first heartbeat, and the time from which one is due, s.
        self._nmt: int | None = None
        self._heartbeat_at = float('-inf')
        self.booted = False
        # Command in force, and the range of the commands since the latest status frame and between
        # that one and the one before, per mille: a status frame may be as old as two periods.
        self._command = 0
        self._range = self._before = (0, 0)
        # Time for which the torque was off its command, less that for which it followed, s.
        self._off_time = 0.0
        # Time since which Operation enabled is wanted, s, and whether it was reached since then.
        self._wanted_since: float | None = None
        self._reached = False
        self.handlers: dict[int, tuple[int, Handler]] = {
            own.status_id: (STATUS.size, self._on_status),
            canopen.HEARTBEAT_BASE + own.node_id: (canopen.HEARTBEAT_LENGTH, self._on_heartbeat),
            canopen.EMCY_BASE + own.node_id: (canopen.EMCY_LENGTH, self._on_emergency),
            canopen.SDO_ANSWER_BASE + own.node_id: (canopen.SDO_LENGTH, self._on_answer),
        }

    def clear(self) -> None:
        """Forget what an acknowledgement or the proof ends; from now on a heartbeat is due."""
        self._heartbeat_at = self.now
        self.emergency = self.absent = self._wanted_since = None
        self._off_time = 0.0

    def command(self, torque: int) -> None:
        """
        Note a torque that is sent, to compare it with the torque that is reported.

        Parameters
        ----------
        torque : int
            Commanded torque (6071h), per mille of the rated torque.

        """
        self._command = torque
        low, high = self._range
        self._range = min(low, torque), max(high, torque)

    def trouble(self, operate: bool) -> str | None:
        """
        Return what is wrong with the drive.

        Parameters
        ----------
        operate : bool
            Whether Operation enabled is wanted.

        Returns
        -------
        str or None
            The reason for no torque, with the drive's name; None if nothing is wrong.

        """
        if found := self._silence() or self.refusal(operate):
            return f'{self.own.name}: {found}'
        return None

    def _silence(self) -> str | None:
        """
        Return what the drive reports of itself, or what it does not send; None if nothing.

        In this order: an emergency, a fault state, a boot-up, a missing heartbeat, an NMT state
        other than operational, a missing status frame.
        """
        plan = self._plan
        silent = self.now - self.status_at
        unheard = self.now - self._heartbeat_at
        if self.emergency:
            return self.emergency
        if self.state in (State.FAULT, State.REACTING):
            return str(self.state.value)
        if self.booted:
            return 'booted: its settings are lost'
        if unheard > plan.heartbeat_timeout:
            return f'no heartbeat for {1e3 * unheard:.0f} ms'
        if self._nmt not in (None, canopen.OPERATIONAL):
            return f'NMT state {canopen.state_word(self._nmt or 0)}'
        if silent > plan.status_timeout:
            return f'no status frame for {1e3 * silent:.0f} ms'
        return None

    def refusal(self, operate: bool) -> str | None:
        """
        Return how the drive deviates from its command.

        It deviates if it leaves Operation enabled or does not reach it within ENABLE_TIMEOUT, if
        it shows another mode than it was set to, or if its torque is off its command for more than
        TORQUE_TIME.

        Parameters
        ----------
        operate : bool
            Whether Operation enabled is wanted.

        Returns
        -------
        str or None
            The deviation in words; None if the drive follows.

        """
        if not operate:
            self._wanted_since = None
        elif self._wanted_since is None:
            self._wanted_since = self.now
            self._reached = False
        if self._wanted_since is not None:
            if self.state is State.ENABLED:
                self._reached = True
                if self._shown_mode != self.mode:
                    return (
                        f'mode of operation {mode_words(self._shown_mode)}; expected '
                        f'{mode_words(self.mode or 0)}'
                    )
            elif self._reached:
                return f'left Operation enabled ({self.state.value})'
            elif self.now - self._wanted_since > ENABLE_TIMEOUT:
                return (
                    f'{self.state.value} {ENABLE_TIMEOUT:g} s after Operation enabled was '
                    'asked for'
                )
        if self._off_time > TORQUE_TIME:
            return (
                f'torque {self.torque} per mille for a command of {self._command}, off by '
                f'more than {100.0 * TORQUE_SHARE:.0f} % for {1e3 * self._off_time:.0f} ms'
            )
        return None

    def _on_status(self, data: bytearray) -> None:
        """
        Note a status frame: state, torque and mode, and how long the torque was off its command.

        The reported torque may lie anywhere in the range of the commands since the status frame
        before the last, widened by TORQUE_SHARE.
        """
        word, self.torque, self._shown_mode = STATUS.unpack(data)
        self.state = state_of(word)
        elapsed = min(self.now - self.status_at, self._plan.status_timeout)
        self.status_at = self.now
        low = min(self._range[0], self._before[0])
        high = max(self._range[1], self._before[1])
        self._before = self._range
        self._range = (self._command, self._command)
        allowed = TORQUE_SHARE * max(abs(low), abs(high), TORQUE_FLOOR * self.own.cap)
        # A torque that only crosses its command now and then does not follow it.
        follows = low - allowed <= self.torque <= high + allowed
        self._off_time = max(0.0, self._off_time + (-elapsed if follows else elapsed))

    def _on_heartbeat(self, data: bytearray) -> None:
        """Note the NMT state of a heartbeat, and whether the drive has booted."""
        self._nmt = data[0] & 0x7F
        self._heartbeat_at = self.now
        if self._nmt == canopen.BOOT_UP:
            self.booted = True

    def _on_emergency(self, data: bytearray) -> None:
        """Note an EMCY; an error reset does not clear the one before it."""
        # Its reset may come with it in one sample: it ends by an acknowledgement.
        if canopen.emcy_code(data) != canopen.EMCY_ERROR_RESET:
            self.emergency = canopen.emcy_words(data, cia402.ERROR_WORDS)

    def _on_answer(self, data: bytearray) -> None:
        """Keep the answer to a request by SDO until it is read."""
        self._answer = bytes(data)

    # Start-up: SetupError where the drive is not as configured -----------------------------------

    def read_back(self) -> Steps:
        """
        Compare all objects with their required values; wait for a drive that is off.

        Yields
        ------
        None
            Once a sample, until the answer to a request is there.

        Raises
        ------
        SetupError
            The node is no drive of CiA 402, or an object differs from its required value.

        """
        while True:
            try:
                profile = yield from self.read(canopen.DEVICE_TYPE)
                break
            except SetupError as error:
                self.absent = str(error)
        self.absent = None
        self.booted = False
        if profile is None or profile & 0xFFFF != canopen.DRIVE_PROFILE:
            shown = 'none' if profile is None else f'0x{profile:08X}'
            raise SetupError(
                f'{self.own.name}: device type {shown}; expected a drive (profile '
                f'{canopen.DRIVE_PROFILE})'
            )
        self.identity = yield from self._read_identity()
        wanted = drive_objects(self._plan, self.own)
        values: dict[Key, int | None] = {}
        for expected in wanted.every:
            values[expected.key] = yield from self.read(expected.key)
        comparison = Comparison(wanted, values)
        if comparison.different:
            differences = '; '.join(comparison.hinted)
            raise SetupError(f'{self.own.name}: {differences} (can_setup --drives --write)')

    def _read_identity(self) -> Generator[None, None, Identity]:
        """Read vendor id, product code and serial number (1018h); None for a missing one."""
        vendor = yield from self.read(canopen.VENDOR_ID)
        product = yield from self.read(canopen.PRODUCT_CODE)
        serial = yield from self.read(canopen.SERIAL_NUMBER)
        return Identity(vendor=vendor, product=product, serial=serial)

    def set_mode(self) -> Steps:
        """
        Set the mode of operation (6060h): the configured one, or the first that the drive has.

        Without a configured mode, cyclic synchronous torque is tried before profile torque, each
        only if 6502h lists it.

        Yields
        ------
        None
            Once a sample, until the answer to a request is there.

        Raises
        ------
        SetupError
            The drive accepts no mode of torque, or does not answer.

        """
        modes = [self._plan.mode]
        if not self._plan.mode:
            modes = [cia402.CYCLIC_TORQUE, cia402.PROFILE_TORQUE]
            supported = yield from self.read(cia402.SUPPORTED_MODES)
            if supported is not None:
                modes = [mode for mode in modes if supported >> (mode - 1) & 1]
        for mode in modes:
            answer = yield from self._request(
                canopen.sdo_write(self.own.node_id, *cia402.MODE, mode, 1), cia402.MODE
            )
            if answer[0] == canopen.SDO_DOWNLOAD_ANSWER:
                self.mode = mode
                return
        raise SetupError(
            f'{self.own.name}: no mode of operation 0x6060 of torque; expected '
            f'{mode_words(cia402.CYCLIC_TORQUE)} or '
            f'{mode_words(cia402.PROFILE_TORQUE)}'
        )

    def read(self, key: tuple[int, int]) -> Generator[None, None, int | None]:
        """
        Return the value of an object by SDO upload.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.

        Yields
        ------
        None
            Once a sample, until the answer is there.

        Returns
        -------
        int or None
            The value; None if the drive does not give it.

        Raises
        ------
        SetupError
            The drive does not answer.

        """
        answer = yield from self._request(canopen.sdo_upload(self.own.node_id, *key), key)
        return canopen.sdo_value(answer)

    def _request(self, message: can.Message, key: tuple[int, int]) -> Generator[None, None, bytes]:
        """
        Return the answer to a request by SDO.

        Each of REQUESTS attempts waits for ANSWER_TIMEOUT, and answers about another object are
        ignored.

        Parameters
        ----------
        message : can.Message
            The request.
        key : tuple of 2 int
            Index and subindex of its object.

        Raises
        ------
        SetupError
            No answer comes.

        """
        for _ in range(REQUESTS):
            self._answer = None
            self._send(message)
            until = self.now + ANSWER_TIMEOUT
            while self.now < until:
                yield
                answer = self._answer
                if answer is not None and canopen.sdo_object(answer) == key:
                    return answer
        raise SetupError(f'{self.own.name} does not answer SDO 0x{key[0]:04X}:{key[1]:02X}')
