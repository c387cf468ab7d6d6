# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One drive as its frames show it, and the requests that set it up; without bus and clock.

`Drives` passes the frames and the time to it; it returns states, and reasons for no torque.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from math import inf

import can
from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import mode_words, State, state_of
from spm_haptic_master.drives.drive_objects import drive_objects
from spm_haptic_master.drives.passed_check import Identity
from spm_haptic_master.drives.plan import DrivePlan, Plan, STATUS
from spm_haptic_master.drives.sdo_client import SdoClient
from spm_haptic_master.drives.torque_watch import TorqueWatch
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.node_setup import Comparison, Key
from spm_haptic_master.exceptions import SetupError

# Time from the request for Operation enabled to it (s).
ENABLE_TIMEOUT = 2.0

# Takes the data of a frame.
Handler = Callable[[bytearray], None]
# Steps, each of which waits for the next sample.
Steps = Generator[None, None, None]


class Drive:
    """
    State of one drive: what it has sent, and what is wrong with it.

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
    sdo : SdoClient
        Reads and writes its objects.
    torques : TorqueWatch
        Compares its torque with the commands, which the caller notes there.
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
        self.sdo = SdoClient(own.node_id, own.name, send)
        self.torques = TorqueWatch(own.cap)
        self.state = State.UNKNOWN
        self.torque = 0
        self.status_at = -inf
        self.mode: int | None = None
        self.identity: Identity | None = None
        self.absent: str | None = None
        self.emergency: str | None = None
        self._reported_mode = 0
        # NMT state, None before the first heartbeat, and the time from which one is due, s.
        self._nmt: int | None = None
        self._heartbeat_at = -inf
        self.booted = False
        # Time since which Operation enabled is wanted, s, and whether it was reached since then.
        self._wanted_since: float | None = None
        self._is_reached = False
        self.handlers: dict[int, tuple[int, Handler]] = {
            own.status_id: (STATUS.size, self._on_status),
            canopen.HEARTBEAT_BASE + own.node_id: (canopen.HEARTBEAT_LENGTH, self._on_heartbeat),
            canopen.EMCY_BASE + own.node_id: (canopen.EMCY_LENGTH, self._on_emergency),
            canopen.SDO_ANSWER_BASE + own.node_id: (canopen.SDO_LENGTH, self.sdo.on_answer),
        }

    @property
    def now(self) -> float:
        """Time of the present sample, s; the caller sets it before each step."""
        return self.sdo.now

    @now.setter
    def now(self, time: float) -> None:
        self.sdo.now = time

    def clear(self) -> None:
        """Forget what an acknowledgement or the proof ends; from now on a heartbeat is due."""
        self._heartbeat_at = self.now
        self.emergency = None
        self.absent = None
        self._wanted_since = None
        self.torques.clear()

    def fault(self, operate: bool) -> str | None:
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
        if found := self._own_fault() or self.deviation(operate):
            return f'{self.own.name}: {found}'
        return None

    def _own_fault(self) -> str | None:
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

    def deviation(self, operate: bool) -> str | None:
        """
        Return how the drive deviates from its command; to be called once a sample.

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
            self._is_reached = False
        if self._wanted_since is None:
            return self.torques.deviation
        if self.state is not State.ENABLED:
            found = self._late_state(self._wanted_since)
        else:
            self._is_reached = True
            found = self._other_mode()
        return found or self.torques.deviation

    def _late_state(self, wanted_since: float) -> str | None:
        """Return that Operation enabled was left, or comes too late; None while it may come."""
        if self._is_reached:
            return f'left Operation enabled ({self.state.value})'
        if self.now - wanted_since > ENABLE_TIMEOUT:
            return f'{self.state.value} {ENABLE_TIMEOUT:g} s after Operation enabled was asked for'
        return None

    def _other_mode(self) -> str | None:
        """Return that the drive reports another mode than it was set to; None if it does not."""
        if self._reported_mode == self.mode:
            return None
        return (
            f'mode of operation {mode_words(self._reported_mode)}; expected '
            f'{mode_words(self.mode or 0)}'
        )

    def _on_status(self, data: bytearray) -> None:
        """Note a status frame: state, torque and mode."""
        word, self.torque, self._reported_mode = STATUS.unpack(data)
        self.state = state_of(word)
        elapsed = min(self.now - self.status_at, self._plan.status_timeout)
        self.status_at = self.now
        self.torques.report(self.torque, elapsed)

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
        profile = yield from self._read_profile()
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
            values[expected.key] = yield from self.sdo.read(expected.key)
        comparison = Comparison(wanted, values)
        if comparison.different:
            differences = '; '.join(comparison.hinted)
            raise SetupError(f'{self.own.name}: {differences} (can_setup --drives --write)')

    def _read_profile(self) -> Generator[None, None, int | None]:
        """Read the device type once the drive answers; earlier boots do not count."""
        while True:
            self.booted = False
            try:
                profile = yield from self.sdo.read(canopen.DEVICE_TYPE)
            except SetupError as error:
                self.absent = str(error)
                continue
            if not self.booted:
                self.absent = None
                return profile

    def _read_identity(self) -> Generator[None, None, Identity]:
        """Read vendor id, product code, serial number and polarity; None for a missing one."""
        vendor = yield from self.sdo.read(canopen.VENDOR_ID)
        product = yield from self.sdo.read(canopen.PRODUCT_CODE)
        serial = yield from self.sdo.read_alone(canopen.SERIAL_NUMBER)
        polarity = yield from self.sdo.read(cia402.POLARITY)
        return Identity(vendor=vendor, product=product, serial=serial, polarity=polarity)

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
            supported = yield from self.sdo.read(cia402.SUPPORTED_MODES)
            if supported is not None:
                modes = [mode for mode in modes if supported >> (mode - 1) & 1]
        for mode in modes:
            is_accepted = yield from self.sdo.write(cia402.MODE, mode, size=1)
            if is_accepted:
                self.mode = mode
                return
        raise SetupError(
            f'{self.own.name}: no mode of operation 0x6060 of torque; expected '
            f'{mode_words(cia402.CYCLIC_TORQUE)} or '
            f'{mode_words(cia402.PROFILE_TORQUE)}'
        )
