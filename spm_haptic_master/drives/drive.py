# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One drive, as its frames show it; without bus and clock."""

from __future__ import annotations

from collections.abc import Callable

from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import mode_words, State, state_of
from spm_haptic_master.drives.plan import DrivePlan, Plan, STATUS
from spm_haptic_master.encoders import canopen

# Deviation of the torque from its command (share of it) that is a fault if it lasts (s). Below a
# quarter of the cap friction and noise of the drive are larger than such a share.
TORQUE_SHARE, TORQUE_FLOOR, TORQUE_TIME = 0.2, 0.25, 0.05
# Time from the request for Operation enabled to it (s).
ENABLE_TIMEOUT = 2.0
NEVER = float('-inf')

# Takes the data of a frame and the time when it was read, s.
Handler = Callable[[bytearray, float], None]


class Drive:
    """State of one drive, as it is configured by `own` of a plan."""

    __slots__ = ('_before', '_booted', '_command', '_heartbeat_at', '_nmt',
                 '_off_since', '_plan', '_range', '_reached', '_shown_mode', '_since', 'answer',
                 'emergency', 'mode', 'own', 'state', 'status_at', 'torque')

    def __init__(self, own: DrivePlan, plan: Plan):
        self.own = own
        self._plan = plan
        self.state = State.UNKNOWN
        self.torque = 0  # reported, per mille
        self.status_at = NEVER  # time of the latest status frame, s
        self.mode: int | None = None  # that it was set to
        self.answer: bytes | None = None  # latest one by SDO, until it is removed
        self.emergency: str | None = None  # latest one in words, until it is reset
        self._shown_mode = 0
        # NMT state, and the time of the latest heartbeat, s; None before the first.
        self._nmt: int | None = None
        self._heartbeat_at: float | None = None
        self._booted = False
        # Command in force, and the range of the commands since the latest status frame and between
        # that one and the one before, per mille: a status frame may be as old as two periods.
        self._command = 0
        self._range = self._before = (0, 0)
        # Times since which the torque is off its command and Operation enabled is wanted, s, and
        # whether it was reached since then.
        self._off_since: float | None = None
        self._since: float | None = None
        self._reached = False

    def handlers(self) -> dict[int, tuple[int, Handler]]:
        """Return data length and handler of each of its frames by identifier."""
        node_id = self.own.node_id
        return {
            self.own.status_id: (STATUS.size, self._on_status),
            canopen.HEARTBEAT_BASE + node_id: (canopen.HEARTBEAT_LENGTH, self._on_heartbeat),
            canopen.EMCY_BASE + node_id: (canopen.EMCY_LENGTH, self._on_emergency),
            canopen.SDO_ANSWER_BASE + node_id: (canopen.SDO_LENGTH, self._on_answer),
        }

    def restart(self) -> None:
        """Forget what an acknowledgement clears."""
        self.emergency = self._off_since = self._since = None
        self._booted = False

    def command(self, torque: int) -> None:
        """Take note of a torque that is sent, per mille."""
        self._command = torque
        low, high = self._range
        self._range = min(low, torque), max(high, torque)

    def trouble(self, now: float, operate: bool) -> str | None:
        """
        Return what is wrong with the drive at a time, s; None if nothing is.

        `operate`: whether Operation enabled is wanted.
        """
        if not operate:
            self._since = None
        elif self._since is None:
            self._since, self._reached = now, False
        if found := self._silence(now) or self._refusal(now):
            return f'{self.own.name}: {found}'
        return None

    def _silence(self, now: float) -> str | None:
        """Return what it reports of itself, or what it does not send."""
        plan = self._plan
        if self.emergency:
            return self.emergency
        if self.state in (State.FAULT, State.REACTING):
            return str(self.state.value)
        if self._booted:
            return 'booted: it has lost what it was set to'
        heard = self._heartbeat_at
        if heard is not None and now - heard > plan.heartbeat_timeout:
            return f'no heartbeat for {1e3 * (now - heard):.0f} ms'
        if self._nmt not in (None, canopen.OPERATIONAL):
            return f'NMT state {canopen.state_word(self._nmt or 0)}'
        if now - self.status_at > plan.status_timeout:
            return f'no status frame for {1e3 * (now - self.status_at):.0f} ms'
        return None

    def _refusal(self, now: float) -> str | None:
        """Return how the drive deviates from its command; None if it follows."""
        if self._since is not None:
            if self.state is State.ENABLED:
                self._reached = True
                if self._shown_mode != self.mode:
                    return (f'mode of operation {mode_words(self._shown_mode)}; expected '
                            f'{mode_words(self.mode or 0)}')
            elif self._reached:
                return f'left Operation enabled ({self.state.value})'
            elif now - self._since > ENABLE_TIMEOUT:
                return (f'{self.state.value} {ENABLE_TIMEOUT:g} s after Operation enabled was '
                        'asked for')
        off = self._off_since
        # By the status frames: while none comes the torque is not known.
        if off is not None and self.status_at - off > TORQUE_TIME:
            return (f'torque {self.torque} per mille for a command of {self._command}, off by '
                    f'more than {100.0 * TORQUE_SHARE:.0f} % for '
                    f'{1e3 * (self.status_at - off):.0f} ms')
        return None

    def _on_status(self, data: bytearray, now: float) -> None:
        word, self.torque, self._shown_mode = STATUS.unpack(data)
        self.state = state_of(word)
        self.status_at = now
        low = min(self._range[0], self._before[0])
        high = max(self._range[1], self._before[1])
        self._before, self._range = self._range, (self._command, self._command)
        allowed = TORQUE_SHARE * max(abs(low), abs(high), TORQUE_FLOOR * self.own.cap)
        if low - allowed <= self.torque <= high + allowed:
            self._off_since = None
        elif self._off_since is None:
            self._off_since = now

    def _on_heartbeat(self, data: bytearray, now: float) -> None:
        self._nmt = data[0] & 0x7F
        if self._nmt == canopen.BOOT_UP:
            self._booted = True
            self._heartbeat_at = None
        else:
            self._heartbeat_at = now

    def _on_emergency(self, data: bytearray, now: float) -> None:
        reset = canopen.emcy_code(data) == canopen.EMCY_ERROR_RESET
        self.emergency = None if reset else canopen.emcy_words(data, cia402.ERROR_WORDS)

    def _on_answer(self, data: bytearray, now: float) -> None:
        self.answer = bytes(data)
